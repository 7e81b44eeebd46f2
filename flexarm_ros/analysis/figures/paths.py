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

"""The end effector's path over the reference, and how far cases lie apart: Figures 5 and 7."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from typing import Any, TYPE_CHECKING

from flexarm_ros.analysis.figures.corners import draw_peak
from flexarm_ros.analysis.figures.style import (
    BLACK,
    GREY,
    group_switches,
    legend_below,
    line,
    new_figure,
    Panel,
    panel_title,
    REFERENCE,
    Style,
    styled,
    wrap,
)
from flexarm_ros.analysis.report.runs import COLLOCATED, ReportedRun
from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Box = tuple[float, float, float, float]

COLUMNS = 2
LEGEND_ROW = 0.19
"""Height of a line of a legend, inches."""


def path_figure(groups: Sequence[Panel], zoomed: Sequence[int] = ()) -> Figure:
    """
    Return the end effector's path with the reference, one panel a group (Figures 5, 7).

    All panels have the same limits.  Below the path of a group of several runs is their distance
    from the collocated one, or from the first one, over time.  ``zoomed``: for each group the
    switch (counted from 0) whose transient an inset shows.
    """
    columns = min(COLUMNS, len(groups))
    apart = any(len(group.runs) > 1 for group in groups)
    rows = -(-len(groups) // columns)
    heights = ([5.0, 1.5] if apart else [5.0]) * rows
    legends = _legend_height(groups)
    figure = new_figure(5.2 * columns, sum(heights) + 0.55 + legends * rows)
    grid = figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)
    limits = _limits(groups)
    upper = grid[:: 2 if apart else 1]
    for axis, group in zip_longest(upper.ravel(), groups):
        if group is None:
            axis.set_visible(False)
        else:
            _draw_paths(axis, group, limits)
    for axis, group, index in zip(upper.ravel(), groups, zoomed, strict=False):
        draw_peak(axis, group, group_switches(group)[index])
    lowest = list(upper.ravel())
    if apart:
        lowest = list(grid[1::2].ravel())
        _draw_distances(lowest, groups)
        for row in grid[1::2]:
            row[0].set_ylabel('mm')
    for axis, top, _ in zip(lowest, upper.ravel(), groups, strict=False):
        legend_below(axis, *top.get_legend_handles_labels(), ncols=2, inches=0.42)
    for row in upper:
        row[0].set_ylabel('y, m')
    return figure


def _legend_height(groups: Sequence[Panel]) -> float:
    """Return the height, inches, of the longest legend of two columns."""
    entries = max(2 + sum(1 + label.count('\n') for label in map(wrap, _names(group)))
                  for group in groups)  # fmt: skip
    return LEGEND_ROW * (1 + entries / 2.0)


def _names(group: Panel) -> list[str]:
    return [label for _, _, label in styled(group)]


def _limits(groups: Sequence[Panel]) -> Box:
    """Return equal spans around all that is drawn, the base included: x, then y."""
    spans = []
    drawn = []
    for group in groups:
        names = ('rigid', 'ref', 'tip') if len(group.runs) == 1 else ('rigid', 'ref')
        drawn += [(run, name) for run in group.runs for name in names]
    for axis in 'xy':
        columns = [run.columns[f'{name}_{axis}'] for run, name in drawn]
        values = np.concatenate([*columns, np.zeros(1)])
        values = values[np.isfinite(values)]
        spans.append((float(values.min()), float(values.max())))
    half = 0.54 * max(1e-3, *(high - low for low, high in spans))
    (x, y) = (0.5 * (low + high) for low, high in spans)
    return x - half, x + half, y - half, y + half


def _draw_paths(axis: Axes, group: Panel, limits: Box) -> None:
    _reference(axis, group)
    axis.plot(0.0, 0.0, '+', color=BLACK, markersize=9, label='base')
    for run, style, label in styled(group):
        line(axis, run.columns['rigid_x'], run.columns['rigid_y'], style, wrap(label))
    if len(group.runs) == 1:
        columns = group.runs[0].columns
        style = Style('slate', dashes=(1.0, 1.8), width=0.9)
        line(axis, columns['tip_x'], columns['tip_y'], style, 'tip, with deflection')
    axis.set_box_aspect(1.0)  # with limits of equal size this is an equal scale
    axis.set(xlim=limits[:2], ylim=limits[2:], xlabel='x, m', title=panel_title(group))


def _draw_distances(axes: Sequence[Axes], groups: Sequence[Panel]) -> None:
    """Draw how far the runs of each group are from its collocated one; one scale for all."""
    highest = 0.0
    for axis, group in zip_longest(axes, groups):
        if group is None or len(group.runs) < 2:
            axis.set_visible(False)
            continue
        named = styled(group)
        first = next((run for run, _, _ in named if run.role == COLLOCATED), named[0][0])
        for time in group_switches(group):
            axis.axvline(time, color=GREY, linewidth=0.7, linestyle=':')
        for run, style, label in named:
            if run is not first:
                t, apart = _distance(run, first)
                line(axis, t, apart, style, label)
                highest = max(highest, float(np.nanmax(apart, initial=0.0)))
        axis.set(xlabel='time, s  (dotted: the reference switches its direction)')
        axis.set_title(f'distance from {first.role or first.name}, mm', fontsize=9)
    for axis in axes:
        axis.set_ylim(0.0, 1.06 * highest if highest > 0.0 else 1.0)


def _distance(run: ReportedRun, other: ReportedRun) -> tuple[FloatArray, FloatArray]:
    """Return the common times, s, and the distance of two end effectors at them, mm."""
    mine, theirs = run.columns, other.columns
    t = mine['t'][: np.searchsorted(mine['t'], theirs['t'][-1:].max(initial=-1.0), 'right')]
    if not len(t):
        return t, t
    x, y = (mine[name][: len(t)] - np.interp(t, theirs['t'], theirs[name])
            for name in ('rigid_x', 'rigid_y'))  # fmt: skip
    return t, 1e3 * np.hypot(x, y)


def _reference(axis: Axes, group: Panel) -> None:
    """Draw the longest reference of a group, with its start and its direction."""
    run = max(group.runs, key=lambda run: run.rows)
    x, y = run.columns['ref_x'], run.columns['ref_y']
    axis.plot(x, y, label='reference', **REFERENCE)
    if not run.rows:
        return
    axis.plot(x[0], y[0], 'o', color=BLACK, markersize=4, zorder=3, label='start')
    half_side = (run.switches() or [0.0])[0] / 2.0
    middle = min(run.rows - 1, int(np.searchsorted(run.columns['t'], half_side)))
    ahead = min(run.rows - 1, middle + 1)
    dx, dy = x[ahead] - x[middle], y[ahead] - y[middle]
    length = float(np.hypot(dx, dy))
    if np.isfinite(length) and length > 0.0:
        arrow: Any = {'arrowstyle': '-|>', 'color': BLACK}
        axis.annotate(
            '', (x[middle] + 0.5 * dx / length, y[middle] + 0.5 * dy / length),
            (x[middle], y[middle]), arrowprops=arrow,
        )  # fmt: skip
