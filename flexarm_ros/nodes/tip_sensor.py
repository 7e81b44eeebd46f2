"""Node ``tip_sensor``: position and velocity of a point of link 2 in frame base."""

from __future__ import annotations

import copy
from typing import ClassVar

import numpy as np

from flexarm_ros.bag.topics import TIP, per_tick_topics
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.sensors import TipSensor
from flexarm_ros.nodes.participant import Participant


class TipSensorNode(Participant):
    """Answers each plant state with the measured point, late by the latency."""

    ROLE: ClassVar[str] = "tip_sensor"

    def build(self) -> None:
        """Make the sensor."""
        self._sensor = TipSensor(self.config)
        self._state = self.inputs["plant/state"]
        self._measured = self.outputs["tip_sensor/odometry"]
        self._measured.configure(per_tick_topics(self.config)[TIP], self.timeline)
        self._n = 2 + 2 * self.config.plant.modes

    def rehearse(self) -> None:
        """Compile before the run."""
        copy.deepcopy(self._sensor).measure(0, np.zeros(self._n), np.zeros(self._n))

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError for a latency beyond the history that is kept."""
        self._sensor.check_latency(config.tip_sensor.latency)

    def retune(self, config: RunConfig) -> None:
        """Let the sensor take latency and noise; its messages tell the variance."""
        self._sensor.retune(config)
        self._measured.configure(per_tick_topics(config)[TIP], self.timeline)

    def advance(self) -> bool:
        """Measure the state of this tick."""
        if not self.have(self._state):
            return False
        state = np.array(self._state.values)
        n = self._n
        self._measured.send(*self._sensor.measure(self.tick, state[:n], state[n + 2 : 2 * n + 2]))
        self.tick += 1
        self.check_end()
        return True
