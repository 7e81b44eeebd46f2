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

"""PD about the joints: a law with two parameters of its own."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.control import Law, Sample
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.parameters.spec import parameter
from flexarm_ros.stability.form import LinearLaw
from flexarm_ros.stability.modes import LinearArm
import numpy as np


@dataclass(frozen=True)
class Gains:
    """Keys ``controller.joint_pd.stiffness`` and ``controller.joint_pd.damping``."""

    stiffness: float = parameter(
        1200.0, 'float', 'N m/rad', 'stiffness of both joints', low=0.0, high=1e6, live=True
    )
    damping: float = parameter(
        300.0, 'float', 'N m s/rad', 'damping of both joints', low=0.0, high=1e6, live=True
    )


class JointPd(Law):
    """Hold the joints at the first measured angles."""

    Parameters = Gains

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self._goal: tuple[float, float] | None = None

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2, N m."""
        theta1, theta2, rate1, rate2 = sample.encoder
        if self._goal is None:
            self._goal = theta1, theta2
        gains = self.parameters
        return (
            gains.stiffness * (self._goal[0] - theta1) - gains.damping * rate1,
            gains.stiffness * (self._goal[1] - theta2) - gains.damping * rate2,
        )

    @classmethod
    def linear_form(cls, config: RunConfig, arm: LinearArm) -> LinearLaw:
        """Return tau = -stiffness theta - damping theta'; columns q, q', encoder, tip."""
        gains = config.controller.own()
        feedback = np.zeros((2, 2 * len(arm.mass) + 8))
        feedback[:, -8:-6] = -gains.stiffness * np.eye(2)
        feedback[:, -6:-4] = -gains.damping * np.eye(2)
        return LinearLaw.static(feedback)
