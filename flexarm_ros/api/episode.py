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

"""The arm, its sensors and its task for one episode; does not need Gymnasium."""

from __future__ import annotations

from typing import Any

from flexarm_ros.api.pictures import frame
from flexarm_ros.api.simulation import configure, Scenario
from flexarm_ros.core.arm.arm_line import ArmLine
from flexarm_ros.core.arm.kinematics import rigid_point
from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.parts import signals
from flexarm_ros.core.run.required_parts import PlantPart
from flexarm_ros.core.sensing.sensors import Encoder, TipSensor
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import Reference
from flexarm_ros.scenario import ScenarioError
import numpy as np
from numpy.typing import NDArray

FIXED = ('scenario', 'torques')
"""Arguments of `configure` that an environment or an episode may not change."""


def changed(scenario: Scenario, changes: dict[str, Any]) -> RunConfig:
    """Return the scenario with the changes; ``ScenarioError`` for those that are not possible."""
    for name in changes:
        if name in FIXED:
            raise ScenarioError(f'{name}: cannot be changed here; the agent sets the torques')
    config = configure(scenario, **changes)
    inputs = PlantPart.reads(config)
    for part, signal in signals(config):
        if part.Parameters is not None and signal.name in inputs:
            raise ScenarioError(f'{part.NAME}: not available in an environment; leave it out')
    return config


class Episode:
    """
    A scenario's closed loop without its controller.

    ``tick`` of ``ticks`` are completed; ``unstable`` is the reason of instability, or None.
    """

    def __init__(self, config: RunConfig) -> None:
        timeline = Timeline.of(config.run)
        self.tick, self.ticks = 0, timeline.ticks
        self.unstable: str | None = None
        self._period, self._config = timeline.period, config
        self._plant, self._reference = make_plant(config), Reference(config)
        self._encoder, self._tip = Encoder(config), TipSensor(config)
        self._measure()

    @property
    def limit(self) -> float:
        """Return the larger ``plant.deflection_limit``, m."""
        return max(self._plant.limits)

    @property
    def over(self) -> bool:
        """Return whether every tick is completed."""
        return self.tick >= self.ticks

    @property
    def ended(self) -> bool:
        """Return whether the episode has ended: all ticks completed, or the arm unstable."""
        return self.over or self.unstable is not None

    def advance(self, torques: FloatArray, ticks: int) -> list[float]:
        """Hold the torques ``(2,)``, N m; return the tracking error, m, after each stable tick."""
        tau1, tau2 = (float(torque) for torque in torques)
        errors: list[float] = []
        for _ in range(min(ticks, self.ticks - self.tick)):
            self._plant.step(tau1, tau2)
            self.tick += 1
            self.unstable = instability(self._plant)
            if self.unstable is not None:
                break
            self._measure()
            errors.append(self._error())
        return errors

    def observe(self) -> FloatArray:
        """Return the observation, shape ``(14,)``, always finite."""
        ends = self._plant.deflections()[:2]
        values = np.array([*self._held, *self._reference.command(self.tick), *ends])
        return np.asarray(np.nan_to_num(values))

    def picture(self) -> NDArray[np.uint8]:
        """Return an image of the arm and its reference, shape ``(480, 480, 3)``."""
        line = ArmLine(self._config.plant)
        points = np.nan_to_num(np.array(line.at(self._plant.q, self._plant.qd)))
        target = np.array(self._reference.at(self.tick)[:2])
        title = f't = {self.tick * self._period:.3f} s'
        return frame(points, line.elbow, target, self._config.plant.reach, title)

    def _measure(self) -> None:
        """Sample the sensors, exactly once per tick."""
        q, qd = self._plant.q, self._plant.qd
        encoder, tip = self._encoder.measure(self.tick, q, qd), self._tip.measure(self.tick, q, qd)
        self._held = (*encoder[1:], *tip[1:])

    def _error(self) -> float:
        """Return the distance of the rigid end effector from the undelayed reference, m."""
        th1, th2 = self._plant.q[0], self._plant.q[1]
        x, y, _, _ = rigid_point(*self._config.plant.spans, th1, th2, 0.0, 0.0)
        target = self._reference.at(self.tick)
        return float(np.hypot(x - target[0], y - target[1]))
