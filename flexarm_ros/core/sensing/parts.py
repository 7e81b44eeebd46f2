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

"""The required sensors as parts of a run."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import JOINT_STATES, TIP
from flexarm_ros.core.sensing.sensor import Measuring
from flexarm_ros.core.signals import Joints, PlanarPoint, Signal

# A part's implementation is imported when the part is created: every command reads the list of
# parts before it parses its arguments.
if TYPE_CHECKING:
    from flexarm_ros.core.run.state import State
    from flexarm_ros.core.sensing.sensors import Measurement


class EncoderPart(Measuring):
    """The joint encoders."""

    NAME = 'encoder'

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the measured angles and rates."""
        return (Signal(JOINT_STATES, Joints()),)

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import Encoder

        self.sensor = Encoder(config)
        self.channel, self._measure = self.sensor.channel, self.sensor.measure
        self.retune = self.sensor.retune  # type: ignore[method-assign]

    def answer(self, k: int, state: State) -> Measurement:
        """Return stamp, theta1, theta2 and their rates."""
        return self._measure(k, state.positions, state.rates)


class TipSensorPart(Measuring):
    """The sensor of a point of link 2, and those of ``tip_sensor.more_locations``."""

    NAME = 'tip_sensor'
    SHARED = ('location', 'more_locations', 'rate')

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the sensed point that the controller uses."""
        return (cls._signal(config, ''),)

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the points that are only recorded."""
        further = range(1, len(config.tip_sensor.more_locations or ()) + 1)
        return tuple(cls._signal(config, f'_{number}') for number in further)

    @classmethod
    def _signal(cls, config: RunConfig, suffix: str) -> Signal:
        variance = config.tip_sensor.noise_std * config.tip_sensor.noise_std
        return Signal(TIP + suffix, PlanarPoint(f'tip_sensor{suffix}', variance))

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import further_sensors, TipSensor

        self.sensors = (TipSensor(config), *further_sensors(config))
        first = self.sensors[0]
        self.channel, self._measure = first.channel, first.measure
        self._alone = len(self.sensors) == 1

    def answer(self, k: int, state: State) -> Any:
        """Return stamp, x, y, vx, vy; a tuple of such tuples with several sensors."""
        q, qd = state.q, state.qd
        if self._alone:
            return self._measure(k, q, qd)
        return tuple([sensor.measure(k, q, qd) for sensor in self.sensors])

    def retune(self, config: RunConfig) -> None:
        """Apply latency and noise to the sensors."""
        for sensor in self.sensors:
            sensor.retune(config)
