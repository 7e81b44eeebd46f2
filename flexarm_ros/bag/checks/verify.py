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
Verification of a recorded run: every message is recomputed and compared byte for byte.

First node by node, from the recorded inputs (the plant from the recorded state and torque of the
tick before, the sensors from the recorded states, the controller from the recorded
measurements), which identifies the faulty node; then the closed loop from the scenario alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
import json
import os
from pathlib import Path

from flexarm_ros.bag.checks.recompute import Nodes, Tick, Values
from flexarm_ros.bag.errors import BagContentError, UnknownRoleError
from flexarm_ros.bag.mcap.storage import METADATA_FILE
from flexarm_ros.bag.metadata import read_counts, read_files
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.core.parameters.changes import Agenda
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_messages, Stamped
from flexarm_ros.core.run.parts import recorded_roles
from flexarm_ros.scenario.errors import counted
from flexarm_ros.scenario.recorded import RECORDER
from flexarm_ros.wire.topics import per_tick_topics, STATE, TIMING, Topic
import numpy as np

LOOP = 'closed loop'
SUMMARY = 'summary.json'
PADDING = 'padding'


@dataclass(frozen=True)
class Difference:
    """
    A mismatch between a recorded and a recomputed message.

    ``field`` is empty if the message is missing or cannot be decoded.
    """

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
    The result of a verification.

    ``compared`` counts messages of each check (node names and ``closed loop``), ``first`` has
    the first difference of each, ``differing`` the number of differing messages.  ``notes`` are
    remarks, ``faults`` further faults of the bag.  ``versions`` lists the differences between
    recording and now; ``other_source``: the source code differs.  With the same source every
    number must be the same, on any machine and with any versions.
    """

    ticks: int = 0
    planned: int = 0
    compared: dict[str, int] = field(default_factory=dict)
    differing: dict[str, int] = field(default_factory=dict)
    first: dict[str, Difference] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    versions: list[str] = field(default_factory=list)
    other_source: bool = False
    source_known: bool = True

    @property
    def same(self) -> bool:
        """Whether every recorded message matches."""
        return not self.first and not self.faults

    @property
    def earliest(self) -> Difference | None:
        """Return the difference of the lowest tick, a node's before the closed loop's."""
        return min(self.first.values(), key=lambda d: (d.tick, d.check == LOOP), default=None)


class _MessageComparison:
    """Compares messages and counts the results."""

    def __init__(self, reader: BagReader, verdict: Verdict) -> None:
        self.topics, self._verdict = reader.topics, verdict
        self._exact = reader.own
        """Whether padding counts: other recorders keep the padding of the middleware."""

    def message(self, check: str, tick: int, topic: int, data: bytes, wanted: Stamped) -> None:
        """Compare one recorded message with its expected stamp and values."""
        verdict, codec = self._verdict, self.topics[topic].codec
        verdict.compared[check] = verdict.compared.get(check, 0) + 1
        if codec.encode(wanted[0], *wanted[1]) == data:
            return
        place, recorded, computed = self._explain(topic, data, wanted)
        if recorded and (self._exact or place != PADDING):
            self.differs(Difference(
                check, tick, self.topics[topic].path, place, recorded, computed
            ))  # fmt: skip

    def differs(self, difference: Difference) -> None:
        """Count a difference."""
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
            return '', '', ''  # an external node's layout, the same content
        return PADDING, 'other bytes', 'zeros'


_RAGGED_TICKS = 256
"""Ticks at the end of an interrupted run that may lack messages: the recorder's queue."""


class _Run:
    """Reads through a bag once and recomputes everything in parallel."""

    def __init__(self, reader: BagReader, skip: frozenset[str], verdict: Verdict) -> None:
        self._reader, self._verdict, self._skip = reader, verdict, skip
        self._topics = reader.topics
        self._comparison = _MessageComparison(reader, verdict)
        placed = reader.config.plant.initial_position is not None
        start_known = placed or 'trajectory' not in reader.unknown
        self._nodes = Nodes(reader.config, reader.topics, skip, start_known)
        free = reader.config.run.sync == 'free'
        self._loop = None if skip or free else ClosedLoop(reader.config)
        self._agenda = Agenda(reader.config.changes)
        self._last = -1
        self._missing = _Missing()
        self._ragged: list[tuple[int, list[str]]] = []
        """Incomplete ticks since the last complete one, perhaps the end of an interrupted run."""
        self.counts = [0] * len(reader.topics)

    def walk(self) -> None:
        """Compare tick after tick; BagContentError if the bag is inconsistent."""
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
        expected.update(self._nodes.held(tick, messages))
        for extra, data in zip(self._topics, messages, strict=True):
            if data is not None and not extra.due(tick):
                self._comparison.differs(
                    Difference(extra.node, tick, extra.path, '', 'a message', 'none')
                )
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
        all_wanted = loop_messages(self._loop, record)
        for topic, data in enumerate(messages):
            if data is not None:
                self._comparison.message(LOOP, tick, topic, data, all_wanted[topic])

    def _account(self, tick: int, messages: Sequence[bytes | None]) -> None:
        missing = []
        for i, data in enumerate(messages):
            self.counts[i] += data is not None
            due = self._topics[i].due(tick)
            if data is None and due and i in self._reader.names:
                missing.append(self._topics[i].path)
        if missing:
            self._ragged.append((tick, missing))
            return
        self._verdict.ticks += 1
        self._missing.take(self._ragged)

    def _skip_to(self, tick: int) -> None:
        first = self._last + 1
        late_recorder = first == 0 and not self._reader.own
        span = f'tick {first} is' if tick == first + 1 else f'ticks {first} to {tick - 1} are'
        (self._verdict.notes if late_recorder else self._verdict.faults).append(
            f'{span} missing; encoder, tip sensor and controller are not verified after that'
        )
        while self._loop is not None and self._loop.k < tick:
            if self._loop.tick() is None:
                break

    def _ending(self) -> None:
        """Note why a run ends early."""
        verdict, loop = self._verdict, self._loop
        if not any(self.counts):
            verdict.faults.append('no message in it: nothing is verified')
            return
        self._say_judged()
        if self._ragged:
            whole_run = self._last + 1 == verdict.planned
            ragged = _Missing()
            if whole_run or not verdict.ticks or len(self._ragged) > _RAGGED_TICKS:
                self._missing.take(self._ragged)
            else:
                ragged.take(self._ragged)
            verdict.notes += ragged.texts()
        verdict.faults += self._missing.texts()
        if self._last + 1 == verdict.planned:
            return
        if loop is not None and loop.k == self._last + 1 and loop.tick() is None:
            verdict.notes.append(
                f'ends at tick {self._last}, unstable as computed: {loop.unstable}'
            )
            return
        verdict.notes.append(
            f'ends at tick {self._last} of {verdict.planned}, compared up to there'
        )

    def _say_judged(self) -> None:
        """Note which nodes could be recomputed from the recorded inputs only in part."""
        there = dict.fromkeys(self._verdict.compared, 0)
        for topic, count in zip(self._topics, self.counts, strict=True):
            if topic.node not in self._skip and topic.name != TIMING:  # measured, not computed
                there[topic.node] = there.get(topic.node, 0) + count
        for node, count in there.items():
            judged = self._verdict.compared.get(node, 0)
            if node != LOOP and judged < count:
                self._verdict.notes.append(
                    f'{node}: inputs are missing, {judged} of {count} messages verified from them'
                )


class _Missing:
    """Counts missing messages per topic."""

    def __init__(self) -> None:
        self._ticks: dict[str, tuple[int, int, int]] = {}

    def take(self, ticks: list[tuple[int, list[str]]]) -> None:
        """Count ticks, each with the topics that have no message there; clears the list."""
        for tick, paths in ticks:
            for path in paths:
                count, first, _ = self._ticks.get(path, (0, tick, tick))
                self._ticks[path] = (count + 1, first, tick)
        ticks.clear()

    def texts(self) -> list[str]:
        """Return a text for each topic."""
        return [
            f'tick {first}: no message on {path}'
            if count == 1
            else f'{count} of the ticks {first} to {last}: no message on {path}'
            for path, (count, first, last) in self._ticks.items()
        ]


def verify(
    run: str | os.PathLike[str],
    external: Sequence[str] = (),
    given: RunConfig | None = None,
    namespace: str | None = None,
) -> Verdict:
    """
    Recompute the run of a bag and compare every recorded message.

    ``external`` names the roles of external nodes (in addition to those named in the bag):
    their output is taken as recorded, and the closed loop is not computed.  ``given`` is the
    scenario of a bag that has none, ``namespace`` as for `BagReader`.  Raises BagError if RUN
    cannot be read or has no scenario, UnknownRoleError for a role that it does not have.
    """
    reader = BagReader(run, given, namespace)
    verdict = Verdict(planned=reader.timeline.ticks)
    unknown = frozenset(reader.unknown) - {RECORDER}
    allowed = {*recorded_roles(reader.config), *unknown}
    for role in sorted({*external} - allowed):
        raise UnknownRoleError(f'{reader.path}: no part {role}: {", ".join(sorted(allowed))}')
    outside = frozenset(external) | frozenset(reader.provenance.external)
    skip = outside | unknown
    if outside:
        verdict.notes.append(
            f'external, taken as recorded: {", ".join(sorted(outside))}; closed loop not computed'
        )
    elif unknown:
        verdict.notes.append(
            f'closed loop not computed: {", ".join(sorted(unknown))} unknown here'
        )
    elif reader.config.run.sync == 'free':
        verdict.notes.append('a free-running run: verified node by node; closed loop not computed')
    walk = _Run(reader, skip, verdict)
    _say_origin(reader, skip, verdict)
    try:
        walk.walk()
    except BagContentError as error:
        verdict.faults.append(str(error))
    if reader.damage is not None:
        # A killed recorder leaves no end either, but then the run says that it broke off.
        known = _broke_off(reader.directory.parent / SUMMARY)
        (verdict.notes if known else verdict.faults).append(f'{reader.damage}')
    else:
        _check_counts(reader, reader.surveyed or walk.counts, verdict)
    return verdict


def _broke_off(summary: Path) -> bool:
    """Return whether the summary beside a bag says that its run was not completed."""
    try:
        found = json.loads(summary.read_text('utf-8'))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(found, dict) and found.get('complete') is False


def _say_origin(reader: BagReader, skip: frozenset[str], verdict: Verdict) -> None:
    """Note the differences between the recording and now, and what the bag lacks."""
    if reader.provenance.versions:
        here = Provenance.here()
        verdict.versions = reader.provenance.differences(here)
        verdict.other_source = reader.provenance.digest != here.digest
    else:
        verdict.source_known = False
        verdict.notes.append('the bag does not contain the versions that it was recorded with')
    verdict.notes += reader.notes
    for index, topic in enumerate(reader.topics):
        if index not in reader.names and topic.node not in skip:
            verdict.faults.append(f'no topic {topic.path} in the bag')


def _check_counts(reader: BagReader, counts: Sequence[int], verdict: Verdict) -> None:
    """Compare the counts in ``metadata.yaml`` with the files."""
    path = reader.directory / METADATA_FILE
    try:
        said = read_counts(path)
    except BagContentError as error:
        verdict.faults.append(str(error))
        return
    if said is None:
        verdict.notes.append('no metadata.yaml beside the bag')
        return
    listed = len(read_files(path))
    if listed > reader.file_count:
        verdict.notes.append(f'metadata.yaml lists {listed} files, {reader.file_count} were read')
        return
    for index, name in reader.names.items():
        if said.get(name) != counts[index]:
            number = said.get(name)
            told = 'no message' if number is None else counted(number, 'message')
            verdict.faults.append(f'metadata.yaml: {told} on {name}, the bag has {counts[index]}')


def _decoded(topic: Topic, data: bytes | None) -> Values | None:
    try:
        return None if data is None else topic.codec.decode_any(data)[1]
    except ValueError:
        return None
