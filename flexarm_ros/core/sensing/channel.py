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

"""The way of a sensor's samples to the receiver, the same for every sensor."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

from flexarm_ros.core.sensing.delay import BufferDelay, CHANNELS
from flexarm_ros.core.timeline import named_ns, T0_NS, Timeline


class Channel(Protocol):
    """The way of a sample from its measurement to the receiver; it has memory."""

    def step(self, k: int, sample: Sequence[float]) -> tuple[int, list[float]]:
        """Take the sample of tick ``k``; return stamp (ns) and values that the receiver has."""

    def check(self, parameters: Any) -> None:
        """Raise ``ValueError`` for live parameters that cannot be taken during a run."""

    def retune(self, parameters: Any) -> None:
        """Take the live parameters from the next tick on."""


class LatencyChannel:
    """
    A constant latency, the key ``latency`` of the sensor's section, s.

    The sample at tick k is the value at t_k - latency, linear between ticks, stamped with that
    time.  Without the key there is no latency.
    """

    def __init__(self, name: str, parameters: Any, timeline: Timeline, width: int) -> None:
        self._key, self._period_ns = f'{name}.latency', timeline.period_ns
        self._ns = self._wanted(parameters)
        lines = -(-width // CHANNELS)
        self._lines = [BufferDelay(timeline.period_ns, self._ns) for _ in range(lines)]
        self._width, self._padding = width, (0.0,) * (lines * CHANNELS - width)

    def _wanted(self, parameters: Any) -> int:
        return named_ns(self._key, getattr(parameters, 'latency', 0.0))

    def check(self, parameters: Any) -> None:
        """Raise ``ValueError`` for a latency beyond the history that is kept."""
        most_ns = self._lines[0].most_ns
        if self._wanted(parameters) > most_ns:
            raise ValueError(
                f'{self._key}: {parameters.latency!r} s is beyond the {most_ns * 1e-9:g} s of '
                'history that this run keeps'
            )

    def retune(self, parameters: Any) -> None:
        """Take the latency from the next tick on."""
        self.check(parameters)
        self._ns = self._wanted(parameters)
        for line in self._lines:
            line.set_latency_ns(self._ns)

    def step(self, k: int, sample: Sequence[float]) -> tuple[int, list[float]]:
        """Take the sample of tick ``k``; return stamp (ns) and values as delivered."""
        padded, found = (*sample, *self._padding), list[float]()
        for i, line in enumerate(self._lines):
            found += line.step(k, *padded[i * CHANNELS : (i + 1) * CHANNELS])
        return T0_NS + k * self._period_ns - self._ns, found[: self._width]
