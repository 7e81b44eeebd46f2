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
Transport of samples from a sensor to its receiver, the same for every sensor, and of commands.

A sample is measured at a tick, less the fraction of a tick in the latency, and arrives a latency
later.  The receiver then has the newest sample that has arrived, and holds it until a newer one
arrives.  With one latency for all and no loss (`ChannelParameters.scheduled` is false) that is the
value at t_k - latency at each tick, linear between ticks: a delay line.  Otherwise
`flexarm_ros.core.sensing.schedule` gives the arrival of each sample, and once it has been used the
run continues with it, so that samples under way arrive when they would have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol, TYPE_CHECKING

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.sensing.channel_keys import check_loss
from flexarm_ros.core.sensing.delay import BufferDelay, CHANNELS, Line, PadeDelay
from flexarm_ros.core.timeline import named_ns, T0_NS, ticks_between, Timeline
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from flexarm_ros.core.sensing.schedule import Schedule

Arrived = tuple[int, Sequence[float]]
"""Stamp of the measurement, ns, and values."""


class Delivery(NamedTuple):
    """
    Which sample the receiver has new at each of n ticks: known before they are run.

    ``pool`` (m + n, width): m samples under way, then those of the ticks, to be filled; ``picks``
    (n,): row of ``pool`` that arrives at a tick, -1: none; ``stamps`` (n,), ns, of those that
    arrive.
    """

    pool: FloatArray
    picks: NDArray[np.int64]
    stamps: NDArray[np.int64]


class Channel(Protocol):
    """The transport of a sample from its measurement to the receiver; it has memory."""

    def step(self, k: int, sample: Sequence[float]) -> Arrived | None:
        """
        Take the sample of tick ``k``; return what the receiver has new, None if nothing.

        At tick 0 it is never None.
        """

    def check(self, parameters: Any) -> None:
        """Raise ``ValueError`` for live parameters that cannot be taken during a run."""

    def retune(self, parameters: Any) -> None:
        """Take the live parameters from the next tick on."""


class LatencyChannel:
    """
    The channel of the keys `ChannelParameters` in section ``name``.

    ``width``: values per sample; ``number``: of several senders of one section; ``model``: of the
    latency, as ``tip_sensor.latency_model``; ``start``: what the receiver has before the first
    arrival, left out: the sample of tick 0.
    """

    def __init__(
        self, name: str, parameters: ChannelParameters, timeline: Timeline, width: int,
        seed: int = 0, model: str = 'buffer', number: int = 0,
        start: tuple[float, ...] | None = None,
    ) -> None:  # fmt: skip
        self._name, self._period_ns, self._model = name, timeline.period_ns, model
        self._identity = seed, f'{name}{number or ""}'
        self.ns = self._wanted(parameters)
        """The latency, ns."""
        self._used_ns = self.ns
        """That of the last tick; between two ticks `retune` may be called several times."""
        self.every = ticks_between(f'{name}.rate', parameters.rate, timeline.period_ns)
        """Ticks between samples."""
        count = -(-width // CHANNELS)
        kind: type[PadeDelay | BufferDelay] = PadeDelay if model == 'pade2' else BufferDelay
        self._lines = [kind(timeline.period_ns, self.ns) for _ in range(count)]
        self._width, self._padding = width, (0.0,) * (count * CHANNELS - width)
        self._start, self._shift = start, 0
        if start is not None:
            self._through(0, start)
            self._shift = 1
        self._schedule: Schedule | None = None
        self._newest = -1
        """Tick of the newest sample that has arrived."""
        self._delay_ns: int | None = None
        """The latency of the samples under way when the schedule comes into use."""
        self._way: dict[int, tuple[int, int, Any]] = {}
        """Tick of arrival -> newest sample that arrives then: tick, stamp, values."""
        self.retune(parameters)

    @property
    def scheduled(self) -> bool:
        """Whether each sample has an arrival of its own."""
        return self._schedule is not None

    def _wanted(self, parameters: ChannelParameters) -> int:
        return named_ns(f'{self._name}.latency', parameters.latency)

    def check(self, parameters: ChannelParameters) -> None:
        """Raise ``ValueError`` for a latency beyond the history, or an impossible loss."""
        most_ns, wanted_ns = self._lines[0].most_ns, self._wanted(parameters)
        if wanted_ns < 0:
            raise ValueError(f'{self._name}.latency: {wanted_ns} ns, must be 0 or more')
        if wanted_ns > most_ns:
            raise ValueError(
                f'{self._name}.latency: {parameters.latency!r} s is beyond the '
                f'{most_ns * 1e-9:g} s of history that this run keeps'
            )
        check_loss(self._name, parameters, self._model)

    def retune(self, parameters: ChannelParameters) -> None:
        """Take latency, jitter and loss from the next tick on; ``ValueError`` as `check`."""
        self.check(parameters)
        self.ns = self._wanted(parameters)
        if parameters.scheduled and self._schedule is None:
            from flexarm_ros.core.sensing.schedule import Schedule

            self._schedule = Schedule(*self._identity, parameters, self._period_ns)
            self._delay_ns = self._used_ns
        if self._schedule is not None:
            self._schedule.retune(parameters)
            self._whole, self._part_ns = divmod(self.ns, self._period_ns)
            if parameters.latencies is not None:
                self._whole = self._part_ns = 0
        for line in self._lines:
            line.set_latency_ns(self.ns if self._schedule is None else self._part_ns)

    def follow(self) -> None:
        """Continue after ticks of compiled code, which has used the `record` of this latency."""
        self._used_ns = self.ns

    def record(self) -> Line:
        """Return the line of the first four values for compiled code."""
        return self._lines[0].record()

    def step(self, k: int, sample: Sequence[float]) -> Arrived | None:
        """Take the sample of tick ``k``; return stamp (ns) and values if newly delivered."""
        if self._schedule is not None:
            return self._scheduled_step(k, sample, self._schedule)
        self._used_ns = ns = self.ns
        if self._width == CHANNELS:  # as `_through`, in less time
            values: Sequence[float] = self._lines[0].step(k + self._shift, *sample)
        else:
            values = self._through(k + self._shift, sample)
        return None if k % self.every else (T0_NS + k * self._period_ns - ns, values)

    def _through(self, k: int, sample: Sequence[float]) -> Sequence[float]:
        """Return the sample as it comes out of the lines."""
        if self._width == CHANNELS:
            return self._lines[0].step(k, *sample)
        padded, found = (*sample, *self._padding), list[float]()
        for i, line in enumerate(self._lines):
            found += line.step(k, *padded[i * CHANNELS : (i + 1) * CHANNELS])
        return found[: self._width]

    def _scheduled_step(
        self, k: int, sample: Sequence[float], schedule: Schedule
    ) -> Arrived | None:
        self._begin_schedule(k)
        arrived = self._pass(k, self._through(k + self._shift, sample), schedule)
        return None if arrived is None else arrived[1:]

    def _pass(self, k: int, values: Any, schedule: Schedule) -> tuple[int, int, Any] | None:
        """Send the sample of tick ``k``; return tick, stamp and values of one that arrives."""
        taken = k, T0_NS + k * self._period_ns - self._part_ns, values
        # As without jitter, samples are due at the receiver at every n-th tick.
        if (k + self._whole) % self.every == 0:
            arrival = schedule.send(k, self._part_ns)
            if arrival is not None:
                self._way[arrival] = taken
        arrived = self._way.pop(k, None)
        if arrived is not None and arrived[0] > self._newest:
            self._newest = arrived[0]
            return arrived
        if k > 0:
            return None
        if self._start is not None:
            return 0, T0_NS, self._start
        self._newest = 0
        return taken

    def plan(self, first: int, count: int) -> Delivery:
        """
        Return the delivery of the next ``count`` ticks, from ``first`` on, which may be none.

        Their samples are then to be put through `record` and into the pool, and `end_plan` called.
        """
        ticks = np.arange(first, first + count)
        if self._schedule is None:
            if count:
                self._used_ns = self.ns
            picks = np.arange(count)
            if self.every > 1:
                picks[ticks % self.every != 0] = -1
            stamps = T0_NS + ticks * self._period_ns - self.ns
            return Delivery(np.empty((count, self._width)), picks, stamps)
        if count:
            self._begin_schedule(first)
        under_way = list(self._way.items())
        pool = np.empty((len(under_way) + count, self._width))
        for row, (due, (sent, stamp, values)) in enumerate(under_way):
            pool[row] = values
            self._way[due] = sent, stamp, row
        picks, stamps = np.full(count, -1), np.zeros(count, np.int64)
        for i in range(count):
            found = self._pass(first + i, len(under_way) + i, self._schedule)
            if found is not None:
                _, stamps[i], picks[i] = found
        return Delivery(pool, picks, stamps)

    def end_plan(self, delivery: Delivery) -> None:
        """Keep the samples that are still under way, behind ticks that have been run."""
        for due, (sent, stamp, row) in self._way.items():
            self._way[due] = sent, stamp, tuple(delivery.pool[row].tolist())

    def _begin_schedule(self, k: int) -> None:
        """Go on with the schedule from tick ``k`` on, if it has just come into use."""
        if self._delay_ns is not None:
            self._continue(k, self._delay_ns)
            self._delay_ns = None

    def _continue(self, k: int, latency_ns: int) -> None:
        """Note the samples that are under way before tick ``k``, with one latency for all."""
        if k == 0:
            return
        whole = latency_ns // self._period_ns
        self._newest = (k - 1) // self.every * self.every - whole
        part = latency_ns % self._period_ns / self._period_ns
        for due in range(k, k + whole):
            if due % self.every == 0:
                sent = due - whole
                found = [
                    value
                    for line in self._lines
                    if isinstance(line, BufferDelay)
                    for value in line.stored(sent + self._shift, part)
                ]
                stamp = T0_NS + due * self._period_ns - latency_ns
                self._way[due] = (sent, stamp, found[: self._width])
