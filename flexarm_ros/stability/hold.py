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

"""Parts of a sampled loop as state-space matrices: plant with zero-order hold, delay lines."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.runge_kutta import Tableau, TABLEAUS
from flexarm_ros.core.parameters.rig import ActuatorParameters
from flexarm_ros.core.sensing.delay import pade2_matrices
from flexarm_ros.stability.modes import LinearArm
import numpy as np
from scipy.linalg import expm


def hold_matrices(
    arm: LinearArm, period: float, steps: tuple[int, int] | None = None
) -> tuple[FloatArray, FloatArray]:
    """
    Return A ``(2n, 2n)`` and B ``(2n, 2)`` of one tick of ``period`` s, zero-order-hold torques.

    Exact (Astrom and Wittenmark, Computer-Controlled Systems, 3rd edition,
    section 2.3), or with ``steps`` the result of a Runge-Kutta method of that
    order and that many steps, as the plants compute it: its stability function
    of the continuous matrix times the step.
    """
    return _held(*arm.state_space(), period, steps)


def driven_hold_matrices(
    arm: LinearArm,
    drive: ActuatorParameters | None,
    period: float,
    steps: tuple[int, int] | None = None,
) -> tuple[FloatArray, FloatArray]:
    """
    Return the same from the commanded torques on, with the drives' efficiency and bandwidth.

    The torques of drives with a bandwidth are further states, behind those of the arm.
    """
    if drive is None:
        return hold_matrices(arm, period, steps)
    a, b = arm.state_space()
    rates = 2.0 * np.pi * np.array(drive.bandwidth)
    lagged = [joint for joint in (0, 1) if rates[joint] > 0.0]
    size, more = len(a), len(lagged)
    state, force = np.zeros((size + more, size + more)), np.zeros((size + more, 2))
    state[:size, :size], state[:size, size:] = a, b[:, lagged]
    force[:size] = b * np.array(drive.efficiency)
    for row, joint in enumerate(lagged, start=size):
        state[row, row] = -rates[joint]
        force[:size, joint] = 0.0
        force[row, joint] = rates[joint] * drive.efficiency[joint]
    return _held(state, force, period, steps)


def _held(
    state: FloatArray, force: FloatArray, period: float, steps: tuple[int, int] | None
) -> tuple[FloatArray, FloatArray]:
    size, inputs = force.shape
    whole = np.zeros((size + inputs, size + inputs))
    whole[:size, :size], whole[:size, size:] = state, force
    if steps is None:
        result = expm(whole * period)
    else:
        order, count = steps
        step = _stability_function(TABLEAUS[order], whole * (period / count))
        result = np.linalg.matrix_power(step, count)
    return result[:size, :size], result[:size, size:]


def _stability_function(method: Tableau, z: FloatArray) -> FloatArray:
    """Return the matrix of one step of x' = A x, with ``z`` = h A."""
    one = np.eye(len(z))
    slopes = np.zeros((len(method.b), *z.shape))
    for stage, row in enumerate(method.a):
        slopes[stage] = z @ (one + np.tensordot(row, slopes, 1))
    return np.asarray(one + np.tensordot(method.b, slopes, 1))


@dataclass(frozen=True)
class DelayLine:
    """
    A delay as h+ = a h + b y, delivered = c h + d y.

    For ``w`` channels with l states each: ``a`` ``(l w, l w)``, ``b`` ``(l w, w)``,
    ``c`` ``(w, l w)``, ``d`` ``(w, w)``; channels of equal age are adjacent.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray

    def wide(self, channels: int) -> DelayLine:
        """Return this line of one channel, repeated for ``channels`` channels."""

        def wide(part: FloatArray) -> FloatArray:
            return np.asarray(np.kron(part, np.eye(channels)), dtype=float)

        return DelayLine(wide(self.a), wide(self.b), wide(self.c), wide(self.d))


def line_length(period_ns: int, latency_ns: int) -> int:
    """Return the number of past samples that :func:`buffer_line` holds."""
    return -(-latency_ns // period_ns)


def buffer_line(period_ns: int, latency_ns: int) -> DelayLine:
    """
    Return the one-channel line of :class:`flexarm_ros.core.sensing.delay.BufferDelay`.

    States: the samples of the previous ticks, newest first.  A latency of
    w + p ticks, 0 <= p < 1, weights the samples of age w and w + 1 by 1 - p and p.
    """
    ticks, rest = divmod(latency_ns, period_ns)
    length = line_length(period_ns, latency_ns)
    weights, first = np.zeros((1, length + 1)), np.zeros((length, 1))
    weights[0, ticks] = 1.0 - rest / period_ns
    if rest:
        weights[0, ticks + 1] = rest / period_ns
    first[:1] = 1.0
    return DelayLine(np.eye(length, k=-1), first, weights[:, 1:], weights[:, :1])


def pade_line(period_ns: int, latency_ns: int) -> DelayLine:
    """
    Return the one-channel line of :class:`flexarm_ros.core.sensing.delay.PadeDelay`.

    States: z1, z2 and the last input of the filter.
    """
    if latency_ns == 0:
        return buffer_line(period_ns, 0)
    m = pade2_matrices(period_ns / latency_ns)
    a, b = np.zeros((3, 3)), np.array([[m[0, 3]], [m[1, 3]], [1.0]])
    # The filter's rows are factors of z1, z2, the last and the new input; it gives y - z2.
    a[:2] = m[:, :3]
    return DelayLine(a, b, -a[1:2], 1.0 - b[1:2])
