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
Joint encoder and tip sensor: measurand, latency, noise and resolution.

A sample delivered at tick k is the value at t_k - latency and is stamped with that time of
measurement.  Noise and quantisation belong to that reading, so they are applied to the delayed
value.  They act on positions; rates count as separate ideal measurements (differencing the angles
would give noise of sqrt(2) noise_std / tick on them).

Samples travel through a channel (`flexarm_ros.core.sensing.channel`), which may delay, lose and
hold them; a reading that is held keeps its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
from typing import NamedTuple

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.numerics.compiled import compiled, FloatArray, internal
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.sensing.channel import LatencyChannel
from flexarm_ros.core.sensing.delay import Line
from flexarm_ros.core.sensing.noise import Noise
from flexarm_ros.core.timeline import Timeline
import numpy as np

Values = Sequence[float] | FloatArray
Measurement = tuple[int, float, float, float, float]


class Readout(NamedTuple):
    """
    A sensor for compiled code, as far as encoder and tip sensor are alike.

    ``line``: see `flexarm_ros.core.sensing.delay`; ``noise_std``, ``resolution``: see `read_out`.
    """

    line: Line
    noise_std: float
    resolution: float


@compiled
def read_out(
    a: float, b: float, noise_std: float, first: float, second: float, resolution: float
) -> tuple[float, float]:
    """
    Return the delayed values ``a``, ``b`` as they are read.

    ``first``, ``second``: a pair of `Noise`, not used without noise; ``resolution``: 0 for none.
    """
    if noise_std > 0.0:
        a, b = a + noise_std * first, b + noise_std * second
    if resolution > 0.0:
        a, b = _counted(a, resolution), _counted(b, resolution)
    return a, b


@internal
def _counted(angle: float, resolution: float) -> float:
    """Return the angle rounded to the resolution; halves to even, as in IEEE 754."""
    if abs(angle) < 1e15 * resolution:
        return float(np.rint(angle / resolution) + 0.0) * resolution  # + 0.0: no negative zero
    return angle


class _RequiredSensor:
    """What encoder and tip sensor share: channel, noise, and the reading that is held."""

    resolution = 0.0

    def __init__(
        self, name: str, config: RunConfig, number: int = 0, model: str = 'buffer'
    ) -> None:
        parameters, seed = config.section(name), config.run.seed
        self._name = name
        self.channel = LatencyChannel(
            name, parameters, Timeline.of(config.run), 4, seed, model=model, number=number
        )
        self.noise = Noise(seed, f'{name}{number or ""}')
        self.noise_std: float = parameters.noise_std
        self.held: Measurement = (0, 0.0, 0.0, 0.0, 0.0)

    def retune(self, config: RunConfig) -> None:
        """
        Use the live parameters of ``config`` from the next tick on.

        Raises ``ValueError`` for those that the channel cannot take.
        """
        parameters = config.section(self._name)
        self.channel.retune(parameters)
        self.noise_std = parameters.noise_std

    def follow(self, measurement: Measurement) -> None:
        """Continue after ticks of compiled code, of which ``measurement`` was the last answer."""
        self.held = measurement
        self.channel.follow()

    def record(self) -> Readout:
        """Return the sensor for compiled code, with the parameters of this tick."""
        return Readout(self.channel.record(), self.noise_std, self.resolution)


class Encoder(_RequiredSensor):
    """The joint encoders: angles (rad) and rates (rad/s) of theta1 and theta2."""

    def __init__(self, config: RunConfig) -> None:
        super().__init__('encoder', config)
        self.resolution = config.encoder.resolution
        offset = config.encoder.offset
        self.offset = offset if any(offset) else None

    def retune(self, config: RunConfig) -> None:
        """As `_RequiredSensor.retune`, with the resolution."""
        super().retune(config)
        self.resolution = config.encoder.resolution

    def measure(self, k: int, q: Values, qd: Values) -> Measurement:
        """
        Return stamp_ns, theta1, theta2, dtheta1, dtheta2 as delivered at tick ``k``.

        Call once per tick, in order, with the plant's state of that tick.
        """
        arrived = self.channel.step(k, (q[0], q[1], qd[0], qd[1]))
        if arrived is None:
            return self.held
        stamp, (a, b, c, d) = arrived
        if self.noise_std > 0.0 or self.resolution > 0.0:
            pair = self.noise.pair() if self.noise_std > 0.0 else (0.0, 0.0)
            a, b = read_out(a, b, self.noise_std, *pair, self.resolution)
        if self.offset is not None:
            a, b = a + self.offset[0], b + self.offset[1]
        self.held = (stamp, a, b, c, d)
        return self.held


class TipSensor(_RequiredSensor):
    """
    The position sensor ``tip_sensor.location`` m along the arm: x, y, vx, vy in ``base``.

    With ``tip_sensor.rate`` a new sample is delivered every whole number of
    ticks from tick 0 on and held, with its own stamp, until the next.

    ``number`` 0 is the sensor of the loop; 1, 2, ... are those at
    ``tip_sensor.more_locations``, see `further_sensors`.
    """

    def __init__(self, config: RunConfig, number: int = 0) -> None:
        check_location(config)
        parameters = config.tip_sensor
        super().__init__('tip_sensor', config, number, parameters.latency_model)
        places = (parameters.location, *(parameters.more_locations or ()))
        self.point = make_point(config.plant, places[number], parameters.measurand == 'elastic')

    def measure(self, k: int, q: FloatArray, qd: FloatArray) -> Measurement:
        """
        Return stamp_ns, x, y, vx, vy of the sensed point as delivered at tick ``k``.

        Call once per tick, in order, with the plant's state of that tick.
        """
        arrived = self.channel.step(k, self.point(q, qd))
        if arrived is not None:
            stamp, (x, y, vx, vy) = arrived
            if self.noise_std > 0.0:
                x, y = read_out(x, y, self.noise_std, *self.noise.pair(), 0.0)
            self.held = (stamp, x, y, vx, vy)
        return self.held


def further_sensors(config: RunConfig) -> tuple[TipSensor, ...]:
    """Return the sensors at ``tip_sensor.more_locations``, in that order."""
    count = len(config.tip_sensor.more_locations or ())
    return tuple(TipSensor(config, number) for number in range(1, count + 1))


def check_location(config: RunConfig) -> None:
    """Raise ``ValueError`` for a tip sensor that is not between elbow and tip."""
    # In decimals: 0.7 + 0.1 is 0.8, unlike in binary floating point.
    plant = config.plant
    low, beyond = (
        Decimal(repr(hub)) + Decimal(repr(length)) + Decimal(repr(offset))
        for hub, length, offset in zip(
            plant.hub_radius, plant.length, plant.end_offset, strict=True
        )
    )
    places = [('location', config.tip_sensor.location)]
    places += [('more_locations', place) for place in config.tip_sensor.more_locations or ()]
    for key, place in places:
        location = Decimal(repr(place))
        if not low <= location <= low + beyond:
            raise ValueError(
                f'tip_sensor.{key}: {location} m, allowed: {low} (elbow) to {low + beyond} m (tip)'
            )
