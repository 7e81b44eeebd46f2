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

"""Joint state feedback, linearised about rest: its low-passes and gains."""

from __future__ import annotations

import math

from flexarm_ros.core.control.law import law_period
from flexarm_ros.core.control.state_feedback import StateFeedbackParameters
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.stability.form import LinearLaw
from flexarm_ros.stability.modes import LinearArm
import numpy as np

_ENCODER, _DEFLECTION = -10, -2
"""First column of the encoder's angles and of the deflections among 2 n + 10 inputs."""


def state_feedback_form(config: RunConfig, arm: LinearArm, _time: float | None) -> LinearLaw:
    """
    Return the law within the limit of its current; one step per torque.

    States: of each joint value and rate of the low-pass of its angle, then of its deflection.
    """
    keys: StateFeedbackParameters = config.controller.own()
    period, inputs = law_period(config), 2 * len(arm.mass) + 10
    cutoffs = (keys.rate_cutoff, keys.deflection_cutoff)
    (angle, angle_in), (bend, bend_in) = (
        lowpass_form(cutoff, keys.filter_damping, period) for cutoff in cutoffs
    )
    a, b = np.zeros((8, 8)), np.zeros((8, inputs))
    c, d = np.zeros((2, 8)), np.zeros((2, inputs))
    for j, length in enumerate(config.plant.length):
        first, second = slice(4 * j, 4 * j + 2), slice(4 * j + 2, 4 * j + 4)
        a[first, first], b[first, _ENCODER + j] = angle, angle_in
        a[second, second], b[second, _DEFLECTION + j] = bend, bend_in / length
        of_angle = -keys.torque_constant[j] * np.array([0.0, keys.rate[j]])
        gains = np.array([keys.deflection[j], keys.deflection_rate[j]])
        of_bend = -keys.torque_constant[j] * gains
        # The torque reads the low-passes after their step.
        c[j, first], c[j, second] = of_angle @ angle, of_bend @ bend
        d[j, _ENCODER + j] = of_angle @ angle_in - keys.torque_constant[j] * keys.angle[j]
        d[j, _DEFLECTION + j] = of_bend @ bend_in / length
    return LinearLaw(a, b, c, d)


def lowpass_form(cutoff: float, damping: float, period: float) -> tuple[FloatArray, FloatArray]:
    """
    Return a ``(2, 2)`` and b ``(2,)`` of `flexarm_ros.core.control.state_feedback.LowPass`.

    Value and rate after a step from those before and the signal; ``cutoff``, Hz, ``period``, s.
    """
    omega = 2.0 * math.pi * cutoff
    drag = 1.0 + 2.0 * damping * omega * period
    pull = np.array([period * omega, omega]) * (period * omega / drag)
    a = np.array([[1.0, period / drag], [0.0, 1.0 / drag]])
    a[:, 0] -= pull
    return a, pull
