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

"""Figures of the fuzzy logic system: membership functions and the surface of lambda."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.style import (
    AMBER,
    BLACK,
    GREEN,
    GREY,
    new_figure,
    PURPLE,
    styles,
    wrap,
)
from flexarm_ros.analysis.report.runs import labels, number, ReportedRun
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.control.fls_definition import INPUT_SETS, INPUTS, OUTPUT, OUTPUT_SETS
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.run.results.columns import axis_label
import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    Feet = dict[str, tuple[float, float, float]]

DEFAULT_KN = 5.0
"""The paper's normalising gain K_n, m, used if a run's scenario has none."""


def lambda_grid(inputs: Collection[float]) -> FloatArray:
    """Return lambda over normalised deflections, shape ``(n, n)``: row delta2, column delta1."""
    return np.array([[fls_lambda(float(a), float(b)) for a in inputs] for b in inputs])


def gain_kn(runs: Sequence[ReportedRun]) -> float:
    """Return K_n, m, of the first fuzzy run."""
    for run in runs:
        value = number(run.value('controller', 'kn'))
        if run.law == 'fls' and value is not None and value > 0.0:
            return value
    return DEFAULT_KN


def fls_figure(runs: Sequence[ReportedRun]) -> Figure:
    """Return the paper's Figures 2 and 3, lambda's surface, and the part used by fuzzy runs."""
    kn = gain_kn(runs)
    figure = new_figure(9.6, 7.6)
    _draw_inputs(figure.add_subplot(2, 2, 1), kn)
    _draw_output(figure.add_subplot(2, 2, 2))
    _draw_surface(figure, kn)
    _draw_map(figure.add_subplot(2, 2, 4), runs, kn)
    return figure


def sets_figure(which: str, kn: float) -> Figure:
    """Return the paper's Figure 2 (``which``: ``inputs``) or Figure 3 (``output``)."""
    figure = new_figure(4.8, 3.4)
    axis = figure.add_subplot()
    if which == 'inputs':
        _draw_inputs(axis, kn)
    else:
        _draw_output(axis)
    return figure


def _draw_inputs(axis: Axes, kn: float) -> None:
    _draw_sets(axis, INPUT_SETS, kn)
    axis.set(title='Inputs', xlabel='deflection δ₁ or δ₂, m')


def _draw_output(axis: Axes) -> None:
    _draw_sets(axis, OUTPUT_SETS, 1.0)
    axis.set(title='Output', xlabel=axis_label(OUTPUT), xlim=(-0.1, 1.1))


def _draw_sets(axis: Axes, sets: Feet, scale: float) -> None:
    """Draw triangles given by left foot, peak and right foot."""
    looks = ((GREEN, '-'), (PURPLE, '--'), (AMBER, '-.'))
    for (name, feet), (color, style) in zip(sets.items(), looks, strict=False):
        x = [foot * scale for foot in feet]
        axis.plot(x, (_at_foot(feet, 0), 1.0, _at_foot(feet, 2)), color=color, linestyle=style)
        axis.annotate(name, (x[1], 1.0), (0, 4), textcoords='offset points', ha='center',
                      color=color, fontweight='bold')  # fmt: skip
    axis.set_ylim(0.0, 1.12)
    axis.set_ylabel('membership')


def _at_foot(feet: tuple[float, float, float], end: int) -> float:
    """Return the membership at an end of a triangle: 1 if the peak is there."""
    return 1.0 if feet[end] == feet[1] else 0.0


def _draw_surface(figure: Figure, kn: float) -> None:
    import mpl_toolkits.mplot3d  # noqa: F401  (registers the projection)

    inputs = np.linspace(-1.0, 1.0, 41)
    x, y = np.meshgrid(inputs * kn, inputs * kn)
    axis = figure.add_subplot(2, 2, 3, projection='3d')
    axis.plot_surface(
        x, y, lambda_grid(inputs), cmap='viridis', rcount=41, ccount=41, linewidth=0.15,
        edgecolor=(0.0, 0.0, 0.0, 0.35),
    )  # fmt: skip
    across, deep, up = (axis_label(name, symbol=True) for name in (*INPUTS, OUTPUT))
    axis.set(xlabel=across, ylabel=deep, zlabel=up, zlim=(0.0, 1.0))
    axis.set_title('Surface')
    axis.view_init(elev=36.0, azim=-55.0)
    axis.set_box_aspect((1.0, 1.0, 0.7), zoom=1.0)


def _draw_map(axis: Axes, runs: Sequence[ReportedRun], kn: float) -> None:
    """Draw contours of lambda over the part of the universe that the runs use."""
    reach = 0.02 * kn
    for run in runs:
        for name in INPUTS:
            reach = max(reach, float(np.nanmax(np.abs(run.columns[name]), initial=0.0)))
    reach = min(kn, 1.1 * reach)
    inputs = np.linspace(-reach / kn, reach / kn, 81)
    grid = lambda_grid(inputs)
    contours = axis.contour(inputs * kn, inputs * kn, grid, 9, colors=GREY, linewidths=0.8)
    axis.clabel(contours, fontsize=7)
    for run, style, label in zip(runs, styles(runs), labels(runs), strict=True):
        look = {**style.drawn, 'linewidth': 0.6 * style.width}
        axis.plot(*(run.columns[name] for name in INPUTS), label=wrap(label), **look)
    axis.plot(0.0, 0.0, '+', color=BLACK)
    across, up = (axis_label(name, symbol=True) for name in INPUTS)
    axis.set(xlabel=across, ylabel=up)
    axis.set_title('λ where it was used')
    axis.set_aspect('equal')
    if runs:
        axis.legend(loc='upper center', bbox_to_anchor=(0.5, -0.15), fontsize=7)
