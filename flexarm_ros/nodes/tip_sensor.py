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

"""Node ``tip_sensor``: position and velocity of a point of link 2 in frame base."""

from __future__ import annotations

import copy
from typing import ClassVar

from flexarm_ros.bag.topics import per_tick_topics, split_state
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.sensors import further_sensors, TipSensor
from flexarm_ros.nodes.participant import Participant
import numpy as np


class TipSensorNode(Participant):
    """
    Answers each plant state with the measured point, late by the latency.

    Those at ``tip_sensor.more_locations`` answer behind it, when the loop has its own.
    """

    ROLE: ClassVar[str] = 'tip_sensor'

    def build(self) -> None:
        """Make the sensors."""
        self._sensors = (TipSensor(self.config), *further_sensors(self.config))
        self._state = self.inputs['plant/state']
        self._measured = list(self.outputs.values())
        self._configure(self.config)
        self._n = 2 + 2 * self.config.plant.modes

    def rehearse(self) -> None:
        """Compile before the run."""
        for sensor in copy.deepcopy(self._sensors):
            sensor.measure(0, np.zeros(self._n), np.zeros(self._n))

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError for a latency beyond the history that is kept."""
        self._sensors[0].check_latency(config.tip_sensor.latency)

    def retune(self, config: RunConfig) -> None:
        """Let the sensors take latency and noise; their messages tell the variance."""
        for sensor in self._sensors:
            sensor.retune(config)
        self._configure(config)

    def _configure(self, config: RunConfig) -> None:
        for topic in per_tick_topics(config):
            if topic.name in self.outputs:
                self.outputs[topic.name].configure(topic, self.timeline)

    def advance(self) -> bool:
        """Measure the state of this tick."""
        if not self.have(self._state):
            return False
        q, qd, _ = split_state(np.array(self._state.values), self._n)
        for sensor, output in zip(self._sensors, self._measured, strict=True):
            output.send(*sensor.measure(self.tick, q, qd))
        self.tick += 1
        self.check_end()
        return True
