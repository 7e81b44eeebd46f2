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

"""Node ``encoder``: joint angles and rates as the joint encoders deliver them."""

from __future__ import annotations

import copy
from typing import ClassVar

from flexarm_ros.bag.topics import split_state
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.sensors import Encoder
from flexarm_ros.nodes.participant import Participant


class EncoderNode(Participant):
    """Answers each plant state with the measured angles, late by the latency."""

    ROLE: ClassVar[str] = 'encoder'

    def build(self) -> None:
        """Make the encoder."""
        self._encoder = Encoder(self.config)
        self._state = self.inputs['plant/state']
        self._measured = self.outputs['joint_states']
        self._n = 2 + 2 * self.config.plant.modes

    def rehearse(self) -> None:
        """Compile before the run."""
        copy.deepcopy(self._encoder).measure(0, [0.0] * self._n, [0.0] * self._n)

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError for a latency beyond the history that is kept."""
        self._encoder.check_latency(config.encoder.latency)

    def retune(self, config: RunConfig) -> None:
        """Let the encoder take latency, resolution and noise."""
        self._encoder.retune(config)

    def advance(self) -> bool:
        """Measure the state of this tick."""
        if not self.have(self._state):
            return False
        q, qd, _ = split_state(self._state.values, self._n)
        self._measured.send(*self._encoder.measure(self.tick, q, qd))
        self.tick += 1
        self.check_end()
        return True
