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
Linear-quadratic regulator with integral action about a planned motion.

The state is (dx, v, I, p): deviation from the plan, the added torque, the
integral of the tip's deviation, and the errors of the model's parameters
(logarithms of EI and density).  The input is v'.  It minimises

    sum of H (w_p |d tip|^2 + w_i |I|^2 + w_u |v|^2 + w_r |v'|^2)

along the plan, by a Riccati recursion backwards in time (Bryson and Ho, Applied
Optimal Control, 1975, section 5.2).  p is constant and not controllable;
its column of the gain is the preview of the effect of a known model error,
to first order, over the rest of the path.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.control.design.model import (
    Arm,
    interval_matrices,
    linearise,
    point_jacobian,
    sensitivity,
)
from flexarm_ros.core.control.design.plan import Grid, Motion
from flexarm_ros.core.numerics.compiled import allocating, FloatArray, internal
from flexarm_ros.core.numerics.linalg import (
    add_outer,
    gains_of_two,
    multiply,
    symmetrise,
    transpose_multiply,
)
from flexarm_ros.core.numerics.records import Records
import numpy as np


class RegulatorWeights(NamedTuple):
    """Weights per m^2, (m s)^2, (N m)^2 and (N m/s)^2."""

    tip: float
    integral: float
    torque: float
    rate: float


@allocating
def place_integral(
    small: FloatArray, small_drive: FloatArray, jacobian: FloatArray, spacing: float,
    transition: FloatArray, drive: FloatArray,
) -> None:  # fmt: skip
    """Expand matrices of (x, v, p) to (x, v, I, p), with I the integral of the tip's deviation."""
    inner = small.shape[0] - 2
    transition[:, :], drive[:, :] = 0.0, 0.0
    transition[:inner, :inner] = small[:inner, :inner]
    transition[:inner, -2:] = small[:inner, inner:]
    drive[:inner, :] = small_drive[:inner, :]
    for c in range(4):
        transition[inner + c, inner + c] = 1.0
    for c in range(2):
        for i in range(jacobian.shape[1]):
            transition[inner + c, i] = spacing * jacobian[c, i]


@internal
def add_stage(
    jacobian: FloatArray, spacing: float, weights: RegulatorWeights, value: FloatArray
) -> None:
    """Add one interval's cost to ``value``."""
    at = 2 * jacobian.shape[1]
    add_outer(jacobian, spacing * weights.tip, value)
    for c in range(2):
        value[at + c, at + c] += spacing * weights.torque
        value[at + 2 + c, at + 2 + c] += spacing * weights.integral


@allocating
def fill_regulator(
    arm: Arm, around: tuple[Records, Records, Records, Records], apart: float,
    weights: RegulatorWeights, grid: Grid, motion: Motion, beyond: int, gains: FloatArray,
) -> None:  # fmt: skip
    """
    Fill ``gains`` (K, 2, 2n + 6) of v' on (dx, v, I, p).

    The recursion starts ``beyond`` intervals after the last, at rest there, so
    that the gains do not decay towards the end.
    """
    count, size = gains.shape[0], motion.state.shape[1]
    both, period = size + 6, grid.substeps * grid.step
    spacing = grid.ticks * period
    jacobian, rows = np.zeros((2, size // 2)), np.zeros((size // 2, size + 4))
    value = np.zeros((both, both))
    small, small_drive = np.zeros((size + 4, size + 4)), np.zeros((size + 4, 2))
    transition, drive = np.zeros((both, both)), np.zeros((both, 2))
    ahead, ahead_drive = np.zeros((both, both)), np.zeros((both, 2))
    cross, inner = np.zeros((2, both)), np.zeros((2, 2))
    lead, change = np.zeros(2), np.zeros(2)
    for place in range(count + beyond - 1, -1, -1):
        j = min(place, count - 1)
        if place < count or place == count + beyond - 1:
            tau1, tau2 = motion.torque[j, 0], motion.torque[j, 1]
            point_jacobian(arm.tip, motion.state[j, : size // 2], jacobian)
            linearise(arm, motion.state[j], tau1, tau2, rows)
            sensitivity(arm, around, apart, motion.state[j], tau1, tau2, rows)
            interval_matrices(rows, grid.ticks, period, small, small_drive)
            place_integral(small, small_drive, jacobian, spacing, transition, drive)
        multiply(value, transition, ahead)
        multiply(value, drive, ahead_drive)
        transpose_multiply(drive, ahead, cross)
        transpose_multiply(drive, ahead_drive, inner)
        for c in range(2):
            inner[c, c] += spacing * weights.rate
        gains_of_two(inner, cross, lead, gains[j], change)
        transpose_multiply(transition, ahead, value)
        for c in range(2):
            for i in range(both):
                for k in range(both):
                    value[i, k] += cross[c, i] * gains[j, c, k]
        symmetrise(value)
        add_stage(jacobian, spacing, weights, value)
