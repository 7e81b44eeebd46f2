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
Proof of a recorded run: every message computed anew and compared byte for byte.

Node by node, from the recorded inputs (the plant from the recorded state and
torque of the tick before, the sensors from the recorded states, the
controller from the recorded measurements), which tells which node is at
fault; and the closed loop from the scenario alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import os

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.metadata import read_counts
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reader import BagReader
from flexarm_ros.bag.recompute import loop_messages, Nodes, Stamped, Tick, Values
from flexarm_ros.bag.topics import per_tick_topics, STATE, Topic
from flexarm_ros.core.changes import Agenda
from flexarm_ros.core.loop import ClosedLoop
import numpy as np

LOOP = 'closed loop'


@dataclass(frozen=True)
class Difference:
    """One message that is not what was computed; ``field`` empty: there is none, or no such."""

    check: str
    tick: int
    topic: str
    field: str
    recorded: str
    computed: str

    def __str__(self) -> str:
        what = f' {self.field}:' if self.field else ':'
        return (
            f'tick {self.tick}, {self.topic}{what} {self.recorded} recorded, '
            f'{self.computed} computed'
        )


@dataclass
class Verdict:
    """
    What came of a verification.

    ``compared`` counts messages of each check (node names and ``closed loop``)
    and ``first`` has its first difference, ``differing`` how many messages
    differ.  ``notes`` are to be told but no fault, ``faults`` are faults of
    the bag beside differing messages.  ``versions`` tells what differs between
    then and now.
    """

    ticks: int = 0
    planned: int = 0
    compared: dict[str, int] = field(default_factory=dict)
    differing: dict[str, int] = field(default_factory=dict)
    first: dict[str, Difference] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)

    @property
    def same(self) -> bool:
        """Whether every recorded message is what was computed."""
        return not self.first and not self.faults

    @property
    def earliest(self) -> Difference | None:
        """Return the difference of the lowest tick, a node's before the closed loop's."""
        return min(self.first.values(), key=lambda d: (d.tick, d.check == LOOP), default=None)


class _Comparison:
    """Compares messages and keeps the account."""

    def __init__(self, topics: Sequence[Topic], verdict: Verdict) -> None:
        self.topics, self._verdict = topics, verdict

    def message(self, check: str, tick: int, topic: int, data: bytes, wanted: Stamped) -> None:
        """Compare one recorded message with the stamp and values that it should have."""
        verdict, codec = self._verdict, self.topics[topic].codec
        verdict.compared[check] = verdict.compared.get(check, 0) + 1
        if codec.encode(wanted[0], *wanted[1]) == data:
            return
        place, recorded, computed = self._explain(topic, data, wanted)
        if place or recorded:
            self.differs(Difference(
                check, tick, self.topics[topic].path, place, recorded, computed
            ))  # fmt: skip

    def differs(self, difference: Difference) -> None:
        """Take a difference into the account."""
        check = difference.check
        self._verdict.first.setdefault(check, difference)
        self._verdict.differing[check] = self._verdict.differing.get(check, 0) + 1

    def _explain(self, topic: int, data: bytes, wanted: Stamped) -> tuple[str, str, str]:
        """Return field, recorded and computed text; empty texts if only the layout differs."""
        codec = self.topics[topic].codec
        try:
            stamp, values = codec.decode_any(data)
        except ValueError as error:
            return '', str(error), 'a message'
        if stamp != wanted[0]:
            return 'stamp', f'{stamp} ns', f'{wanted[0]} ns'
        for name, recorded, computed in zip(codec.fields, values, wanted[1], strict=True):
            if np.float64(recorded).tobytes() != np.float64(computed).tobytes():
                return name, repr(recorded), repr(float(computed))
        try:
            codec.decode(data)
        except ValueError:
            return '', '', ''  # a foreign node's layout, the same content
        return 'padding', 'other bytes', 'zeros'


_RAGGED_TICKS = 256
"""Ticks at the end of a run that broke off which may lack messages: the recorder's queue."""


class _Run:
    """Walks through a bag once, computing everything anew beside it."""

    def __init__(self, reader: BagReader, skip: frozenset[str], verdict: Verdict) -> None:
        self._reader, self._verdict = reader, verdict
        self._topics = reader.topics
        self._comparison = _Comparison(reader.topics, verdict)
        self._nodes = Nodes(reader.config, reader.topics, skip)
        self._loop = None if skip else ClosedLoop(reader.config)
        self._agenda = Agenda(reader.config.changes)
        self._last = -1
        self._incomplete: list[str] = []
        """Ticks without all messages since the last whole one: the ragged end of a run, maybe."""
        self.counts = [0] * len(reader.topics)

    def walk(self) -> None:
        """Compare tick after tick; raises BagContentError where the bag makes no sense."""
        before: Tick | None = None
        for tick, messages in self._reader.ticks():
            if tick != self._last + 1:
                self._skip_to(tick)
                before = None
            now = [_decoded(t, data) for t, data in zip(self._topics, messages, strict=True)]
            self._compare(tick, messages, now, before)
            before, self._last = now, tick
            self._account(tick, messages)
        self._ending()

    def _compare(
        self, tick: int, messages: Sequence[bytes | None], now: Tick, before: Tick | None
    ) -> None:
        expected = self._nodes.expected(tick, now, before)
        if tick >= self._agenda.next:  # the covariance of a message follows noise_std
            self._agenda.due(tick)
            self._comparison.topics = per_tick_topics(self._nodes.config)
        for topic, wanted in expected.items():
            data = messages[topic]
            if data is not None:
                node = self._topics[topic].node
                self._comparison.message(node, tick, topic, data, wanted)
        if self._loop is None:
            return
        record = self._loop.tick() if self._loop.k == tick else None
        if record is None:
            self._comparison.differs(Difference(
                LOOP, tick, self._topics[STATE].path, '', 'a tick',
                f'unstable at tick {self._loop.unstable_tick} ({self._loop.unstable})',
            ))  # fmt: skip
            return
        all_wanted = loop_messages(record, self._reader.timeline.stamp_ns(tick))
        for topic, data in enumerate(messages):
            if data is not None:
                self._comparison.message(LOOP, tick, topic, data, all_wanted[topic])

    def _account(self, tick: int, messages: Sequence[bytes | None]) -> None:
        missing = []
        for i, data in enumerate(messages):
            self.counts[i] += data is not None
            if data is None:
                missing.append(self._topics[i].path)
        if missing:
            self._incomplete.append(f'tick {tick}: no message on {", ".join(missing)}')
            return
        self._verdict.ticks += 1
        self._verdict.faults += self._incomplete
        self._incomplete.clear()

    def _skip_to(self, tick: int) -> None:
        first = self._last + 1
        span = f'tick {first} is' if tick == first + 1 else f'ticks {first} to {tick - 1} are'
        self._verdict.faults.append(
            f'{span} missing; encoder, tip sensor and controller are not judged behind that'
        )
        while self._loop is not None and self._loop.k < tick:
            if self._loop.tick() is None:
                break

    def _ending(self) -> None:
        """Say why a run ends before its time."""
        verdict, loop = self._verdict, self._loop
        if not any(self.counts):
            verdict.faults.append('no message in it: nothing is proved')
            return
        if self._incomplete:
            whole_run = self._last + 1 == verdict.planned
            if whole_run or not verdict.ticks or len(self._incomplete) > _RAGGED_TICKS:
                verdict.faults += self._incomplete[:-1]
                del self._incomplete[:-1]
            verdict.notes += self._incomplete
        elif self._last + 1 == verdict.planned:
            return
        elif loop is not None and loop.k == self._last + 1 and loop.tick() is None:
            verdict.notes.append(
                f'ends at tick {self._last}, unstable as computed: {loop.unstable}'
            )
            return
        verdict.notes.append(
            f'ends at tick {self._last} of {verdict.planned}, compared as far as it goes'
        )


def verify(run: str | os.PathLike[str], foreign: Sequence[str] = ()) -> Verdict:
    """
    Compute the run of a bag anew and compare every recorded message.

    ``foreign`` names nodes that were not ours (beside those that the bag
    itself names): their output is taken as it is, and the closed loop is not
    computed.  Raises BagError where RUN cannot be read.
    """
    reader = BagReader(run)
    verdict = Verdict(planned=reader.timeline.ticks)
    verdict.versions = reader.provenance.differences(Provenance.here())
    skip = frozenset(foreign) | frozenset(reader.provenance.foreign)
    if skip:
        verdict.notes.append(
            f'not ours, taken as recorded: {", ".join(sorted(skip))}; closed loop not computed'
        )
    walk = _Run(reader, skip, verdict)
    try:
        walk.walk()
    except BagContentError as error:
        verdict.faults.append(str(error))
    if reader.damage is not None:
        verdict.notes.append(f'{reader.damage}')
    else:
        _check_counts(reader, walk.counts, verdict)
    return verdict


def _check_counts(reader: BagReader, counts: Sequence[int], verdict: Verdict) -> None:
    """Compare what ``metadata.yaml`` beside the file says with the file."""
    try:
        said = read_counts(reader.path.parent / 'metadata.yaml')
    except BagContentError as error:
        verdict.faults.append(str(error))
        return
    if said is None:
        verdict.notes.append('no metadata.yaml beside the bag')
        return
    for topic, count in zip(reader.topics, counts, strict=True):
        if said.get(topic.path) != count:
            verdict.faults.append(
                f'metadata.yaml: {said.get(topic.path, "no")} messages on {topic.path}, '
                f'the bag has {count}'
            )


def _decoded(topic: Topic, data: bytes | None) -> Values | None:
    try:
        return None if data is None else topic.codec.decode_any(data)[1]
    except ValueError:
        return None
