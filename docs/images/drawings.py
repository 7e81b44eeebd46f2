#!/usr/bin/env python3
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

"""Draw the arm and the loop, the paper's Figures 1 and 4, into this directory."""

from __future__ import annotations

from pathlib import Path

from flexarm_ros.analysis.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    METADATA,
    ORANGE,
    SETTINGS,
)
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, FancyBboxPatch
import numpy as np

VIOLET = '#7B3F8C'
HERE = Path(__file__).resolve().parent
TH1, TH2, BEND = np.radians(25.0), np.radians(40.0), (0.55, -0.45)
LENGTH = 4.5


def link(start: np.ndarray, angle: float, bend: float) -> tuple[np.ndarray, float]:
    """Return points of a bent link, shape (n, 2), and the angle of its end's tangent."""
    x = np.linspace(0.0, 1.0, 60)
    w = bend * (3.0 * x**2 - x**3) / 2.0
    along, left = (
        np.array([np.cos(angle), np.sin(angle)]),
        np.array([-np.sin(angle), np.cos(angle)]),
    )
    points = start + LENGTH * np.outer(x, along) + np.outer(w, left)
    return points, angle + np.arctan(1.5 * bend / LENGTH)


def angle_mark(axis: Axes, at: np.ndarray, start: float, end: float, text: str) -> None:
    """Mark an angle with an arc and its name."""
    axis.add_patch(Arc(tuple(at), 2.6, 2.6, theta1=np.degrees(start), theta2=np.degrees(end),
                       color=BLACK, linewidth=1.0))  # fmt: skip
    middle = (start + end) / 2.0
    axis.text(*(at + 1.65 * np.array([np.cos(middle), np.sin(middle)])), text, ha='center',
              va='center')  # fmt: skip


def tangent(axis: Axes, at: np.ndarray, angle: float, length: float) -> np.ndarray:
    """Draw a tangent line and return its end."""
    end = at + length * np.array([np.cos(angle), np.sin(angle)])
    axis.plot(*np.transpose([at, end]), color=GREY, linewidth=0.9, linestyle=(0, (5, 3)))
    return end


def draw_arm() -> Figure:
    """Return the arm with its coordinates."""
    figure = Figure(figsize=(6.4, 4.4), layout='constrained')
    axis = figure.add_subplot()
    origin = np.zeros(2)
    first, turned = link(origin, TH1, BEND[0])
    elbow = first[-1]
    second, _ = link(elbow, turned + TH2, BEND[1])
    tip = second[-1]
    tangent(axis, origin, 0.0, 3.2)
    ends = tangent(axis, origin, TH1, LENGTH), tangent(axis, elbow, turned + TH2, LENGTH)
    tangent(axis, elbow, turned, 2.6)
    axis.plot(*first.T, color=BLUE, linewidth=4.0, solid_capstyle='round')
    axis.plot(*second.T, color=GREEN, linewidth=4.0, solid_capstyle='round')
    for end, point, name in zip(ends, (elbow, tip), (r'$\delta_1$', r'$\delta_2$'), strict=True):
        axis.annotate('', tuple(point), tuple(end),
                      arrowprops={'arrowstyle': '->', 'color': ORANGE, 'lw': 1.8})  # fmt: skip
        side = 0.35 * (end - point) / np.linalg.norm(end - point)
        axis.text(*(end + side), name, color=ORANGE, ha='center', va='center', fontsize=12)
    angle_mark(axis, origin, 0.0, TH1, r'$\theta_1$')
    angle_mark(axis, elbow, turned, turned + TH2, r'$\theta_2$')
    axis.plot(*origin, 'o', color=BLACK, markersize=9)
    axis.plot(*elbow, 'o', color=BLACK, markersize=7)
    axis.plot(*tip, 'D', color=VIOLET, markersize=7)
    axis.text(-0.1, -0.45, r'base, hub, $\tau_1$', ha='center', va='top')
    axis.text(elbow[0] + 0.45, elbow[1], r'elbow, $\tau_2$', va='center')
    axis.text(tip[0] + 0.25, tip[1], 'tip, sensor at 9 m', color=VIOLET, va='center')
    axis.set(xlim=(-1.3, 9.4), ylim=(-1.2, 6.9), aspect='equal')
    axis.set_axis_off()
    return figure


def box(axis: Axes, x: float, y: float, text: str, color: str = BLACK) -> None:
    """Draw a block, its middle at x, y."""
    axis.add_patch(FancyBboxPatch((x - 0.85, y - 0.32), 1.7, 0.64, boxstyle='round,pad=0.04',
                                  facecolor='white', edgecolor=color, linewidth=1.4))  # fmt: skip
    axis.text(x, y, text, ha='center', va='center', fontsize=8.5, color=color)


def wire(
    axis: Axes, points: list[tuple[float, float]], text: str, at: tuple[float, float]
) -> None:
    """Draw an arrow along points, and what it carries."""
    x, y = zip(*points, strict=True)
    axis.plot(x, y, color=BLACK, linewidth=1.0)
    axis.annotate('', points[-1], points[-2], arrowprops={'arrowstyle': '-|>', 'color': BLACK})
    axis.text(*at, text, ha='center', va='bottom', fontsize=8)


def draw_loop() -> Figure:
    """Return the control loop, block by block."""
    figure = Figure(figsize=(8.2, 3.5), layout='constrained')
    axis = figure.add_subplot()
    box(axis, 1.0, 2.0, 'trajectory')
    box(axis, 4.2, 2.0, 'controller\n' + r'$\mathbf{J}^T[\mathbf{K}_p e + \mathbf{K}_d \dot e]$')
    box(axis, 7.6, 2.0, 'plant (14)')
    box(axis, 4.2, 3.2, r'FLS: $K_s\,\lambda(\delta_1, \delta_2)$', ORANGE)
    box(axis, 5.9, 1.15, 'encoder', BLUE)
    box(axis, 5.9, 0.25, 'tip sensor, delay', VIOLET)
    wire(axis, [(1.9, 2.0), (3.3, 2.0)], r'$x_c, y_c$', (2.6, 2.04))
    wire(axis, [(5.1, 2.0), (6.7, 2.0)], r'$\tau_1, \tau_2$', (5.9, 2.04))
    wire(axis, [(7.6, 2.36), (7.6, 3.2), (5.1, 3.2)], r'$\delta_1, \delta_2$', (6.4, 3.24))
    wire(axis, [(4.2, 2.84), (4.2, 2.36)], r'$\lambda$', (4.4, 2.5))
    wire(axis, [(7.6, 1.64), (7.6, 1.15), (6.8, 1.15)], r'$q, \dot q$', (7.9, 1.3))
    wire(axis, [(7.6, 1.15), (7.6, 0.25), (6.8, 0.25)], '', (7.6, 0.6))
    wire(axis, [(5.0, 1.15), (4.4, 1.15), (4.4, 1.64)], r'$\theta, \dot\theta$', (4.7, 1.19))
    wire(axis, [(5.0, 0.25), (3.9, 0.25), (3.9, 1.64)], r'$x, y$', (4.4, 0.29))
    axis.text(2.3, 0.75, 'controller.feedback takes one:\nencoder (collocated) or\ntip sensor'
              ' (noncollocated)', ha='center', va='center', fontsize=8, color=GREY)  # fmt: skip
    axis.set(xlim=(0.0, 8.7), ylim=(-0.2, 3.7))
    axis.set_axis_off()
    return figure


def main() -> None:
    """Write arm.svg and loop.svg beside this file."""
    with rc_context(SETTINGS):
        for name, draw in (('arm', draw_arm), ('loop', draw_loop)):
            draw().savefig(HERE / f'{name}.svg', metadata=METADATA['svg'])


if __name__ == '__main__':
    main()
