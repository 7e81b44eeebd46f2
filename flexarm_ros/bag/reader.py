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

Files are read from front to end in flat memory.  ``metadata.yaml`` and the
index in the file are not needed and not trusted; no path found in a bag is
ever opened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
from dataclasses import dataclass, field, replace
import json
import os
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag import changes
from flexarm_ros.bag.blocks import Block, decode_ticks
from flexarm_ros.bag.errors import BagContentError, BagError, BagLimitError, BagMissingError
from flexarm_ros.bag.frontmatter import PROVENANCE_FILE, SCENARIO_FILE, TORQUES_FILE
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.scan import (
    attachment_sound,
    Damage,
    inner_records,
    library_record,
    Message,
    Record,
    Scanner,
    unpack,
)
from flexarm_ros.bag.topics import per_tick_topics, Topic
from flexarm_ros.core.changes import Change
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.timeline import T0_NS, Timeline
from flexarm_ros.scenario.torque_file import parse_torques
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

BLOCK_TICKS = 512
MAX_CHANNELS = 1000


def find_bag(run: str | os.PathLike[str]) -> Path:
    """
    Return the MCAP file of RUN: a run's directory, the bag in it, or the file itself.

    Raises BagError where there is none, or several.
    """
    path = Path(run)
    try:
        if path.is_file():
            return path
        if not path.is_dir():
            raise BagMissingError(f'{path}: no such file or directory')
        for directory in (path, path / 'bag'):
            files = sorted(directory.glob('*.mcap')) if directory.is_dir() else []
            if len(files) > 1:
                raise BagError(f'{directory}: holds {len(files)} .mcap files, one is expected')
            if files:
                return files[0]
    except (OSError, ValueError) as error:
        raise BagError(f'{str(path)!r}: cannot be read: {error}') from None
    raise BagError(f'{path}: no bag in it (neither *.mcap nor bag/*.mcap)')


@dataclass
class Front:
    """What a bag says of itself, apart from its messages."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    library: str = ''

    def take(self, path: Path, record: Record) -> None:
        """Take in a record if it is of these; Damage if it cannot be parsed."""
        if record.opcode == Opcode.CHANNEL:
            channel = library_record(path, record, Channel)
            self.channels.setdefault(channel.id, channel)
            if len(self.channels) > MAX_CHANNELS:
                raise BagLimitError(f'{path}: more than {MAX_CHANNELS} channels')
        elif record.opcode == Opcode.SCHEMA:
            schema = library_record(path, record, Schema)
            if len(self.schemas) < MAX_CHANNELS:
                self.schemas.setdefault(schema.id, schema)
        elif record.opcode == Opcode.ATTACHMENT:
            self._attach(path, record)
        elif record.opcode == Opcode.METADATA:
            metadata = library_record(path, record, Metadata)
            if len(self.metadata) < MAX_CHANNELS:
                self.metadata.setdefault(metadata.name, metadata.metadata)

    def _attach(self, path: Path, record: Record) -> None:
        attachment = library_record(path, record, Attachment)
        if attachment.name not in (SCENARIO_FILE, PROVENANCE_FILE, TORQUES_FILE):
            return
        if not attachment_sound(record):
            raise Damage(path, record.offset, f'checksum of {attachment.name}')
        self.attachments.setdefault(attachment.name, attachment.data)

    @property
    def whole(self) -> bool:
        """Whether the scenario with its torque rows is here."""
        return SCENARIO_FILE in self.attachments


class BagReader:
    """
    A recorded run.

    Raises BagError (BagFormatError, BagContentError, BagLimitError), one line,
    where RUN is no bag of this package or its scenario cannot be read.

    ``config`` is the scenario as recorded, with the parameters that changed
    while it ran (``config.changes``), ``provenance`` where it comes from,
    ``topics`` the per-tick topics in canonical order.  ``damage`` is None, or
    says after an iteration where the file breaks off or is damaged; what comes
    before that is given out.
    """

    def __init__(self, run: str | os.PathLike[str]) -> None:
        self.path = find_bag(run)
        self.damage: Damage | None = None
        front = _read_front(self.path)
        self.config = front_config(self.path, front)
        self.provenance = front_provenance(front)
        self.topics: tuple[Topic, ...] = tuple(per_tick_topics(self.config))
        self.timeline = Timeline.of(self.config.run)
        self._index = topic_index(self.path, front, self.topics)
        found = read_changes(self.path, self.timeline.period_ns)
        if found:
            self.config = replace(self.config, changes=found)

    def messages(self) -> Iterator[tuple[int, int, bytes]]:
        """
        Yield ``(tick, topic index, data)`` of every message in the order of the file.

        Raises BagContentError for a message at no tick of the run.
        """
        self.damage = None
        period, ticks = self.timeline.period_ns, self.timeline.ticks
        try:
            for message in _all_messages(self.path):
                topic = self._index.get(message.channel)
                if topic is None:
                    continue
                tick, rest = divmod(message.log_time - T0_NS, period)
                if rest or not 0 <= tick < ticks:
                    raise BagContentError(
                        f'{self.path}: {self.topics[topic].path}: a message at '
                        f'{message.log_time} ns, at no tick of the run'
                    )
                yield tick, topic, message.data
        except Damage as damage:
            self.damage = damage

    def ticks(self) -> Iterator[tuple[int, list[bytes | None]]]:
        """
        Yield ``(tick, messages)``, each tick's messages in canonical order, None: missing.

        Raises BagContentError where a message comes twice or out of order.
        """
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
                raise BagContentError(
                    f'{self.path}: {self.topics[topic].path}: tick {tick} has two messages'
                )
            held[topic] = data
        if current >= 0:
            yield current, held

    def blocks(self, size: int = BLOCK_TICKS) -> Iterator[Block]:
        """Yield the complete ticks decoded, up to the first that is missing or incomplete."""
        rows: list[Sequence[bytes]] = []
        first = 0
        for tick, held in self.ticks():
            whole = [data for data in held if data is not None]
            if tick != first + len(rows) or len(whole) < len(held):
                break
            rows.append(whole)
            if len(rows) == size:
                yield self._decode(first, rows)
                first, rows = first + size, []
        if rows:
            yield self._decode(first, rows)

    def _decode(self, first: int, rows: list[Sequence[bytes]]) -> Block:
        try:
            return decode_ticks(self.topics, first, rows)
        except ValueError as error:
            last = first + len(rows) - 1
            raise BagContentError(f'{self.path}: ticks {first} to {last}: {error}') from None


def _read_front(path: Path) -> Front:
    """Read what a bag says of itself: before its chunks, or else wherever it stands."""
    front = Front()
    with Scanner(path) as scanner:
        try:
            for record in scanner.records(bodies=False):
                if record.opcode == Opcode.CHUNK and front.whole and front.channels:
                    break
                front.take(path, record)
        except Damage:
            pass  # it counts only if something is missing, which is then said
    if not front.channels:
        _channels_in_chunks(path, front)
    return front


def _channels_in_chunks(path: Path, front: Front) -> None:
    """Other writers put schemas and channels into the chunks."""
    with Scanner(path) as scanner:
        try:
            for record in scanner.records():
                if record.opcode != Opcode.CHUNK:
                    continue
                for inner in inner_records(path, record.offset, unpack(path, record)):
                    if isinstance(inner, Record):
                        front.take(path, inner)
        except Damage:
            pass


def _all_messages(path: Path) -> Iterator[Message]:
    with Scanner(path) as scanner:
        for record in scanner.records():
            if record.opcode == Opcode.CHUNK:
                for inner in inner_records(path, record.offset, unpack(path, record)):
                    if isinstance(inner, Message):
                        yield inner


def read_changes(path: Path, period_ns: int) -> tuple[Change, ...]:
    """
    Return the parameters that were set while the run went on, as far as they can be read.

    Raises BagContentError for one that makes no sense.
    """
    front = Front()
    with Scanner(path) as scanner, contextlib.suppress(Damage):
        for record in scanner.records(bodies=False):
            if record.opcode == Opcode.CHANNEL:
                front.take(path, record)
    channels = {c.id for c in front.channels.values() if c.topic == changes.PATH}
    found: list[Change] = []
    if channels:
        with contextlib.suppress(Damage):
            for message in _all_messages(path):
                if message.channel in channels:
                    found.append(_change(path, message.data, period_ns))
    return tuple(found)


def _change(path: Path, data: bytes, period_ns: int) -> Change:
    try:
        return changes.decode(data, period_ns)
    except ValueError as error:
        raise BagContentError(f'{path}: {changes.PATH}: {error}') from None


def front_config(path: Path, front: Front) -> RunConfig:
    """Return the scenario that a bag carries; BagContentError if it has none that is valid."""
    try:
        text = front.attachments[SCENARIO_FILE].decode()
        rows = front.attachments.get(TORQUES_FILE)
        torques = parse_torques(rows.decode(), TORQUES_FILE) if rows is not None else ()
        return scenario.from_text(text, torques, SCENARIO_FILE)
    except KeyError:
        raise BagContentError(
            f'{path}: no scenario in it: not a bag of this package, or damaged at its front'
        ) from None
    except (UnicodeDecodeError, scenario.ScenarioError) as error:
        raise BagContentError(f'{path}: its scenario: {error}') from None


def front_provenance(front: Front) -> Provenance:
    """Return where a bag comes from, as far as it says so."""
    try:
        data: Any = json.loads(front.attachments[PROVENANCE_FILE])
        return Provenance.from_dict(data)
    except (KeyError, ValueError, TypeError, AttributeError, RecursionError):
        return Provenance()


def topic_index(path: Path, front: Front, topics: Sequence[Topic]) -> dict[int, int]:
    """Return ``{channel: topic index}``; BagContentError where a topic is missing."""
    known = {(topic.path, topic.type_name): i for i, topic in enumerate(topics)}
    found: dict[int, int] = {}
    for channel in front.channels.values():
        schema = front.schemas.get(channel.schema_id)
        key = (channel.topic, schema.name if schema else '')
        if key in known and channel.message_encoding == 'cdr':
            found[channel.id] = known[key]
    missing = [topic.path for i, topic in enumerate(topics) if i not in found.values()]
    if missing:
        raise BagContentError(f'{path}: topic missing: {", ".join(missing)}')
    return found
