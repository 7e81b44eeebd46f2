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
Compiled motion of the arm with its joints between samples, by the plant's own integrator.

A state is ``(q, qd, s)``: joint angles and elastic coordinates (n), their rates (n), and for each
gauge the state of its low-pass (value, rate; 4).
"""

from __future__ import annotations

import math
from typing import Any

from flexarm_ros.core.arm.driven.dynamics import Rig, Scratch, step_driven
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
from flexarm_ros.core.sensing.lowpass import follow
from flexarm_ros.identification.model.driven_motion import IntArray, pass_low, sense
import numpy as np

STRAIN, ANGLE, RATE, ELASTIC = 0, 2, 4, 6
"""First columns of the outputs: gauge signals, joint angles, joint rates, elastic coordinates."""


@allocating
def predict_rows(
    terms: Any,
    rig: Rig,
    scratch: Scratch,
    shapes: FloatArray,
    gauges: FloatArray,
    lowpass: FloatArray,
    torques: FloatArray,
    period: float,
    substeps: int,
    on: IntArray,
    first: int,
    last: int,
    start: FloatArray,
    outputs: FloatArray,
    law: FloatArray,
    rates: FloatArray,
    references: FloatArray,
) -> None:
    """
    Predict samples ``first`` to ``last`` (excluded) from the state ``start``, (2n + 4,).

    ``torques`` (rows, 2): joint torques held from each sample to the next, N m.  ``outputs``
    (rows, 4 + n): the gauges' signals, the joint angles (rad) and their rates, and the elastic
    coordinates.

    ``law`` (2, 8): of each joint the gains on the error of its angle, on deflection, rate and
    deflection rate; limit (0: none), torque per command, resolution of the encoder (rad, 0: none)
    and its offset; without rows the torques are as given, otherwise they are filled.  ``rates``
    (2, 4): the low-pass of the joint angles, as ``lowpass``.  ``references`` (rows, 2), rad.
    """
    n = (start.shape[0] - 4) // 2
    pos, vel = np.zeros(n + 2), np.zeros(n + 2)
    for i in range(n):
        pos[i], vel[i] = start[i], start[n + i]
    for i in range(2):
        pos[n + i], vel[n + i] = start[i], start[n + i]
    # Elastic coordinates in front and low-passes at the end, as the gauges' functions expect.
    state = np.zeros(n + 2)
    state[n - 2 :] = start[2 * n :]
    held, before = np.zeros(2), np.zeros(2)
    angle = np.zeros((2, 3))
    for j in range(law.shape[0]):
        angle[j, 0], angle[j, 1] = start[j] + law[j, 7], start[n + j]
        angle[j, 2] = angle[j, 0]
    for k in range(first, last):
        for i in range(n - 2):
            state[i] = pos[2 + i]
        sense(shapes, gauges, pos, state, before, outputs[k])
        for i in range(2):
            outputs[k, ANGLE + i], outputs[k, RATE + i] = pos[i], vel[i]
        outputs[k, ELASTIC:] = pos[2:n]
        if k == last - 1:
            break
        if law.shape[0] > 0:
            control(law, rates, references[k], pos, outputs[k], state, angle, torques[k])
        held[0], held[1] = torques[k, 0], torques[k, 1]
        step_driven(terms, rig, pos, vel, held, torques[k], period / substeps, substeps, scratch)
        for i in range(n - 2):
            state[i] = pos[2 + i]
        pass_low(shapes, gauges, lowpass, pos, state, before, on, k)


@compiled
def control(
    law: FloatArray,
    rates: FloatArray,
    reference: FloatArray,
    pos: FloatArray,
    output: FloatArray,
    state: FloatArray,
    angle: FloatArray,
    torque: FloatArray,
) -> None:
    """
    Fill the torques (2,) of joint state feedback, N m.

    ``angle`` (2, 3): low-pass of each joint angle, its rate, and the last reading.
    """
    low = state.shape[0] - 4
    for j in range(2):
        seen = read_encoder(law[j], pos[j])
        follow(rates, angle[j], angle[j, 2], seen)
        angle[j, 2] = seen
        bend_rate = state[low + 2 * j + 1]
        torque[j] = command(law[j], reference[j], seen, angle[j, 1], output[j], bend_rate)


@internal
def read_encoder(law: FloatArray, angle: float) -> float:
    """Return what an encoder reads at an angle, rad."""
    resolution: float = law[6]
    if resolution > 0.0:
        angle = math.floor(angle / resolution + 0.5) * resolution
    return angle + float(law[7])


@compiled
def command(
    law: FloatArray, reference: float, angle: float, rate: float, bend: float, bend_rate: float
) -> float:
    """Return the torque of joint state feedback, N m."""
    current: float = (
        law[0] * (reference - angle) - law[1] * bend - law[2] * rate - law[3] * bend_rate
    )
    if law[4] > 0.0:
        current = min(max(current, -law[4]), law[4])
    return current * float(law[5])
