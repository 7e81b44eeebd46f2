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

"""
Figures of a sweep: a map over two parameters, or a curve.

A map shows which runs survived, and the stability boundary of the linear analysis.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import itertools
from pathlib import Path
from statistics import median
from typing import Any, TYPE_CHECKING

from flexarm_ros.analysis.figures.style import (
    BLUE,
    drawing,
    GREY,
    new_figure,
    ORANGE,
    save,
    wrap,
)
from flexarm_ros.analysis.sweep.store import Table
from flexarm_ros.analysis.sweep_linear import BEST, Linear, WORST
from flexarm_ros.core.parameters.sections import keys
from flexarm_ros.core.run.results.metric_list import unit_of
from flexarm_ros.scenario.sweeps.axes import numbers_in, Parameter
from flexarm_ros.scenario.sweeps.sweep import Sweep
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_PICTURES = 12
WIDEST = 60
"""Longest line of a title, characters: those of a figure 6.4 inches wide with a colour bar."""
SUCCESS = 'stable'
"""Value of a map that is the share of runs that reach their end."""


@dataclass(frozen=True)
class _Cells:
    """
    One figure's data over x and y.

    The median value of the surviving runs, or the share if that is the value; their share, and
    the index of the point.
    """

    title: str
    x: list[float]
    y: list[float]
    value: NDArray[np.float64]
    share: NDArray[np.float64]
    point: NDArray[np.int64]


def write_pictures(
    sweep: Sweep, table: Table, out: Path, linear: Linear | None = None
) -> list[Path]:
    """
    Draw the sweep's map or curve, one figure for each point of the other axes.

    Unstable runs have no colour; one line marks where half of the runs reach their end, others
    the boundary of the ``linear`` analysis.  A sweep without a numeric axis has no figures.
    """
    plan = sweep.plan
    if plan is None or plan.value not in table:
        return []
    others = [name for name in ('scenario', *sweep.axes) if name not in (plan.x, plan.y)]
    keys = sorted(set(zip(*(map(str, table[name]) for name in others), strict=True)))
    out.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    with drawing():
        for key in keys[:MOST_PICTURES]:
            cells = _cells(sweep, table, dict(zip(others, key, strict=True)))
            figure = _map_figure(sweep, cells, linear) if plan.y else _curve_figure(sweep, cells)
            paths += save(figure, out, _stem(plan.value, sweep, key))
    return paths


def _stem(value: str, sweep: Sweep, key: Sequence[str]) -> str:
    text = '_'.join([value, *key])
    return ''.join(c if c.isalnum() or c in '._-' else '_' for c in text)[:120]


def _cells(sweep: Sweep, table: Table, fixed: dict[str, str]) -> _Cells:
    plan = sweep.plan
    assert plan is not None
    size = len(table['index'])
    chosen = [i for i in range(size) if all(str(table[k][i]) == v for k, v in fixed.items())]
    xs = _positions(table[plan.x])
    ys = _positions(table[plan.y]) if plan.y else [0.0] * size
    x, y = sorted({xs[i] for i in chosen}), sorted({ys[i] for i in chosen})
    groups: dict[tuple[float, float], list[int]] = {}
    for i in chosen:
        groups.setdefault((xs[i], ys[i]), []).append(i)
    value, share = np.full((len(y), len(x)), np.nan), np.full((len(y), len(x)), np.nan)
    point = np.full((len(y), len(x)), -1)
    for (row, b), (column, a) in itertools.product(enumerate(y), enumerate(x)):
        here = groups.get((a, b), [])
        if here:
            point[row, column] = table['index'][here[-1]] // sweep.samples
        runs = [i for i in here if table['stable'][i] is not None]
        if runs:
            share[row, column] = sum(map(bool, (table['stable'][i] for i in runs))) / len(runs)
        found = [table[plan.value][i] for i in runs if table['stable'][i]]
        known = [float(v) for v in found if v is not None]
        if plan.value == SUCCESS and runs:
            value[row, column] = share[row, column]
        elif known:
            value[row, column] = median(known)
    title = ', '.join(v if k == 'scenario' else f'{_short(k)} {v}' for k, v in fixed.items())
    return _Cells(title, x, y, value, share, point)


def _positions(column: Sequence[Any]) -> list[float]:
    """Return the coordinates of values; for an array of two, the first one."""
    return [numbers_in(str(v))[0] for v in column]


def _map_figure(sweep: Sweep, cells: _Cells, linear: Linear | None) -> Figure:
    from matplotlib.colors import ListedColormap

    plan = sweep.plan
    assert plan is not None
    figure = new_figure(6.4, 5.2)
    axis = figure.add_subplot()
    x, y = _edges(cells.x), _edges(cells.y)
    axis.grid(False)
    unstable = np.where(cells.share == 0.0, 1.0, np.nan)
    axis.pcolormesh(x, y, unstable, cmap=ListedColormap(['#d9d9d9']), vmin=0, vmax=1)
    mesh = axis.pcolormesh(x, y, cells.value, cmap='viridis_r')
    if np.isfinite(cells.value).any():
        figure.colorbar(mesh, ax=axis, label=_metric_label(plan.value))
    _survived(axis, cells)
    axis.set(xlabel=_label(plan.x), ylabel=_label(plan.y), title=wrap(cells.title, WIDEST))
    if plan.value != SUCCESS:
        axis.plot([], [], 's', color='#d9d9d9', label='simulated: unstable within the run')
    axis.plot([], [], color=ORANGE, label='simulated: half of the runs complete')
    note = _linear(axis, cells, linear) if linear is not None else ''
    figure.legend(loc='outside lower center', ncols=2, frameon=False, title=note or None)
    return figure


def _linear(axis: Axes, cells: _Cells, linear: Linear) -> str:
    """Draw the linear stability boundary; return notes about it."""
    limits = axis.get_xlim(), axis.get_ylim()
    points = [int(point) for point in cells.point.ravel() if point >= 0]
    if any(point in linear.rates for point in points):
        for which, dashes, text in ((WORST, '-', 'the worst pose'), (BEST, ':', 'the best pose')):
            for ends in _crossed(cells, linear.crossings[which]):
                axis.plot(*zip(*ends, strict=True), color=BLUE, linewidth=2.0, linestyle=dashes)
            label = f'linear, at rest: boundary at {text}'
            axis.plot([], [], color=BLUE, linestyle=dashes, label=label)
        axis.plot([], [], 'x', color=BLUE, markersize=3, label='linear: unstable at some pose')
    for row, column in zip(*np.nonzero(cells.point >= 0), strict=True):
        rates = linear.rates.get(int(cells.point[row, column]))
        if rates is not None and rates[WORST] > 0.0:
            axis.plot(cells.x[column], cells.y[row], 'x', color=BLUE, markersize=3)
    axis.set(xlim=limits[0], ylim=limits[1])
    reasons = {linear.notes[point]: None for point in points if point in linear.notes}
    if linear.refused:
        reasons = {linear.refused: None}
    said = [f'no linear boundary: {reason}' for reason in reasons]
    if linear.ignored:
        said.append(f'not in the linear analysis: {", ".join(linear.ignored)}')
    return '\n'.join(said)


Place = tuple[float, float]


def _crossed(cells: _Cells, crossings: dict[tuple[int, int], float]) -> Iterator[list[Place]]:
    """Yield the segments of a boundary: within each square of points, from side to side."""
    rows, columns = cells.point.shape
    for row, column in np.ndindex(rows - 1, columns - 1):
        corners = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column)]
        sides = zip(corners, [*corners[1:], corners[0]], strict=True)
        found = [_on_side(cells, crossings, *side) for side in sides]
        ends = [place for place in found if place is not None]
        yield from (ends[i : i + 2] for i in range(0, len(ends) - 1, 2))


def _on_side(
    cells: _Cells, crossings: dict[tuple[int, int], float],
    first: tuple[int, int], second: tuple[int, int],
) -> Place | None:  # fmt: skip
    """Return where a boundary crosses the side between two neighbours (row, column)."""
    one, other = sorted((first, second), key=lambda corner: int(cells.point[corner]))
    part = crossings.get((int(cells.point[one]), int(cells.point[other])))
    if part is None:
        return None
    start, end = ((cells.x[column], cells.y[row]) for row, column in (one, other))
    return start[0] + part * (end[0] - start[0]), start[1] + part * (end[1] - start[1])


def _survived(axis: Axes, cells: _Cells) -> None:
    """Draw where the share of runs that reach their end crosses 0.5, along the cells' edges."""
    stable = cells.share >= 0.5
    known = np.isfinite(cells.share)
    x, y = _edges(cells.x), _edges(cells.y)
    for row, column in np.ndindex(stable.shape):
        for down, right in ((1, 0), (0, 1)):
            other = (row + down, column + right)
            if other[0] >= stable.shape[0] or other[1] >= stable.shape[1]:
                continue
            if known[row, column] and known[other] and stable[row, column] != stable[other]:
                ends = (
                    ([x[column], x[column + 1]], [y[row + 1]] * 2)
                    if down
                    else ([x[column + 1]] * 2, [y[row], y[row + 1]])
                )
                axis.plot(*ends, color=ORANGE, linewidth=2.2, solid_capstyle='round')


def _edges(centres: Sequence[float]) -> NDArray[np.float64]:
    """Return the edges of cells around sorted centres."""
    points = np.asarray(centres)
    if len(points) == 1:
        half = abs(points[0]) * 0.5 or 0.5
        return np.array([points[0] - half, points[0] + half])
    middles = (points[1:] + points[:-1]) / 2
    first, last = 2 * points[0] - middles[0], 2 * points[-1] - middles[-1]
    return np.concatenate([[first], middles, [last]])


def _curve_figure(sweep: Sweep, cells: _Cells) -> Figure:
    plan = sweep.plan
    assert plan is not None
    figure = new_figure(6.4, 4.0)
    axis = figure.add_subplot()
    axis.plot(cells.x, cells.value[0], 'o-', color=BLUE, markersize=3.5)
    for place, share in zip(cells.x, cells.share[0], strict=True):
        if share < 0.5:
            axis.axvline(place, color=GREY, linewidth=0.8, alpha=0.6)
    axis.plot([], [], color=GREY, linewidth=0.8, label='unstable within the run')
    axis.set(xlabel=_label(plan.x), ylabel=_metric_label(plan.value))
    axis.set_title(wrap(cells.title, WIDEST))
    axis.legend()
    return figure


def _short(name: str) -> str:
    return name.rpartition('.')[2].replace('_', ' ')


def _label(name: str) -> str:
    parameter = Parameter.named(name)
    unit = keys(parameter.section)[parameter.key][1].unit
    return name.replace('_', ' ').replace('.', ': ') + (f', {unit}' if unit else '')


def _metric_label(name: str) -> str:
    if name == SUCCESS:
        return 'share of runs that complete'
    unit = unit_of(name)
    return name.replace('_', ' ') + (f', {unit}' if unit else '')
