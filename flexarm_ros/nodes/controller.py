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

"""Node ``controller``: the control law."""

from __future__ import annotations

import copy
from typing import ClassVar

from flexarm_ros.bag.topics import split_state
from flexarm_ros.core.control import make_law, Sample, torque_fault
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.nodes.lockstep import RunFailed
from flexarm_ros.nodes.participant import Participant


class ControllerNode(Participant):
    """Answers each tick with the torque, when it has every input of that tick."""

    ROLE: ClassVar[str] = 'controller'

    def build(self) -> None:
        """Make the law."""
        self._law = make_law(self.config)
        self._tip = self.inputs['tip_sensor/odometry']
        self._encoder = self.inputs['joint_states']
        self._state = self.inputs['plant/state']
        self._reference = self.inputs['reference']
        self._torque = self.outputs['joint_command']
        self._n = 2 + 2 * self.config.plant.modes

    def rehearse(self) -> None:
        """Compile before the run."""
        zeros, four = (0.0,) * self._n, (0.0,) * 4
        copy.deepcopy(self._law).torque(0, Sample(zeros, zeros, (0.0, 0.0), four, four, four))

    def retune(self, config: RunConfig) -> None:
        """Let the law take its gains."""
        self._law.retune(config)

    def advance(self) -> bool:
        """Compute the torque of this tick."""
        if not self.have(self._tip, self._encoder, self._state, self._reference):
            return False
        tick = self.tick
        torque = self._law.torque(tick, self._sample())
        fault = torque_fault(tick, torque)
        if fault is not None:
            raise RunFailed(f'controller ({self.config.controller.law})', fault)
        self._torque.send(self.timeline.stamp_ns(tick), *torque)
        self.tick += 1
        self.check_end()
        self._reference.fetch(self.tick)  # it is here already: taken while the plant has its turn
        return True

    def _sample(self) -> Sample:
        return Sample(
            *split_state(self._state.values, self._n),
            self._encoder.values, self._tip.values, self._reference.values,
        )  # fmt: skip

    def waiting_for(self) -> tuple[str, str]:
        """Blame the plant where there is no state, else the sensor that is silent."""
        if not self._state.fetch(self.tick):
            return 'plant', 'no message on plant/state'
        # Tried in turn: the one that is missing keeps the others from being fetched.
        for entry in self.inputs.values():
            if not entry.fetch(self.tick):
                return entry.source, f'no message on {entry.topic.name}'
        return '', ''

    def patience_s(self) -> float:
        """Speak first of a sensor, but let the plant say itself what holds it up."""
        return 0.0 if self._state.fetch(self.tick) else 0.5
