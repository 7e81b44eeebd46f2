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


"""
An inertial measurement unit on the bent arm, as a part of a run.

Its frame is fixed to the material of the link: x along the tangent towards the tip, y to the left.
It measures the specific force, which without gravity is the acceleration of its origin in
``base``, and the rate of turn, exactly: from the state of a tick and the accelerations of its
coordinates, under the torques that were held until then.

White noise of density N has the standard deviation N / sqrt(sample interval) per sample, the
random walk of a bias K sqrt(t) after t s: their Allan variances at the averaging time T are
N^2 / T and K^2 T / 3 (IEEE Std 952-1997, annex C).
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any, ClassVar

from flexarm_ros.core.parameters.rig import ImuParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import ACCELERATION, Column, STATE
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Inertial, Signal
from flexarm_ros.core.timeline import Timeline

IMU, FRAME = 'imu/data', 'imu'


def sample_std(held: ImuParameters, period: float) -> tuple[float, float]:
    """Return the standard deviations of a sample's rate of turn and specific force."""
    rate = held.rate or 1.0 / period
    root = math.sqrt(rate)
    return held.gyro_noise_density * root, held.accel_noise_density * root


class ImuPart(Sensor):
    """Rate of turn and specific force of a place on the bent, moving arm."""

    NAME = 'imu'
    Parameters = ImuParameters
    READS: ClassVar[tuple[str, ...]] = (STATE, ACCELERATION)

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the rate of turn about z and the specific force along x and y."""
        held = config.section(cls.NAME) or ImuParameters()
        gyro, accel = sample_std(held, Timeline.of(config.run).period)
        return (Signal(IMU, Inertial(FRAME, gyro * gyro, accel * accel)),)

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the measurements as delivered."""
        units = {'imu_gyro_z': 'rad/s', 'imu_accel_x': 'm/s^2', 'imu_accel_y': 'm/s^2'}
        return tuple(Column(name, IMU, i, unit) for i, (name, unit) in enumerate(units.items()))

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for a place beyond the tip."""
        super().check(config)
        place, reach = config.section(cls.NAME).location, config.plant.reach
        if place is not None and place > reach:
            raise ValueError(
                f'imu.location: {place!r} m, allowed: 0 (shoulder) to {reach:.12g} m (tip)'
            )

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.arm.kinematics import frame_motion, frame_shapes
        from flexarm_ros.core.sensing.noise import Noise
        import numpy as np

        super().__init__(config)
        held: ImuParameters = self.parameters
        place = config.plant.reach if held.location is None else held.location
        self._shapes = frame_shapes(config.plant, place)
        self._motion, self._array = frame_motion, np.array
        self._period = Timeline.of(config.run).period
        self._walk = Noise(config.run.seed, f'{self.NAME}.bias')
        self._bias = [held.gyro_bias, held.accel_bias, held.accel_bias]

    def sample(self, k: int, *inputs: Any) -> Sequence[float]:
        """Return rate of turn and specific force with the biases of tick ``k``."""
        state, acceleration = inputs
        exact = self._motion(state.q, state.qd, self._array(acceleration), *self._shapes)
        if k > 0:
            self._wander()
        return [value + bias for value, bias in zip(exact, self._bias, strict=True)]

    def _wander(self) -> None:
        """Let the biases walk for a tick."""
        held, root = self.parameters, math.sqrt(self._period)
        if held.gyro_bias_walk > 0.0:
            self._bias[0] += held.gyro_bias_walk * root * self._walk.pair()[0]
        if held.accel_bias_walk > 0.0:
            first, second = self._walk.pair()
            self._bias[1] += held.accel_bias_walk * root * first
            self._bias[2] += held.accel_bias_walk * root * second

    def read(self, values: Sequence[float]) -> Sequence[float]:
        """Return the measurement with white noise."""
        gyro, accel = sample_std(self.parameters, self._period)
        rate, x, y = values
        if gyro > 0.0:
            rate += gyro * self.noise.pair()[0]
        if accel > 0.0:
            first, second = self.noise.pair()
            x, y = x + accel * first, y + accel * second
        return rate, x, y
