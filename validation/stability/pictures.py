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

"""The figures of docs/stability.md, from the tables in docs/data."""

from __future__ import annotations

from collections.abc import Callable
import csv
from pathlib import Path
from typing import Any, TYPE_CHECKING

from flexarm_ros.analysis import palette
from flexarm_ros.analysis.figures.style import (
    AMBER,
    BLACK,
    BLUE,
    drawing,
    GREEN,
    GREY,
    METADATA,
    new_figure,
    ORANGE,
    PURPLE,
    SKY,
)
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NAMES = {'pd': 'PD (20)', 'fls': 'FLS (21)'}
PAPER_POINTS = ((9.0, 1.238), (6.75, 0.9289))
PHYSICAL_POINTS = ((9.0, 31.2), (6.75, 23.4))
BEYOND_MS = 200.0
"""Value for boundaries beyond the search limit: outside the figure."""

Rows = list[dict[str, str]]
Figures = Callable[[Path], 'Figure']


def read(data: Path, name: str, **equal: str) -> Rows:
    """Return the rows of a table with the given texts in the given columns."""
    with (data / f'{name}.csv').open(newline='', encoding='utf-8') as file:
        return [
            row
            for row in csv.DictReader(file)
            if all(row[key] == value for key, value in equal.items())
        ]


def column(rows: Rows, name: str, missing: float = float('nan')) -> Any:
    """Return a column as numbers, ``missing`` for empty cells."""
    return np.array([float(row[name]) if row[name] else missing for row in rows])


def draw_all(data: Path, images: Path) -> list[Path]:
    """Write every figure as PNG and return the paths."""
    figures: dict[str, Figures] = {
        'location_latency': location_latency, 'hub_latency': hub_latency, 'speed': speed,
        'fls_gain': fls_gain, 'fls_sweep': fls_sweep, 'elastic_growth': elastic_growth,
    }  # fmt: skip
    images.mkdir(parents=True, exist_ok=True)
    paths = []
    with drawing():
        for name, draw in figures.items():
            path = images / f'stability_{name}.png'
            draw(data).savefig(path, metadata=METADATA['png'])
            paths.append(path)
    return paths


def _flown_dots(axis: Axes, rows: Rows, x_name: str) -> None:
    """Mark each simulated run by its outcome."""
    x, y = column(rows, x_name), 1e3 * column(rows, 'tip_sensor.latency')
    stable = np.array([row['outcome'] == 'stable' for row in rows])
    axis.plot(x[stable], y[stable], 'o', color=GREEN, ms=4, mfc='white', label='simulated: stable')
    axis.plot(x[~stable], y[~stable], 'x', color=ORANGE, ms=4.5, label='simulated: unstable')


def _latency_axis(axis: Axes) -> None:
    axis.set_yscale('symlog', linthresh=1.0, linscale=0.5)
    axis.set_ylim(-0.08, 60.0)
    ticks = [0, 0.5, 1, 2, 3, 5, 10, 20, 30, 50]
    axis.set_yticks(ticks, [f'{tick:g}' for tick in ticks])
    axis.minorticks_off()


def _paper_points(axis: Axes) -> None:
    for points, mark, text in (
        (PAPER_POINTS, '*', 'paper, delay in steps'),
        (PHYSICAL_POINTS, 'P', 'paper, delay in seconds'),
    ):
        x, y = zip(*points, strict=True)
        axis.plot(x, y, mark, color=BLACK, ms=10, mec='white', zorder=5, label=text)


def _predicted(axis: Axes, x: Any, lines: Rows) -> None:
    """Draw the latencies at which the linear analysis predicts instability."""
    least, most = (column(lines, f'linear_{n}_ms', BEYOND_MS) for n in ('least', 'most'))
    axis.fill_between(x, least, most, color=SKY, alpha=0.3, lw=0, label='linear: at some poses')
    axis.plot(x, least, color=BLUE, lw=2.0, label='linear: from here at the worst pose')


def _flown_at_rest(axis: Axes, x: Any, lines: Rows) -> None:
    axis.plot(
        x, column(lines, 'hold_ms', BEYOND_MS), '.', color=BLACK, ms=4,
        label='simulated: boundary at rest, worst pose',
    )  # fmt: skip


def _flown_at_speed(axis: Axes, x: Any, lines: Rows) -> None:
    axis.plot(
        x, column(lines, 'paper_ms', BEYOND_MS), color=ORANGE, ls='--', lw=1.6,
        label="simulated: boundary, the paper's 3.15 m/s",
    )  # fmt: skip


def location_latency(data: Path) -> Figure:
    """Draw the boundary over the sensor location and its latency, measurand rigid."""
    figure = new_figure(10.0, 5.4)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, law in zip(axes, NAMES, strict=True):
        flown = read(
            data, 'stability_map', scenario=f'{law}_tip',
            **{'tip_sensor.measurand': 'rigid', 'controller.velocity_source': 'feedback'},
        )  # fmt: skip
        lines = read(data, 'stability_boundary', law=law)
        x = column(lines, 'location_m')
        _predicted(axis, x, lines)
        if law == 'fls':
            axis.plot(
                x, column(lines, 'linear_gain_5_ms', BEYOND_MS), color=PURPLE, ls=':', lw=1.8,
                label=r'linear, worst pose, $K_s\lambda$ = 5',
            )  # fmt: skip
        _flown_at_rest(axis, x, lines)
        axis.plot(
            x, column(lines, 'slow_ms', BEYOND_MS), color=AMBER, ls='-.', lw=1.6,
            label='simulated: boundary, 0.3 m/s',
        )  # fmt: skip
        _flown_at_speed(axis, x, lines)
        _flown_dots(axis, flown, 'tip_sensor.location')
        _paper_points(axis)
        _latency_axis(axis)
        axis.set(title=NAMES[law], xlabel='sensor from the shoulder, m', xlim=(4.35, 9.15))
    axes[0].set_ylabel('latency of position and velocity, ms')
    handles, texts = axes[1].get_legend_handles_labels()
    figure.legend(handles, texts, loc='outside lower center', ncols=4)
    figure.suptitle(
        "Stable or not: sensor's place and latency (rigid measurand, 8 kg m$^2$, 1 ms)"
    )
    return figure


def hub_latency(data: Path) -> Figure:
    """Draw the boundary over hub inertia and latency, sensor at the tip."""
    figure = new_figure(10.0, 5.0)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, law in zip(axes, NAMES, strict=True):
        flown = read(
            data, 'stability_hub', scenario=f'{law}_tip',
            **{'controller.velocity_source': 'feedback'},
        )  # fmt: skip
        lines = read(data, 'stability_hub_boundary', law=law)
        x = column(lines, 'hub_inertia')
        _predicted(axis, x, lines)
        _flown_at_rest(axis, x, lines)
        _flown_at_speed(axis, x, lines)
        _flown_dots(axis, flown, 'plant.hub_inertia')
        axis.plot(
            [8.0], [1.238], '*', color=BLACK, ms=10, mec='white', zorder=5,
            label='paper, delay in steps, 8 kg m$^2$',
        )  # fmt: skip
        axis.plot(
            [8.0], [31.2], 'P', color=BLACK, ms=9, mec='white', zorder=5,
            label='paper, delay in seconds, 8 kg m$^2$',
        )  # fmt: skip
        axis.plot(
            [0.0], [1.238], '*', color=BLACK, ms=10, mfc='white', zorder=5,
            label='paper as printed: no hub inertia',
        )  # fmt: skip
        _latency_axis(axis)
        axis.set(title=NAMES[law], xlabel='inertia of each hub, kg m$^2$', xlim=(-0.6, 20.6))
    axes[0].set_ylabel('latency of position and velocity, ms')
    handles, texts = axes[1].get_legend_handles_labels()
    figure.legend(handles, texts, loc='outside lower center', ncols=4)
    figure.suptitle('Stable or not: hub inertia and latency (sensor at the tip, rigid, 1 ms)')
    return figure


def speed(data: Path) -> Figure:
    """Draw simulated boundaries over the speed, with the linear ones as levels."""
    figure = new_figure(7.2, 4.4)
    axis = figure.subplots()
    for law in NAMES:
        for place, shade in (('9', 'base'), ('6.75', 'soft')):
            rows = read(data, 'stability_speed', law=law, location_m=place)
            color = palette.color(law, shade, 'paper')
            label = f'{NAMES[law]}, sensor at {place} m'
            flown = column(rows, 'flown_ms')
            axis.plot(column(rows, 'speed_m_s'), flown, 'o-', color=color, ms=4, label=label)
            least, most = (column(rows, f'linear_{n}_ms')[0] for n in ('least', 'most'))
            axis.axhline(least, color=color, ls=':', lw=1.2)
            axis.axhspan(least, most, color=color, alpha=0.08, lw=0)
    axis.axvline(3.15, color=GREY, lw=0.8)
    axis.text(3.2, 0.62, 'paper', color=GREY, fontsize=8)
    axis.set(
        xscale='log', yscale='log', xlabel='speed along one side, m/s', ylim=(0.55, 40.0),
        ylabel='latency at which the run diverges, ms',
        title='Simulated boundaries against speed (dotted: linear, worst pose; band: all poses)',
    )  # fmt: skip
    axis.set_yticks([1, 2, 3, 5, 10, 20, 30], ['1', '2', '3', '5', '10', '20', '30'])
    axis.legend(loc='upper left')
    return figure


def fls_gain(data: Path) -> Figure:
    """Draw the largest stable gain over the elbow angle, and the gain of FLS in a run."""
    figure = new_figure(8.6, 5.0)
    axis = figure.subplots()
    lines = (
        ('encoder', '8', BLUE, '-', 'joint encoders, or tip without latency'),
        ('6.75 m, 0.9289 ms', '8', GREEN, '--', '6.75 m, 0.9289 ms'),
        ('tip, 1.238 ms', '8', ORANGE, '-', 'tip, 1.238 ms'),
        ('tip, 1.238 ms', '4', AMBER, '-.', 'tip, 1.238 ms, hubs 4 kg m$^2$'),
        ('tip, 1.238 ms', '20', PURPLE, '-.', 'tip, 1.238 ms, hubs 20 kg m$^2$'),
    )
    for place, inertia, color, dashes, label in lines:
        rows = read(data, 'stability_gain', place=place, hub_inertia=inertia)
        high = column(rows, 'gain_high')
        axis.plot(column(rows, 'theta2'), high, color=color, ls=dashes, lw=1.8, label=label)
    physical = read(data, 'stability_gain', place='tip, 31.2 ms')
    axis.plot(
        column(physical, 'theta2'), column(physical, 'gain_high'), color=BLACK, ls=':', lw=1.8,
        label='tip, 31.2 ms',
    )  # fmt: skip
    flown = read(data, 'stability_fls_flight', case='fls_tip')
    axis.plot(
        column(flown, 'theta2'), column(flown, 'gain'), '.', color=GREY, ms=2, zorder=1,
        label='fls_tip in flight, every 25 ms',
    )  # fmt: skip
    axis.axhspan(2.5, 12.5, color=SKY, alpha=0.15, lw=0)
    axis.text(1.75, 11.9, r'range of $K_s\lambda$', fontsize=8, color=GREY, ha='right', va='top')
    axis.axhline(1.0, color=GREY, lw=0.8)
    axis.text(1.75, 1.04, 'PD (20)', fontsize=8, color=GREY, ha='right')
    axis.set(
        yscale='log', xlabel='theta2, rad', ylabel=r'factor of $J^T(K_p e + K_d \dot e)$',
        xlim=(0.0, 1.78), ylim=(0.03, 60.0),
        title='Largest stable gain at rest, and the gain that the FLS schedules',
    )  # fmt: skip
    ticks = [0.1, 0.2, 0.5, 1, 2.5, 5, 12.5, 25, 50]
    axis.set_yticks(ticks, [f'{tick:g}' for tick in ticks])
    axis.minorticks_off()
    axis.legend(loc='lower center', ncols=2)
    return figure


def fls_sweep(data: Path) -> Figure:
    """Draw error and overshoot over the mean gain, for fuzzy systems and a constant gain."""
    figure = new_figure(10.0, 6.4)
    axes = figure.subplots(2, 2, sharex=True)
    kinds = (
        ('three', 'three functions', BLUE, 'o-'),
        ('five', 'five functions', ORANGE, 's--'),
        ('three, largest', 'three, other rules', GREEN, '^:'),
        ('constant', 'constant gain: (20)', BLACK, '-'),
    )
    for row_axes, case, title in zip(
        axes, ('fls_collocated', 'fls_tip'), ('collocated', 'tip, 1.238 ms'), strict=True
    ):
        for axis, name, label in zip(
            row_axes, ('rms_error', 'max_overshoot'), ('rms error, m', 'largest overshoot, m'),
            strict=True,
        ):  # fmt: skip
            for kind, text, color, style in kinds:
                rows = [r for r in read(data, 'stability_fls', case=case, kind=kind)
                        if r['outcome'] == 'stable' and float(r['kn']) == 5.0]  # fmt: skip
                rows.sort(key=lambda r: float(r['ks']))
                axis.plot(
                    column(rows, 'mean_gain'), column(rows, name), style, color=color, ms=3.5,
                    lw=1.2, label=text,
                )  # fmt: skip
            paper = [r for r in read(data, 'stability_fls', case=case, kind='three', ks='15')
                     if float(r['kn']) == 5.0]  # fmt: skip
            axis.plot(
                column(paper, 'mean_gain'), column(paper, name), '*', color=BLACK, ms=11,
                mec='white', zorder=5, label='paper: three, $K_s$ = 15',
            )  # fmt: skip
            axis.set(ylabel=label, title=title, ylim=(0.0, None))
    for axis in axes[1]:
        axis.set(xlabel=r'mean of $K_s\lambda$ over the flight')
    axes[0, 0].legend()
    figure.suptitle(
        'Fuzzy systems against a constant gain (each point a run, unstable ones left out)'
    )
    return figure


def elastic_growth(data: Path) -> Figure:
    """Draw the growth rates of loops with feedback of the true point over its location."""
    figure = new_figure(9.0, 4.2)
    axes = figure.subplots(1, 2, sharey=True)
    for axis, law in zip(axes, NAMES, strict=True):
        for source, color, text in (
            ('feedback', ORANGE, 'rates of the point'),
            ('encoder', BLUE, 'rates of the joints'),
        ):
            rows = read(data, 'stability_growth', law=law, velocity_source=source)
            x = column(rows, 'location_m')
            least, most = column(rows, 'least_rate'), column(rows, 'largest_rate')
            axis.fill_between(x, least, most, color=color, alpha=0.25, lw=0)
            axis.plot(x, most, color=color, label=f'{text}, worst pose')
            axis.plot(x, least, color=color, ls=':', label=f'{text}, best pose')
        axis.axhline(0.0, color=BLACK, lw=0.8)
        axis.set(title=NAMES[law], xlabel='point from the shoulder, m', yscale='symlog')
    axes[0].set_ylabel('growth rate of the fastest motion, 1/s')
    axes[0].legend(loc='upper left')
    figure.suptitle('The true point in the loop, no latency: unstable wherever it is above 0')
    return figure
