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

Noise is computed from the bits of numpy's PCG64, seeded by ``seed`` and the sensor's name, so it
is the same in every process layout.  NumPy keeps the bit sequence between versions, but not its
normal numbers, which also depend on the C library's logarithm.
"""

from __future__ import annotations

from collections.abc import Sequence
from decimal import Decimal
import math
from typing import NamedTuple

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.numerics.elementary import log
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.sensing.delay import BufferDelay, Line, PadeDelay, Sample4
from flexarm_ros.core.timeline import named_ns, T0_NS, ticks_between, Timeline
import numpy as np

Values = Sequence[float] | FloatArray
Measurement = tuple[int, float, float, float, float]

_BLOCK = 512


class Noise:
    """Pairs of independent standard normal numbers, drawn in order."""

    def __init__(self, seed: int, name: str) -> None:
        sequence = np.random.SeedSequence(seed, spawn_key=tuple(name.encode()))
        self._bits = np.random.PCG64(sequence)
        self._block: list[list[float]] = []

    def pair(self) -> tuple[float, float]:
        """Return the next two numbers of the sequence."""
        while not self._block:
            self._block = self._next_block()[::-1].tolist()
        first, second = self._block.pop()
        return first, second

    def pairs(self, count: int) -> FloatArray:
        """Return the numbers of ``count`` calls of `pair`, shape ``(count, 2)``."""
        blocks = [np.array(self._block[::-1]).reshape(-1, 2)]
        while len(drawn := np.concatenate(blocks)) < count:
            blocks.append(self._next_block())
        self._block = drawn[count:][::-1].tolist()
        return drawn[:count]

    def _next_block(self) -> FloatArray:
        bits = self._bits.random_raw((_BLOCK, 2))
        # The upper 53 bits as a number from -1 to 1, exactly.
        points: FloatArray = (bits >> np.uint64(11)).astype(float) * 2.0**-52 - 1.0
        return points[: make_normal(points)]


@compiled
def make_normal(points: FloatArray) -> int:
    """
    Replace ``points`` ``(n, 2)`` of the square from -1 to 1 by pairs of normal numbers.

    Each point within the unit circle gives a pair (Marsaglia's polar method);
    the pairs come first in ``points``, in order.  Returns their number.
    """
    count = 0
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        square = x * x + y * y
        if 0.0 < square < 1.0:
            factor = math.sqrt(-2.0 * log(square) / square)
            points[count, 0], points[count, 1] = x * factor, y * factor
            count += 1
    return count


class Readout(NamedTuple):
    """
    A sensor for compiled code, as far as encoder and tip sensor are alike.

    ``latency_ns``, ``line``: see `flexarm_ros.core.sensing.delay`; ``every``: ticks between
    samples; ``noise_std``, ``resolution``: see `read_out`.
    """

    latency_ns: int
    line: Line
    every: int
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


@compiled
def _counted(angle: float, resolution: float) -> float:
    """Return the angle rounded to the resolution; halves to even, as in IEEE 754."""
    if abs(angle) < 1e15 * resolution:
        return float(np.rint(angle / resolution) + 0.0) * resolution  # + 0.0: no negative zero
    return angle


class _Latency:
    """A delay line and its latency; stamps are t0 + t_k - latency."""

    def __init__(self, node: str, seconds: float, period_ns: int, model: str) -> None:
        self._key = f'{node}.latency'
        self.ns = named_ns(self._key, seconds)
        self._period_ns = period_ns
        self._line: BufferDelay | PadeDelay
        if model == 'pade2':
            self._line = PadeDelay(period_ns, self.ns)
        else:
            self._line = BufferDelay(period_ns, self.ns)

    def check_seconds(self, seconds: float) -> None:
        latency_ns = named_ns(self._key, seconds)
        if latency_ns > self._line.most_ns:
            raise ValueError(
                f'{self._key}: {seconds!r} s is beyond the {self._line.most_ns * 1e-9:g} s of '
                'history that this run keeps'
            )

    def set_seconds(self, seconds: float) -> None:
        latency_ns = named_ns(self._key, seconds)
        if latency_ns != self.ns:
            try:
                self._line.set_latency_ns(latency_ns)
            except ValueError as error:
                raise ValueError(f'{self._key}: {error}') from None
            self.ns = latency_ns

    def record(self) -> Line:
        return self._line.record()

    def step(self, k: int, a: float, b: float, c: float, d: float) -> tuple[int, Sample4]:
        return T0_NS + k * self._period_ns - self.ns, self._line.step(k, a, b, c, d)


class Encoder:
    """The joint encoders: angles (rad) and rates (rad/s) of theta1 and theta2."""

    def __init__(self, config: RunConfig) -> None:
        parameters = config.encoder
        period_ns = Timeline.of(config.run).period_ns
        self._latency = _Latency('encoder', parameters.latency, period_ns, 'buffer')
        self.noise = Noise(config.run.seed, 'encoder')
        self.resolution, self.noise_std = parameters.resolution, parameters.noise_std
        self.offset = parameters.offset if any(parameters.offset) else None

    def check_latency(self, seconds: float) -> None:
        """Raise ``ValueError`` for a latency that cannot be set during a run."""
        self._latency.check_seconds(seconds)

    def retune(self, config: RunConfig) -> None:
        """
        Use the live parameters of ``config`` from the next tick on.

        Raises ``ValueError`` for a latency longer than the history kept.
        """
        self._latency.set_seconds(config.encoder.latency)
        self.resolution, self.noise_std = config.encoder.resolution, config.encoder.noise_std

    def measure(self, k: int, q: Values, qd: Values) -> Measurement:
        """
        Return stamp_ns, theta1, theta2, dtheta1, dtheta2 as delivered at tick ``k``.

        Call once per tick, in order, with the plant's state of that tick.
        """
        stamp, (a, b, c, d) = self._latency.step(
            k, float(q[0]), float(q[1]), float(qd[0]), float(qd[1])
        )
        if self.noise_std > 0.0 or self.resolution > 0.0:
            pair = self.noise.pair() if self.noise_std > 0.0 else (0.0, 0.0)
            a, b = read_out(a, b, self.noise_std, *pair, self.resolution)
        if self.offset is not None:
            a, b = a + self.offset[0], b + self.offset[1]
        return stamp, a, b, c, d

    def record(self) -> Readout:
        """Return the sensor for compiled code, with the parameters of this tick."""
        latency = self._latency
        return Readout(latency.ns, latency.record(), 1, self.noise_std, self.resolution)


class TipSensor:
    """
    The position sensor ``tip_sensor.location`` m along the arm: x, y, vx, vy in ``base``.

    With ``tip_sensor.rate`` a new sample is delivered every whole number of
    ticks from tick 0 on and held, with its own stamp, until the next.

    ``number`` 0 is the sensor of the loop; 1, 2, ... are those at
    ``tip_sensor.more_locations``, see `further_sensors`.
    """

    def __init__(self, config: RunConfig, number: int = 0) -> None:
        parameters, timeline = config.tip_sensor, Timeline.of(config.run)
        check_location(config)
        places = (parameters.location, *(parameters.more_locations or ()))
        self.point = make_point(config.plant, places[number], parameters.measurand == 'elastic')
        self._latency = _Latency(
            'tip_sensor', parameters.latency, timeline.period_ns, parameters.latency_model
        )
        self.noise = Noise(config.run.seed, f'tip_sensor{number or ""}')
        self._every = ticks_per_sample(parameters.rate, timeline.period_ns)
        self.noise_std = parameters.noise_std
        self.held: Measurement = (0, 0.0, 0.0, 0.0, 0.0)

    def check_latency(self, seconds: float) -> None:
        """Raise ``ValueError`` for a latency that cannot be set during a run."""
        self._latency.check_seconds(seconds)

    def retune(self, config: RunConfig) -> None:
        """
        Use the live parameters of ``config`` from the next tick on.

        Raises ``ValueError`` for a latency longer than the history kept.
        """
        self._latency.set_seconds(config.tip_sensor.latency)
        self.noise_std = config.tip_sensor.noise_std

    def measure(self, k: int, q: FloatArray, qd: FloatArray) -> Measurement:
        """
        Return stamp_ns, x, y, vx, vy of the sensed point as delivered at tick ``k``.

        Call once per tick, in order, with the plant's state of that tick.
        """
        stamp, (x, y, vx, vy) = self._latency.step(k, *self.point(q, qd))
        if k % self._every == 0:
            if self.noise_std > 0.0:
                x, y = read_out(x, y, self.noise_std, *self.noise.pair(), 0.0)
            self.held = (stamp, x, y, vx, vy)
        return self.held

    def record(self) -> Readout:
        """Return the sensor for compiled code, with the parameters of this tick."""
        latency = self._latency
        return Readout(latency.ns, latency.record(), self._every, self.noise_std, 0.0)


def further_sensors(config: RunConfig) -> tuple[TipSensor, ...]:
    """Return the sensors at ``tip_sensor.more_locations``, in that order."""
    count = len(config.tip_sensor.more_locations or ())
    return tuple(TipSensor(config, number) for number in range(1, count + 1))


def ticks_per_sample(rate: float, period_ns: int) -> int:
    """
    Return the whole number of ticks between samples at ``rate`` Hz; 1 for 0.

    Raises ``ValueError`` if it is not an integer, in exact arithmetic.
    """
    return ticks_between('tip_sensor.rate', rate, period_ns)


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
