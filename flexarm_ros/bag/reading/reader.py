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
Reading of a recorded run: its scenario, its provenance, its messages tick by tick.

Files are read from front to end in constant memory.  The index in the file is neither needed
nor trusted.  A bag of this package is self-contained; one of another recorder is matched to the
ticks by its stamps (:mod:`flexarm_ros.bag.reading.matching`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
from dataclasses import replace
import json
import os
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.embedded_metadata import PROVENANCE_FILE, SCENARIO_FILE, TORQUES_FILE
from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.mcap.scan import Damage, Message
from flexarm_ros.bag.mcap.storage import BagFile, Front, open_files
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.blocks import decode_ticks
from flexarm_ros.bag.reading.matching import change_of, Match, match, UNKNOWN
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.state import Block
from flexarm_ros.core.timeline import T0_NS, Timeline
from flexarm_ros.scenario.recorded import from_recorded, Recorded
from flexarm_ros.scenario.torque_file import parse_torques
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.topics import per_tick_topics, Topic

BLOCK_TICKS = 512
MOST_SHOWN = 4
WINDOW_TICKS = 1 << 15
"""Most ticks by which a message in another recorder's bag may be early or late."""


class BagReader:
    """
    A recorded run.

    ``given`` is the scenario of a bag that has none, ``namespace`` that of the
    run in a bag of another recorder which has several; by default the run in
    ``preferred`` is read, if there is one.  Raises BagError
    (BagFormatError, BagContentError, BagLimitError), one line, if RUN is no bag
    of a run or its scenario cannot be read.

    ``unknown``: section -> the parts of the scenario that this version does not know, also in
    ``notes``.  ``own``: whether this package wrote the bag.  ``provenance``: its provenance.
    ``topics``: the per-tick topics in canonical order; ``names``: topic -> name in the bag.
    ``notes`` and ``gaps``: what is left out and what is missing, as far as known before the
    messages are read.  ``damage`` is set by an iteration to where the file is truncated or
    damaged, None if intact; everything before it is returned.
    """

    def __init__(
        self, run: str | os.PathLike[str], given: RunConfig | None = None,
        namespace: str | None = None, preferred: str = '',
    ) -> None:  # fmt: skip
        self._files = open_files(run)
        self.file_count = len(self._files)
        self.directory = self._files[0].path.parent
        self.path = self._files[0].path if self.file_count == 1 else self.directory
        self.damage: Damage | None = None
        fronts = [file.front() for file in self._files]
        front = next((front for front in fronts if front.whole), fronts[0])
        self.own = front.whole
        self.provenance = front_provenance(front)
        self.notes: list[str] = []
        self.gaps: list[str] = []
        self._match: Match | None = None
        self._config = given
        self.unknown: dict[str, list[str]] = {}
        self.front = front
        if self.own:
            recorded = front_scenario(self.path, front)
            self._config, self.unknown = recorded.config, recorded.unknown
            self.notes += unknown_notes(self.unknown)
            self._take_own(fronts, given)
        else:
            found = match(self.path, self._files, fronts, given, namespace, preferred)
            self._take_match(found)

    def _take_own(self, fronts: Sequence[Front], given: RunConfig | None) -> None:
        if given is not None:
            raise BagContentError(f'{self.path}: has a scenario of its own; leave out --scenario')
        self.topics: tuple[Topic, ...] = per_tick_topics(self.config)
        self.timeline = Timeline.of(self.config.run)
        self._index = [topic_index(front, self.topics) for front in fronts]
        self.names = {i: topic.path for i, topic in enumerate(self.topics)}
        check_complete(self.path, self.topics, self._index)
        try:
            self._take_changes(read_changes(self._files, fronts, self.timeline.period_ns))
        except BagContentError as error:
            if not self.unknown:
                raise
            self.notes.append(f'changed parameters are left out: {error}')

    def _take_match(self, found: Match) -> None:
        self.topics, self.timeline = found.topics, found.timeline
        self._index, self.names, self._match = found.index, found.names, found
        self.notes, self.gaps = found.notes, found.gaps
        self._take_changes(found.changes)

    def _take_changes(self, found: tuple[Change, ...]) -> None:
        if found:
            self._config = replace(self.config, changes=found)

    @property
    def surveyed(self) -> list[int] | None:
        """Number of messages of each topic, if a survey has counted them."""
        return None if self._match is None else [len(ticks) for ticks in self._match.ticks]

    @property
    def has_scenario(self) -> bool:
        """Whether ``config`` is available."""
        return self._config is not None

    @property
    def config(self) -> RunConfig:
        """
        The scenario, with the parameters that changed during the run (``config.changes``).

        Raises BagContentError if the bag has none and none was given.
        """
        if self._config is None:
            raise no_scenario(self.path)
        return self._config

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """
        Yield ``(tick, topic index, data)`` of every message in the order of the bag.

        Raises BagContentError for a message at no tick of the run.
        """
        self.damage = None
        place = self._log_tick if self._match is None else _Places(self.path, self._match)
        for file, index in zip(self._files, self._index, strict=True):
            try:
                for message in file.messages():
                    topic = index.get(message.channel, UNKNOWN)
                    tick = UNKNOWN if topic < 0 else place(message, topic)
                    if tick >= 0:
                        yield tick, topic, message.data
            except Damage as damage:
                self.damage = self.damage or damage

    def _log_tick(self, message: Message, topic: int) -> int:
        tick, rest = divmod(message.log_time - T0_NS, self.timeline.period_ns)
        if rest or not 0 <= tick < self.timeline.ticks:
            raise BagContentError(
                f'{self.path}: {self.topics[topic].path}: a message at '
                f'{message.log_time} ns, at no tick of the run'
            )
        return tick

    def ticks(self) -> Iterator[tuple[int, list[bytes | None]]]:
        """
        Yield ``(tick, messages)``, each tick's messages in canonical order, None: missing.

        Raises BagContentError for a repeated message or one out of order.
        """
        return self._recorded_ticks() if self._match is None else self._sorted_ticks()

    def _recorded_ticks(self) -> Iterator[tuple[int, list[bytes | None]]]:
        current, slots = -1, [None] * len(self.topics)
        held: list[bytes | None] = list(slots)
        for tick, topic, data in self.messages():
            if tick != current:
                if tick < current:
                    raise BagContentError(f'{self.path}: tick {tick} after tick {current}')
                if current >= 0:
                    yield current, held
                current, held = tick, list(slots)
            if held[topic] is not None:
                raise self._twice(tick, topic)
            held[topic] = data
        if current >= 0:
            yield current, held

    def _sorted_ticks(self) -> Iterator[tuple[int, list[bytes | None]]]:
        """Sort the messages of another recorder, which may be in any order; drop duplicates."""
        waiting: dict[int, list[bytes | None]] = {}
        done = -1
        for tick, topic, data in self.messages():
            if tick <= done:
                raise BagContentError(
                    f'{self.path}: {self.topics[topic].path}: tick {tick} comes more than '
                    f'{WINDOW_TICKS // 2} ticks late'
                )
            held = waiting.setdefault(tick, [None] * len(self.topics))
            if held[topic] not in (None, data):
                raise self._twice(tick, topic)
            held[topic] = data
            if len(waiting) > WINDOW_TICKS:
                for done in sorted(waiting)[: WINDOW_TICKS // 2]:
                    yield done, waiting.pop(done)
        for tick in sorted(waiting):
            yield tick, waiting[tick]

    def nothing(self) -> BagContentError:
        """Return the error for a bag without usable messages."""
        why = f': damaged at byte {self.damage.offset}: {self.damage.what}' if self.damage else ''
        return BagContentError(f'{self.path}: no message of a run in it{why}')

    def _twice(self, tick: int, topic: int) -> BagContentError:
        return BagContentError(
            f'{self.path}: {self.topics[topic].path}: tick {tick} has two messages'
            + ('' if self.own else ' (two runs in one bag, or two publishers?)')
        )

    def blocks(self, size: int = BLOCK_TICKS) -> Iterator[Block]:
        """Yield the complete ticks decoded, up to the first missing or incomplete one."""
        rows: list[Sequence[bytes]] = []
        first = 0
        for tick, held in self.ticks():
            whole = [data for data in self._filled(tick, held) if data is not None]
            if tick != first + len(rows) or len(whole) < len(held):
                break
            rows.append(whole)
            if len(rows) == size:
                yield self._decode(first, rows)
                first, rows = first + size, []
        if rows:
            yield self._decode(first, rows)

    def _filled(self, tick: int, held: list[bytes | None]) -> Iterator[bytes | None]:
        """Yield the messages of a tick, a bare stamp where a topic has none."""
        for topic, data in zip(self.topics, held, strict=True):
            due = data is not None or topic.due(tick)
            yield data if due else topic.codec.encode(self.timeline.stamp_ns(tick))

    def _decode(self, first: int, rows: list[Sequence[bytes]]) -> Block:
        try:
            return decode_ticks(self.topics, first, rows)
        except ValueError as error:
            last = first + len(rows) - 1
            raise BagContentError(f'{self.path}: ticks {first} to {last}: {error}') from None


def open_run(
    run: str | os.PathLike[str], given: RunConfig | None, namespace: str | None
) -> BagReader:
    """Return a reader; ``given`` and ``namespace`` are used if the bag is another recorder's."""
    reader = BagReader(run, None, namespace)
    return reader if reader.own or given is None else BagReader(run, given, namespace)


def no_scenario(path: Path) -> BagContentError:
    """Return the error for a bag whose scenario is needed."""
    return BagContentError(
        f'{path}: no scenario in it (not a bag of this package, or damaged at its front); '
        'give it with --scenario FILE'
    )


class _Places:
    """Returns the tick of each message in turn."""

    def __init__(self, path: Path, found: Match) -> None:
        self._path = path
        self._left = [iter(ticks) for ticks in found.ticks]

    def __call__(self, message: Message, topic: int) -> int:
        tick = next(self._left[topic], None)
        if tick is None:
            raise BagContentError(f'{self._path}: has grown while it was read')
        return tick


def read_changes(
    files: Sequence[BagFile], fronts: Sequence[Front], period_ns: int
) -> tuple[Change, ...]:
    """
    Return the parameters that were set during the run, as far as they can be read.

    Raises BagContentError for an invalid one.
    """
    found: list[Change] = []
    for file, front in zip(files, fronts, strict=True):
        channels = {c.id for c in front.channels.values() if c.topic == changes.PATH}
        if channels:
            with contextlib.suppress(Damage):
                for message in file.messages():
                    if message.channel in channels:
                        found.append(change_of(file.path, message.data, period_ns))
    return tuple(found)


def unknown_notes(unknown: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a line for each section of a scenario that is only partly known."""
    return [
        f'{section}: taken as recorded, not known to this version: {"; ".join(what[:MOST_SHOWN])}'
        + (f' and {len(what) - MOST_SHOWN} more' if len(what) > MOST_SHOWN else '')
        for section, what in unknown.items()
    ]


def front_scenario(path: Path, front: Front) -> Recorded:
    """Return the scenario in a bag; BagContentError if it has no valid one."""
    try:
        text = front.attachments[SCENARIO_FILE].decode()
        rows = front.attachments.get(TORQUES_FILE)
        torques = parse_torques(rows.decode(), TORQUES_FILE) if rows is not None else ()
        return from_recorded(text, torques, SCENARIO_FILE)
    except KeyError:
        raise no_scenario(path) from None
    except (UnicodeDecodeError, scenario.ScenarioError) as error:
        raise BagContentError(f'{path}: its scenario: {error}') from None


def front_provenance(front: Front) -> Provenance:
    """Return the provenance in a bag, as far as it is recorded."""
    try:
        data: Any = json.loads(front.attachments[PROVENANCE_FILE])
        return Provenance.from_dict(data)
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return Provenance()


def topic_index(front: Front, topics: Sequence[Topic]) -> dict[int, int]:
    """Return ``{channel: topic index}``."""
    known = {(topic.path, topic.type_name): i for i, topic in enumerate(topics)}
    return {
        channel: known[topic, type_name]
        for channel, topic, type_name in front.kinds()
        if (topic, type_name) in known
    }


def check_complete(path: Path, topics: Sequence[Topic], index: Sequence[dict[int, int]]) -> None:
    """Raise BagContentError if a topic is in none of the files."""
    found = {topic for held in index for topic in held.values()}
    missing = [topic.path for i, topic in enumerate(topics) if i not in found]
    if missing:
        raise BagContentError(f'{path}: topic missing: {", ".join(missing)}')
