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
When each sample of a channel arrives: jitter, loss and order.

It depends on the seed, the name of the channel, its parameters and the number of samples sent
before, never on the data.  Losses and latencies are drawn from streams of their own, one number of
each per sample, so that a change of one does not change the other.

Losses: independent with probability p; or with a mean of b in a row, the two-state Markov chain
of Gilbert (Bell System Technical Journal 39, 1960) whose bad state loses every sample: it is left
with probability 1 / b and entered with p / (b (1 - p)), so that a fraction p is lost.

The numbers are computed from the bits of numpy's PCG64 by functions of this package, as those of
`flexarm_ros.core.sensing.noise`, for the reason given there.
"""

from __future__ import annotations

from flexarm_ros.core.numerics.elementary import log
from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.sensing.noise import Noise, Uniform
from flexarm_ros.core.timeline import named_ns, NS_PER_S


class Losses:
    """Which samples are lost."""

    def __init__(self, seed: int, name: str) -> None:
        self._draw = Uniform(seed, f'{name}.dropout')
        self._bad: bool | None = None

    def lost(self, dropout: float, burst: float) -> bool:
        """Return whether the next sample is lost; see `ChannelParameters` and `check_burst`."""
        drawn = self._draw()
        if burst == 1.0 or self._bad is None:
            limit = dropout
        elif self._bad:
            limit = 1.0 - 1.0 / burst
        else:
            limit = dropout / (burst * (1.0 - dropout))
        self._bad = drawn < limit
        return self._bad


class Latencies:
    """The latency of each sample."""

    def __init__(self, seed: int, name: str, parameters: ChannelParameters) -> None:
        self._measured = [round(s * NS_PER_S) for s in parameters.latencies or ()]
        self._count = 0
        self._extra = _DISTRIBUTIONS[parameters.jitter_distribution](seed, f'{name}.jitter')

    def next_ns(self, latency_ns: int, jitter: float) -> int:
        """Return the latency of the next sample, ns."""
        if self._measured:
            place, self._count = self._count, (self._count + 1) % len(self._measured)
            return self._measured[place]
        return max(0, latency_ns + round(self._extra() * jitter * NS_PER_S))


class Normal:
    """Standard normal numbers, drawn in order."""

    def __init__(self, seed: int, name: str) -> None:
        self._noise = Noise(seed, name)
        self._left: list[float] = []

    def __call__(self) -> float:
        """Return the next number of the sequence."""
        if not self._left:
            self._left = [*self._noise.pair()][::-1]
        return self._left.pop()


class Exponential:
    """Exponentially distributed numbers of mean 1, drawn in order."""

    def __init__(self, seed: int, name: str) -> None:
        self._draw = Uniform(seed, name)

    def __call__(self) -> float:
        """Return the next number of the sequence."""
        return float(-log(1.0 - self._draw()))


_DISTRIBUTIONS: dict[str, type[Uniform | Normal | Exponential]] = {
    'uniform': Uniform, 'exponential': Exponential, 'normal': Normal,
}  # fmt: skip


class Schedule:
    """
    Arrival of the samples that one channel sends, in the order of sending.

    ``period_ns``: length of a tick.
    """

    def __init__(
        self, seed: int, name: str, parameters: ChannelParameters, period_ns: int
    ) -> None:
        self._losses, self._latencies = Losses(seed, name), Latencies(seed, name, parameters)
        self._period_ns, self._last = period_ns, 0
        self._key = f'{name}.latency'
        self.retune(parameters)

    def retune(self, parameters: ChannelParameters) -> None:
        """Take latency, jitter and loss of the samples sent from now on."""
        self._jitter, self._dropout = parameters.jitter, parameters.dropout
        self._burst, self._ordered = parameters.dropout_burst, parameters.arrival == 'in_order'
        self._latency_ns = named_ns(self._key, parameters.latency)

    def send(self, k: int, before_ns: int = 0) -> int | None:
        """
        Return the first tick at which a sample has arrived; None if it is lost.

        It is sent at tick ``k`` and was measured ``before_ns``, less than a tick, before that.
        """
        lost = self._losses.lost(self._dropout, self._burst)
        latency_ns = self._latencies.next_ns(self._latency_ns, self._jitter)
        if lost:
            return None
        arrival = k - (before_ns - latency_ns) // self._period_ns
        if self._ordered:
            arrival = self._last = max(arrival, self._last)
        return arrival
