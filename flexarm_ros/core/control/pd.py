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

"""The Jacobian transpose laws: (20), and (21) with the fuzzy gain."""

from __future__ import annotations

from functools import cached_property
import math
from typing import Any

from flexarm_ros.core.arm.kinematics import rigid_point
from flexarm_ros.core.control.feedback import (
    jacobian_torque,
    Point,
    tip_from_encoder,
    tip_from_point,
)
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.control.law import Law, Sample
from flexarm_ros.core.numerics.compiled import bound, compiled
from flexarm_ros.core.numerics.records import record_type
from flexarm_ros.core.parameters.sections import RunConfig
import numpy as np
from numpy.typing import NDArray

_NUMBERS = ('rest', 'length1', 'length2', 'kp', 'kd', 'ks', 'kn', 'torque_limit')
SETTINGS = record_type(
    [(name, '?') for name in ('fuzzy', 'encoder', 'joint_rates')]
    + [(name, 'f8') for name in _NUMBERS]
)
"""
Settings of the laws (20) and (21): whether it is (21), whether the feedback is the encoder's,
whether the tip's velocity is that of the undelayed joints; m beyond the sensed point and of the
links; gains and limit as in a scenario.
"""


def settings_of(config: RunConfig, fuzzy: bool) -> NDArray[np.void]:
    """Return the `SETTINGS` of a scenario, shape ``(1,)``."""
    gains, (length1, length2) = config.controller, config.plant.spans
    rest = max(length1 + length2 - config.tip_sensor.location, 0.0)
    found = (
        fuzzy, gains.feedback == 'encoder', gains.velocity_source == 'encoder', rest, length1,
        length2, gains.kp, gains.kd, gains.ks, gains.kn, gains.torque_limit,
    )  # fmt: skip
    return np.array([found], SETTINGS)


@compiled
def transpose_law(
    settings: NDArray[np.void],
    joints: Point,
    deflection: tuple[float, float],
    encoder: Point,
    tip: Point,
    reference: Point,
) -> tuple[float, float, float]:
    """
    Return tau1, tau2 (N m) and lambda, nan for (20), of the laws (20) and (21).

    ``joints``: theta1, theta2 and their rates of this tick; for the others see
    `flexarm_ros.core.control.law.Sample`.
    """
    law = settings[0]
    th1, th2, dth1, dth2 = joints
    gain, scale = math.nan, 1.0
    if law.fuzzy:
        gain = fls_lambda(deflection[0] / law.kn, deflection[1] / law.kn)
        scale = law.ks * gain
    if law.encoder:
        x, y, vx, vy = tip_from_encoder(law.length1, law.length2, *encoder)
    else:
        x, y, vx, vy = tip_from_point(law.rest, th1, th2, dth1, dth2, *tip)
    if law.joint_rates:
        _, _, vx, vy = rigid_point(law.length1, law.length2, th1, th2, dth1, dth2)
    kp, kd = scale * law.kp, scale * law.kd
    fx = kp * (reference[0] - x) + kd * (reference[2] - vx)
    fy = kp * (reference[1] - y) + kd * (reference[3] - vy)
    tau1, tau2 = jacobian_torque(law.length1, law.length2, th1, th2, fx, fy, law.torque_limit)
    return tau1, tau2, gain


class PdLaw(Law):
    """tau = J^T(theta) [Kp e + Kd e'], equation (20), J at this tick's joint angles."""

    FUZZY = False

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self.settings = settings_of(config, self.FUZZY)

    def retune(self, config: RunConfig) -> None:
        """Use the live gains of ``config`` from the next tick on."""
        super().retune(config)
        self.settings = settings_of(config, self.FUZZY)

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        q, qd = sample.q, sample.qd
        tau1, tau2, self.gain = self._transpose(
            self.settings, (q[0], q[1], qd[0], qd[1]), sample.deflection, sample.encoder,
            sample.tip, sample.reference,
        )  # fmt: skip
        return tau1, tau2

    @cached_property
    def _transpose(self) -> Any:
        four = (0.0,) * 4
        return bound(transpose_law, example=(self.settings, four, (0.0, 0.0), four, four, four))


class FlsLaw(PdLaw):
    """tau = K_s lambda {(20)}, equation (21), lambda from this tick's deflections."""

    FUZZY = True


def fuzzy_gain(config: RunConfig, delta1: float, delta2: float) -> float:
    """Return lambda of (21) for end deflections in m; from 1/6 to 5/6."""
    kn = config.controller.kn
    result: float = fls_lambda(delta1 / kn, delta2 / kn)
    return result
