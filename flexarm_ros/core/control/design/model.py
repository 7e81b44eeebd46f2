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
The controller's model of the arm: nonlinear step, linearisation and tip.

The model is the ``full`` plant with the controller's own parameters
(``controller.model.*``), so that plant and model can differ.
State x (2n,) = (q, q'), n = 2 + 2N; inputs tau1, tau2.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.arm.full.dynamics import acceleration
from flexarm_ros.core.arm.kinematics import elastic_point
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray
from flexarm_ros.core.numerics.linalg import multiply
from flexarm_ros.core.numerics.records import Records
import numpy as np

_TAYLOR = 10
_STEP = 1e-5


class Point(NamedTuple):
    """A material point, as ``elastic_point`` takes it: shapes (3, N + 1), shortening (2, N, N)."""

    shapes: FloatArray
    shortening: FloatArray


class Arm(NamedTuple):
    """
    The model: integrals, their change with EI and density, tip, sensed point, scratch.

    ``rigidity`` and ``density``: d(constants) / d(EI / EI_0) and of the density, on
    the same shape functions, so that constants are linear in both; as flat numbers.
    """

    con: Records
    rigidity: FloatArray
    density: FloatArray
    tip: Point
    sensed: Point
    work: Records


@compiled
def adjust(
    base: FloatArray, rigidity: FloatArray, density: FloatArray, ei: float, rho: float,
    out: FloatArray,
) -> None:  # fmt: skip
    """
    Set ``out`` to ``base`` with EI and density multiplied by 1 + ``ei`` and 1 + ``rho``.

    All are numbers of constants, see :func:`flexarm_ros.core.arm.full.model.floats`.
    """
    for i in range(len(out)):
        out[i] = base[i] + ei * rigidity[i] + rho * density[i]


@allocating
def linearise(arm: Arm, state: FloatArray, tau1: float, tau2: float, rows: FloatArray) -> None:
    """
    Fill ``rows`` (n, 2n + 2), the derivative of q'' with respect to q, q' and the torques.

    Central differences with a step that balances rounding and the third derivative to some
    nine digits.  Nothing depends on theta1.
    """
    n = state.shape[0] // 2
    high, low, at = np.zeros(n), np.zeros(n), state.copy()
    rows[:, 0] = 0.0
    for j in range(1, 2 * n):
        kept = at[j]
        at[j] = kept + _STEP
        acceleration(arm.con, at[:n], at[n:], tau1, tau2, arm.work, high)
        at[j] = kept - _STEP
        acceleration(arm.con, at[:n], at[n:], tau1, tau2, arm.work, low)
        at[j] = kept
        for i in range(n):
            rows[i, j] = (high[i] - low[i]) / (2.0 * _STEP)
    # Affine in the torques: a difference over 1 N m is exact.
    acceleration(arm.con, at[:n], at[n:], tau1, tau2, arm.work, low)
    for j in range(2):
        acceleration(arm.con, at[:n], at[n:], tau1 + (1.0 - j), tau2 + j, arm.work, high)
        for i in range(n):
            rows[i, 2 * n + j] = high[i] - low[i]


@allocating
def sensitivity(
    arm: Arm, around: tuple[Records, Records, Records, Records], change: float,
    state: FloatArray, tau1: float, tau2: float, rows: FloatArray,
) -> None:  # fmt: skip
    """
    Fill the last two columns of ``rows`` (n, 2n + 4): derivatives to log EI and log density.

    ``around``: constants with each of the two lowered and raised by ``change`` / 2.
    """
    n = state.shape[0] // 2
    low, high = np.zeros(n), np.zeros(n)
    q, qd = state[:n], state[n:]
    softer, stiffer, lighter, heavier = around
    acceleration(softer, q, qd, tau1, tau2, arm.work, low)
    acceleration(stiffer, q, qd, tau1, tau2, arm.work, high)
    for i in range(n):
        rows[i, 2 * n + 2] = (high[i] - low[i]) / change
    acceleration(lighter, q, qd, tau1, tau2, arm.work, low)
    acceleration(heavier, q, qd, tau1, tau2, arm.work, high)
    for i in range(n):
        rows[i, 2 * n + 3] = (high[i] - low[i]) / change


@allocating
def discretise(rows: FloatArray, period: float, ad: FloatArray, bd: FloatArray) -> None:
    """
    Fill ``ad`` (2n, 2n) and ``bd`` (2n, c): one tick of ``period`` s with held inputs.

    ``rows`` (n, 2n + c): derivatives of q'' with respect to q, q' and c inputs.  Taylor
    series of the exponential of [[A, B], [0, 0]].
    """
    n = rows.shape[0]
    size, width = 2 * n, rows.shape[1]
    generator = np.zeros((size, size))
    term, following = np.zeros((size, width)), np.zeros((size, width))
    for i in range(n):
        generator[i, n + i] = period
        for j in range(size):
            generator[n + i, j] = period * rows[i, j]
        for j in range(size, width):
            term[n + i, j] = period * rows[i, j]
    for i in range(size):
        term[i, i] = 1.0
    ad[:, :], bd[:, :] = term[:, :size], term[:, size:]
    for order in range(1, _TAYLOR + 1):
        multiply(generator, term, following)
        for i in range(size):
            for j in range(size):
                term[i, j] = following[i, j] / order
                ad[i, j] += term[i, j]
            for j in range(size, width):
                term[i, j] = following[i, j] / (order + 1)
                bd[i, j - size] += term[i, j]


@allocating
def interval_matrices(
    rows: FloatArray, ticks: int, period: float, transition: FloatArray, drive: FloatArray
) -> None:
    """
    Fill ``transition`` (2n + c, 2n + c) and ``drive`` (2n + c, 2) over ``ticks`` ticks.

    Of (x, u, p): ``rows`` (n, 2n + c) has the derivatives of q'' to them, the c
    inputs being the torques u and constants p; ``drive`` is for the torques' rates.
    The torque of a tick is that at its middle, held.
    """
    size, width = 2 * rows.shape[0], rows.shape[1]
    inputs = width - size
    ad, bd = np.zeros((size, size)), np.zeros((size, inputs))
    discretise(rows, period, ad, bd)
    total, following = np.zeros((size, width + 2)), np.zeros((size, width + 2))
    for i in range(size):
        total[i, i] = 1.0
    for tick in range(ticks):
        multiply(ad, total, following)
        time = (tick + 0.5) * period
        for i in range(size):
            for j in range(width + 2):
                total[i, j] = following[i, j]
            for j in range(inputs):
                total[i, size + j] += bd[i, j]
            for j in range(2):
                total[i, width + j] += time * bd[i, j]
    transition[:, :], drive[:, :] = 0.0, 0.0
    transition[:size, :] = total[:, :width]
    drive[:size, :] = total[:, width:]
    for j in range(inputs):
        transition[size + j, size + j] = 1.0
    for j in range(2):
        drive[size + j, j] = ticks * period


@allocating
def point_jacobian(point: Point, q: FloatArray, jacobian: FloatArray) -> tuple[float, float]:
    """
    Fill ``jacobian`` (2, n), the derivative of the point's x, y to q; return x, y.

    From ``elastic_point``, whose velocities are linear in the rates.
    """
    rates = np.zeros(q.shape[0])
    x, y = 0.0, 0.0
    for j in range(q.shape[0]):
        rates[j] = 1.0
        x, y, vx, vy = elastic_point(q, rates, point.shapes, point.shortening)
        rates[j] = 0.0
        jacobian[0, j], jacobian[1, j] = vx, vy
    return x, y
