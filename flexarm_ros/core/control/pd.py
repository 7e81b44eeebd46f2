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

from flexarm_ros.core.control.feedback import jacobian_torque, TipFeedback
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.control.law import Law, Sample
from flexarm_ros.core.parameters.sections import RunConfig


class PdLaw(Law):
    """tau = J^T(theta) [Kp e + Kd e'], equation (20), J at this tick's joint angles."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self._tip = TipFeedback(config)
        self._lengths = config.plant.spans

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        return self._scaled(sample, 1.0)

    def _scaled(self, sample: Sample, scale: float) -> tuple[float, float]:
        gains = self.config.controller
        x, y, vx, vy = self._tip(sample)
        rx, ry, rvx, rvy = sample.reference
        kp, kd = scale * gains.kp, scale * gains.kd
        torque: tuple[float, float] = jacobian_torque(
            *self._lengths, sample.q[0], sample.q[1],
            kp * (rx - x) + kd * (rvx - vx), kp * (ry - y) + kd * (rvy - vy),
            gains.torque_limit,
        )  # fmt: skip
        return torque


class FlsLaw(PdLaw):
    """tau = K_s lambda {(20)}, equation (21), lambda from this tick's deflections."""

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        self.gain = fuzzy_gain(self.config, *sample.deflection)
        return self._scaled(sample, self.config.controller.ks * self.gain)


def fuzzy_gain(config: RunConfig, delta1: float, delta2: float) -> float:
    """Return lambda of (21) for end deflections in m; from 1/6 to 5/6."""
    kn = config.controller.kn
    result: float = fls_lambda(delta1 / kn, delta2 / kn)
    return result
