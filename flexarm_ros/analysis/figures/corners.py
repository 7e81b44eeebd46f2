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

"""The transients at the reference's changes of direction: the paper's Figures 6 and 8."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.style import (
    between,
    GREY,
    group_switches,
    legend_below,
    line,
    new_figure,
    Panel,
    panel_title,
    REFERENCE,
    styled,
    wrap,
)
from flexarm_ros.analysis.report.runs import ReportedRun
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BEFORE, AFTER = 0.1, 0.6
"""Time around a direction switch whose path sets the frame of a zoomed view, s."""

INSETS = (0.34, 0.27, 0.2)
"""Sides of insets, parts of the axes; a smaller one only where a larger one covers a curve."""


def corner_figure(groups: Sequence[Panel], only: Sequence[int] | None = None) -> Figure:
    """
    Return the transients at the reference's direction switches, zoomed (Figures 6, 8).

    One row per group and one column per switch; with ``only``, one switch per group (counted
    from 0), side by side.
    """
    switches = [group_switches(group) for group in groups]
    if only is not None:
        figure = new_figure(4.6 * len(groups), 5.5)
        figure.set_layout_engine('compressed', w_pad=0.12, h_pad=0.08)
        axes = figure.subplots(1, len(groups), squeeze=False)[0]
        for axis, group, index, times in zip(axes, groups, only, switches, strict=True):
            _draw_corner(axis, group, index, times[index])
        axes[0].set_ylabel('y, m')
        return figure
    columns = max(1, *(len(times) for times in switches))
    figure = new_figure(3.5 * columns, 4.7 * len(groups))
    figure.set_layout_engine('compressed', w_pad=0.12, h_pad=0.08)
    grid = figure.subplots(len(groups), columns, squeeze=False)
    for row, (group, times) in enumerate(zip(groups, switches, strict=True)):
        for column in range(columns):
            if column < len(times):
                _draw_corner(grid[row, column], group, column, times[column])
            else:
                grid[row, column].set_visible(False)
        grid[row, 0].set_ylabel('y, m')
    return figure


def _draw_corner(axis: Axes, group: Panel, index: int, time: float) -> None:
    low_x, high_x, low_y, high_y = _corner_frame(group, time)
    longest = max(group.runs, key=lambda run: run.rows)
    part = between(longest, time - 2.0, time + 2.0)
    axis.plot(longest.columns['ref_x'][part], longest.columns['ref_y'][part], **REFERENCE)
    for run, style, label in styled(group):
        overshoot = _overshoot(run, index)
        text = wrap(label if overshoot is None else f'{label}: {overshoot:.3f} m')
        rows = between(run, time - 1.0, time + 2.0)
        x, y = run.columns['rigid_x'][rows], run.columns['rigid_y'][rows]
        line(axis, x, y, style, text)
    axis.set_box_aspect(1.0)  # with limits of equal size this is an equal scale
    axis.set_xlim(low_x, high_x)
    axis.set_ylim(low_y, high_y)
    axis.set(xlabel='x, m')
    axis.set_title(f'{panel_title(group)}\nswitch {index + 1}, t = {time:g} s', fontsize=9)
    if len(group.runs) > 1:
        draw_peak(axis, group, time)
    legend_below(axis, title='overshoot past the corner', title_fontsize=8, inches=0.42)


def _corner_frame(group: Panel, time: float) -> tuple[float, float, float, float]:
    """Return a square frame around the paths of runs and reference after a switch."""
    xs, ys = [], []
    for run in group.runs:
        rows = between(run, time - BEFORE, time + AFTER)
        for name in ('rigid', 'ref'):
            xs.append(run.columns[f'{name}_x'][rows])
            ys.append(run.columns[f'{name}_y'][rows])
    x, y = np.concatenate(xs), np.concatenate(ys)
    x, y = x[np.isfinite(x)], y[np.isfinite(y)]
    if not len(x) or not len(y):
        return -1.0, 1.0, -1.0, 1.0
    half = 0.54 * max(float(np.ptp(x)), float(np.ptp(y)), 1e-3)
    middle_x, middle_y = float(x.min() + x.max()) / 2.0, float(y.min() + y.max()) / 2.0
    return middle_x - half, middle_x + half, middle_y - half, middle_y + half


def draw_peak(axis: Axes, group: Panel, time: float) -> None:
    """Add an inset around the furthest points past the corner, which differ by millimetres."""
    peaks = [peak for run in group.runs if (peak := _peak(run, time)) is not None]
    if len(peaks) < 2:
        return
    points = np.array(peaks)
    half = max(4.0 * float(np.ptp(points[:, 2])), 1e-4)
    x, y = float(points[:, 0].mean()), float(points[:, 1].mean())
    if half > 0.04 * float(np.ptp(axis.get_xlim())):
        return  # the differences are visible without an inset
    inset = axis.inset_axes(_free_place(axis, x, y))
    for run, style, _ in styled(group):
        rows = between(run, time, time + AFTER)
        line(inset, run.columns['rigid_x'][rows], run.columns['rigid_y'][rows], style, '')
    inset.set(xlim=(x - half, x + half), ylim=(y - half, y + half))
    inset.set_xticks([])
    inset.set_yticks([])
    width = 2e3 * half
    text = f'{width:.0f} mm wide' if width >= 10.0 else f'{width:.1f} mm wide'
    inset.set_xlabel(text, fontsize=7, labelpad=2.0)
    for spine in inset.spines.values():
        spine.set_visible(True)
    axis.indicate_inset_zoom(inset, edgecolor=GREY)


def _free_place(axis: Axes, x: float, y: float) -> tuple[float, float, float, float]:
    """Return where an inset with a text below it covers least of the curves, in axes' parts."""
    (low_x, high_x), (low_y, high_y) = axis.get_xlim(), axis.get_ylim()
    low, span = np.array([low_x, low_y]), np.array([high_x - low_x, high_y - low_y])
    drawn = [np.column_stack([np.asarray(v, dtype=float) for v in curve.get_data()])
             for curve in axis.get_lines()]  # fmt: skip
    points = (np.concatenate(drawn) - low) / span
    peak = (np.array([x, y]) - low) / span
    best, least = (0.5, 0.5, INSETS[-1]), np.inf
    for size in INSETS:
        for left in np.linspace(0.04, 0.96 - size, 30):
            for bottom in np.linspace(0.1, 0.96 - size, 27):
                corner = np.array([left - 0.03, bottom - 0.1])
                extent = np.array([size + 0.06, size + 0.13])
                inside = np.all((points > corner) & (points < corner + extent), axis=1)
                cost = inside.sum() + np.hypot(*(corner + extent / 2.0 - peak)) / 4.0
                if cost < least:
                    best, least = (float(left), float(bottom), size), cost
        if least < 1.0:
            break  # nothing is covered
    return *best, best[2]


def _peak(run: ReportedRun, time: float) -> tuple[float, float, float] | None:
    """Return x, y and distance of the furthest point past a corner in the second after it."""
    rows = between(run, time, time + 1.0)
    corner = rows.start
    if corner < 1 or rows.stop - corner < 2:
        return None
    c = run.columns
    along_x = c['ref_x'][corner] - c['ref_x'][corner - 1]
    along_y = c['ref_y'][corner] - c['ref_y'][corner - 1]
    past = (c['rigid_x'][rows] - c['ref_x'][corner]) * along_x
    past += (c['rigid_y'][rows] - c['ref_y'][corner]) * along_y
    length = float(np.hypot(along_x, along_y))
    if not np.isfinite(past).any() or length == 0.0:
        return None
    best = int(np.nanargmax(past))
    x, y = c['rigid_x'][corner + best], c['rigid_y'][corner + best]
    return float(x), float(y), float(past[best]) / length


def _overshoot(run: ReportedRun, index: int) -> float | None:
    values = run.summary.get('overshoot')
    if not isinstance(values, list) or index >= len(values):
        return None
    return values[index] if isinstance(values[index], float) else None
