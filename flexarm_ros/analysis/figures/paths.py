# Copyright 2026 The flexarm_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""The end effector's path and its reference (the paper's Figures 5 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.style import (
    BLACK,
    GREY,
    line,
    new_figure,
    Panel,
    panel_title,
    Style,
    styled,
    wrap,
)
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def path_figure(groups: Sequence[Panel]) -> Figure:
    """Return the end effector's path with the reference, one panel a group (Figures 5, 7)."""
    columns = min(2, len(groups))
    rows = -(-len(groups) // columns)
    figure = new_figure(5.2 * columns, 4.9 * rows)
    axes = figure.subplots(rows, columns, squeeze=False).ravel()
    for axis, group in zip_longest(axes, groups):
        if group is not None:
            _draw_paths(axis, group)
        else:
            axis.set_visible(False)
    return figure


def _draw_paths(axis: Axes, group: Panel) -> None:
    first = group.runs[0]
    _reference(axis, group)
    for run, style, label in styled(group):
        line(axis, run.columns['rigid_x'], run.columns['rigid_y'], style, wrap(label))
    if len(group.runs) == 1:
        columns = first.columns
        style = Style(GREY, ':', 0.9)
        line(axis, columns['tip_x'], columns['tip_y'], style, 'tip, with deflection')
    axis.plot(0.0, 0.0, '+', color=BLACK, markersize=9)
    axis.annotate('base', (0.0, 0.0), (0, -7), textcoords='offset points', ha='center', va='top')
    axis.set_aspect('equal', adjustable='datalim')
    axis.set(xlabel='x, m', ylabel='y, m', title=panel_title(group))
    axis.legend(loc='center', bbox_to_anchor=(0.5, 0.68))


def _reference(axis: Axes, group: Panel) -> None:
    """Draw the longest reference of a group, with its start and its direction."""
    run = max(group.runs, key=lambda run: run.rows)
    x, y = run.columns['ref_x'], run.columns['ref_y']
    axis.plot(x, y, color=BLACK, linewidth=0.8, linestyle=(0, (6, 3)), label='reference')
    if not run.rows:
        return
    axis.plot(x[0], y[0], 'o', color=BLACK, markersize=4, label='start')
    half_side = (run.switches() or [0.0])[0] / 2.0
    middle = min(run.rows - 1, int(np.searchsorted(run.columns['t'], half_side)))
    ahead = min(run.rows - 1, middle + 1)
    dx, dy = x[ahead] - x[middle], y[ahead] - y[middle]
    length = float(np.hypot(dx, dy))
    if np.isfinite(length) and length > 0.0:
        axis.annotate(
            '', (x[middle] + 0.5 * dx / length, y[middle] + 0.5 * dy / length),
            (x[middle], y[middle]), arrowprops={'arrowstyle': '-|>', 'color': BLACK},
        )  # fmt: skip
