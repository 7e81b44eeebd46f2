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
The nonminimum-phase response: a torque step at the shoulder with the elbow held.

Everything is linear: the arm about straight links, elbow locked.  The response
of a point is summed over the arm's modes in closed form, zeros are those of
the transfer function from the shoulder's torque to the point's displacement
across the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.stability.modes import LinearArm, linearise
import numpy as np
from scipy.linalg import eig, eigh
from scipy.optimize import brentq
from validation.motion import Array, full_plant
from validation.pictures import BLUE, GREEN, new_figure, ORANGE, PURPLE
from validation.report import Section

WAVE_SPEED = 288.33
"""m/s, (15) of the paper: the speed of longitudinal waves."""

LOCATIONS = (1.0, 2.0, 3.0, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 6.75, 7.0, 7.5, 8.0, 8.5, 9.0)


def held(hub: float, modes: int = 6) -> LinearArm:
    """Return the straight arm with its elbow locked."""
    plant = full_plant(modes=modes, hub_inertia=(hub, 0.0))
    return linearise(RunConfig(plant=plant), 0.0).lock(False, True)


def step_response(arm: LinearArm, location: float, times: Array) -> Array:
    """Return the height (m) of a point after a step of 1 N m at the shoulder."""
    squares, shapes = eigh(arm.stiffness, arm.mass)
    gains = (arm.point(location)[1] @ shapes) * (arm.torque[:, 0] @ shapes)
    response = 0.5 * gains[0] * times**2
    for square, gain in zip(squares[1:], gains[1:], strict=True):
        response = response + gain / square * (1.0 - np.cos(math.sqrt(square) * times))
    return np.asarray(response)


@dataclass(frozen=True)
class Reversal:
    """Lowest height (m a N m), and when the point is back at 0 for good (s)."""

    depth: float
    time: float


def reversal(arm: LinearArm, location: float, step: float = 2e-5) -> Reversal:
    """Return how far and how long a point goes the wrong way; zeros where it does not."""
    times = np.arange(0.0, 1.5, step)
    height = step_response(arm, location, times)
    below = np.flatnonzero(height < 0.0)
    if not len(below):
        return Reversal(0.0, 0.0)
    last = int(below[-1])
    part = height[last] / (height[last] - height[last + 1])
    return Reversal(float(height.min()), float(times[last] + part * step))


def squared_zeros(arm: LinearArm, location: float) -> Array:
    """
    Return the squares of the transfer function's zeros, 1/s^2, complex.

    A negative real square is a pair on the imaginary axis; a positive one a
    pair of real zeros, one of them in the right half plane; a complex one
    belongs to four, two of them there.
    """
    size = len(arm.mass)
    left, right = np.zeros((size + 1, size + 1)), np.zeros((size + 1, size + 1))
    left[:size, :size] = arm.stiffness
    left[:size, size] = -arm.torque[:, 0]
    left[size, :size] = arm.point(location)[1]
    right[:size, :size] = -arm.mass
    values = eig(left, right, right=False)
    return np.asarray(values[np.isfinite(values) & (np.abs(values) < 1e8)])


def right_half_zeros(arm: LinearArm, location: float) -> list[complex]:
    """Return the zeros in the right half plane with imaginary part >= 0, nearest first."""
    zeros = []
    for square in squared_zeros(arm, location):
        root = complex(np.sqrt(complex(square)))
        root = root if root.real > 0.0 else -root
        if root.real > 1e-3 * abs(root) and root.imag >= -1e-6 * abs(root):
            zeros.append(root)
    return sorted(zeros, key=abs)


def first_real_zero(arm: LinearArm, location: float) -> float:
    """Return the lowest real zero in the right half plane, rad/s; inf without one."""
    found = (z.real for z in right_half_zeros(arm, location) if abs(z.imag) < 1e-6 * abs(z))
    return min(found, default=math.inf)


def exact_real_zero(location: float, length: float = 9.0) -> float:
    """
    Return the lowest real zero, rad/s, of a uniform pinned-free beam, without any modes.

    At a real s the solutions of the beam's equation are exp(r x) with
    EI r^4 = -rho s^2; a unit moment acts at x = 0, where w = 0, and the other
    end is free.  The zero is where w(location) changes sign; it does not
    depend on the hub.
    """
    rigidity, density = 1676.0, 0.335

    def height(s: float) -> float:
        unit = (density * s**2 / rigidity) ** 0.25
        roots = unit * np.exp(0.25j * math.pi * np.array([1.0, 3.0, 5.0, 7.0]))
        scale = np.exp(-np.maximum(roots.real, 0.0) * length)  # growing ones from the far end
        far = np.exp(roots * length) * scale
        matrix = np.array([scale, roots**2 * scale, roots**2 * far, roots**3 * far])
        parts = np.linalg.solve(matrix, np.array([0.0, -1.0 / rigidity, 0.0, 0.0]))
        return float(np.sum(parts * scale * np.exp(roots * location)).real)

    grid = np.geomspace(2.0, 5000.0, 4000)
    values = np.array([height(s) for s in grid])
    first = int(np.flatnonzero(values[1:] * values[:-1] < 0.0)[0])
    return float(brentq(height, grid[first], grid[first + 1]))


def _zero(value: complex) -> str:
    return (
        f'{value.real:.1f}'
        if abs(value.imag) < 1e-6 * abs(value)
        else (f'{value.real:.0f} +- {value.imag:.0f}i')
    )


def rigid_height(arm: LinearArm, location: float, times: Array) -> Array:
    """Return the height (m) of the point of the rigid arm after the same step; 0 before it."""
    gain = float(arm.point(location, elastic=False)[1] @ arm.torque[:, 0])
    inertia = float(arm.mass[0, 0])
    return np.asarray(0.5 * gain / inertia * np.maximum(times, 0.0) ** 2)


def paper_misfit(hub: float, location: float, until: float) -> tuple[float, float]:
    """
    Return how far the rigid arm is from the point's height, delayed as in the paper and not.

    Root mean square over the time until ``until`` s, of that of the point's own height.
    """
    arm, times = held(hub), np.arange(0.0, until, 1e-4)
    height = step_response(arm, location, times)
    size = float(np.sqrt(np.mean(height**2)))
    late = rigid_height(arm, location, times - location / WAVE_SPEED)
    prompt = rigid_height(arm, location, times)

    def misfit(rigid: Array) -> float:
        return float(np.sqrt(np.mean((height - rigid) ** 2))) / size

    return misfit(late), misfit(prompt)


def run() -> Section:
    """Compute the tables and the pictures."""
    section = Section('Nonminimum-phase response')
    for hub in (0.0, 8.0):
        _table(section, hub)
    _judge(section)
    _draw_steps(section)
    _draw_places(section)
    section.say(
        "Residual of the paper's model, the delayed motion of the rigid arm, as a description of "
        'the tip (root mean square, relative to that of the height of the tip):'
    )
    rows = []
    for hub in (0.0, 8.0):
        for until in (0.1, 0.3, 1.0):
            late, prompt = paper_misfit(hub, 9.0, until)
            rows.append([f'{hub:g}', until, f'{100.0 * late:.0f} %', f'{100.0 * prompt:.0f} %'])
    section.table(
        ['hub, kg m^2', 'first ... s', 'rigid arm, 31.2 ms late', 'rigid arm, not delayed'], rows
    )
    return section


def _table(section: Section, hub: float) -> None:
    arm, coarse = held(hub), held(hub, 4)
    section.say(
        f'Step of 1 N m at the shoulder, elbow held straight, hub {hub:g} kg m^2, N = 6 '
        '(N = 4): depth of the reversal, time until the point is above 0 for good, zeros in '
        'the right half plane (nearest three), the lowest real one of the exact beam, and the '
        "paper's delay:"
    )
    rows = []
    for location in LOCATIONS:
        fine, rough = reversal(arm, location), reversal(coarse, location)
        zeros = right_half_zeros(arm, location)[:3]
        delay = location / WAVE_SPEED
        rows.append(
            [
                location,
                f'{1e3 * fine.depth:.4f}',
                f'{1e3 * fine.time:.1f} ({1e3 * rough.time:.1f})',
                '; '.join(_zero(zero) for zero in zeros) or 'none',
                f'{exact_real_zero(location):.2f}',
                f'{1e3 * delay:.1f}',
                f'{fine.time / delay:.1f}',
            ]
        )
    section.table(
        ['location, m', 'depth, mm', 'time, ms', 'zeros, rad/s', 'exact', 'delay, ms', 'ratio'],
        rows,
    )


def _judge(section: Section) -> None:
    for modes, places in ((4, (6.75, 9.0)), (6, LOCATIONS[4:])):
        error = max(
            abs(first_real_zero(held(hub, modes), place) / exact_real_zero(place) - 1.0)
            for hub in (0.0, 8.0)
            for place in places
        )
        where = 'at 6.75 and 9 m' if modes == 4 else 'from 4.5 to 9 m'
        section.goal(
            f'Lowest real zero, N = {modes}, sensor {where}, against the exact beam',
            f'{error:.2%}', '1 %', error < 0.01,
        )  # fmt: skip


def _draw_steps(section: Section) -> None:
    arm, times = held(8.0), np.arange(0.0, 0.5, 1e-4)
    figure, axis = new_figure('Step of 1 N m at the shoulder, hub 8 kg m²')
    for location, color in ((4.5, GREEN), (6.75, BLUE), (9.0, ORANGE)):
        height = 1e3 * step_response(arm, location, times)
        axis.plot(1e3 * times, height, color=color, label=f'{location:g} m')
    late = 1e3 * rigid_height(arm, 9.0, times - 9.0 / WAVE_SPEED)
    axis.plot(1e3 * times, late, '--', color=ORANGE, label='9 m, rigid, 31.2 ms late')
    axis.set_ylim(-2.0, 6.0)
    axis.set_xlabel('time, ms')
    axis.set_ylabel('height, mm')
    axis.legend()
    section.picture(
        'steps',
        figure,
        'Heights of three points of the arm after a step of torque at the shoulder',
    )


def _draw_places(section: Section) -> None:
    places = np.arange(4.5, 9.01, 0.1)
    figure, axis = new_figure('Until a point moves the right way for good')
    for hub, color in ((0.0, BLUE), (8.0, GREEN)):
        arm = held(hub)
        times = [1e3 * reversal(arm, float(place), 1e-4).time for place in places]
        axis.plot(places, times, color=color, label=f'the arm, hub {hub:g} kg m²')
    zeros = [1e3 / exact_real_zero(float(place)) for place in places]
    axis.plot(places, zeros, '-.', color=PURPLE, label='1 / lowest real zero')
    delay = 1e3 * places / WAVE_SPEED
    axis.plot(places, delay, '--', color=ORANGE, label="the paper's delay, distance / 288.33 m/s")
    axis.set_xlabel('place of the point along the arm, m')
    axis.set_ylabel('ms')
    axis.legend()
    section.picture(
        'reversal', figure, "Time of the reversal along the arm against the paper's delay"
    )
