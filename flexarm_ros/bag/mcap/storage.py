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
The files of a bag: MCAP or sqlite3, one or several, and their descriptions.

A bag of this package is one MCAP file.  rosbag2 also splits bags into several files and writes
sqlite3.  ``metadata.yaml`` is optional and only states which files of a directory belong
together; no path found in a bag is ever opened.
"""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
from typing import Any

from flexarm_ros.bag.embedded_metadata import PROVENANCE_FILE, SCENARIO_FILE, TORQUES_FILE
from flexarm_ros.bag.errors import BagError, BagFormatError, BagLimitError, BagMissingError
from flexarm_ros.bag.mcap.scan import (
    attachment_sound,
    Damage,
    library_record,
    Message,
    Record,
    Scanner,
)
from flexarm_ros.bag.metadata import read_files
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Metadata, Schema

MAX_CHANNELS = 1000
METADATA_FILE = 'metadata.yaml'
_SUFFIXES = ('.mcap', '.db3')


@dataclass
class Front:
    """The description in a bag's file: everything but its messages."""

    channels: dict[int, Channel] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    library: str = ''

    def take(self, path: Path, record: Record) -> None:
        """Store a record if it is part of the description; Damage if it cannot be parsed."""
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
        """Whether the scenario with its torque rows is present."""
        return SCENARIO_FILE in self.attachments

    def kinds(self) -> Iterator[tuple[int, str, str]]:
        """Yield ``(channel, topic, type)`` of each channel with CDR messages."""
        for channel in self.channels.values():
            schema = self.schemas.get(channel.schema_id)
            if channel.message_encoding == 'cdr':
                yield channel.id, channel.topic, schema.name if schema else ''


class BagFile:
    """One MCAP file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def front(self) -> Front:
        """Return the description of the file, wherever in it that is."""
        front, damaged = Front(), False
        with Scanner(self.path) as scanner:
            try:
                for record in scanner.records(bodies=False):
                    front.take(self.path, record)
            except Damage:
                damaged = True  # reported only if something is missing
        if not front.channels or (damaged and not front.whole):
            self._look_into_chunks(front)
        return front

    def _look_into_chunks(self, front: Front) -> None:
        """Read schemas and channels from the chunks, where other writers put them."""
        with Scanner(self.path) as scanner, contextlib.suppress(Damage):
            for record in scanner.contents():
                if isinstance(record, Record):
                    front.take(self.path, record)

    def messages(self) -> Iterator[Message]:
        """Yield all messages in the order of the file; Damage if it is truncated."""
        with Scanner(self.path) as scanner:
            for record in scanner.contents():
                if isinstance(record, Message):
                    yield record


class SqliteFile(BagFile):
    """One sqlite3 file, read by the ``rosbags`` library; BagFormatError if it is none."""

    def front(self) -> Front:
        """Return topics and types; this storage holds nothing else of this package."""
        front = Front()
        for number, _, connection in self._read(messages=False):
            front.schemas[number] = Schema(
                id=number, name=connection.msgtype, encoding='ros2msg', data=b''
            )
            front.channels[number] = Channel(
                id=number, topic=connection.topic, schema_id=number, metadata={},
                message_encoding=connection.ext.serialization_format,
            )  # fmt: skip
        return front

    def messages(self) -> Iterator[Message]:
        """Yield all messages in order of time."""
        for number, time, data in self._read(messages=True):
            yield Message(number, 0, time, time, bytes(data))

    def _read(self, messages: bool) -> Iterator[tuple[int, int, Any]]:
        from rosbags.rosbag2 import Reader  # 0.05 s, for bags of other writers only

        try:
            with Reader(self.path) as reader:
                if messages:
                    for connection, time, data in reader.messages():
                        yield connection.id, time, data
                else:
                    for connection in reader.connections[:MAX_CHANNELS]:
                        yield connection.id, 0, connection
        except Exception as error:  # any error of the library on damaged bytes
            text = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
            raise BagFormatError(f'{self.path}: not a sqlite3 bag: {text}') from None


def open_files(run: str | os.PathLike[str]) -> list[BagFile]:
    """
    Return the files of RUN's bag: a run's directory, the bag in it, or one file itself.

    Files of a split bag are in order of their numbers.  Raises BagError if there is none, or
    if they do not belong to one bag.
    """
    paths = _find(Path(run))
    return [SqliteFile(path) if path.suffix == '.db3' else BagFile(path) for path in paths]


def find_bag(run: str | os.PathLike[str]) -> Path:
    """Return the only file of RUN's bag; BagError if there is none, or several."""
    paths = _find(Path(run))
    if len(paths) > 1:
        raise BagError(f'{paths[0].parent}: holds {len(paths)} files of a bag, one is expected')
    return paths[0]


def _find(path: Path) -> list[Path]:
    try:
        if path.is_file():
            _refuse_compressed([path])
            return [path]
        if not path.is_dir():
            raise BagMissingError(f'{path}: no such file or directory')
        for directory in (path, path / 'bag'):
            found = list(directory.iterdir()) if directory.is_dir() else []
            files = [file for file in found if file.suffix in _SUFFIXES]
            if files:
                return _of_one_bag(directory, sorted(files, key=_number))
            _refuse_compressed(found)
    except (OSError, ValueError) as error:
        raise BagError(f'{str(path)!r}: cannot be read: {error}') from None
    raise BagError(f'{path}: no bag in it (neither *.mcap, *.db3 nor bag/*.mcap)')


def _refuse_compressed(paths: list[Path]) -> None:
    for path in paths:
        if path.suffix == '.zstd' and path.with_suffix('').suffix in _SUFFIXES:
            raise BagError(f'{path}: compressed as a whole; decompress it: zstd -d {path.name}')


def _of_one_bag(directory: Path, files: list[Path]) -> list[Path]:
    """Return ``files``; BagError if ``metadata.yaml`` exists and contradicts."""
    if len({file.suffix for file in files}) > 1:
        raise BagError(f'{directory}: holds .mcap and .db3 files, one bag is expected')
    if len(files) == 1:
        return files
    listed = read_files(directory / METADATA_FILE)
    unlisted = [file.name for file in files if file.name not in listed]
    if 0 < len(unlisted) < len(files):
        raise BagError(
            f'{directory}: holds {len(files)} files, of which {METADATA_FILE} does not name '
            f'{", ".join(unlisted[:3])}; name one of them'
        )
    return files


def _number(path: Path) -> tuple[list[int], str]:
    """Return a sort key that puts ``bag_10`` after ``bag_9``."""
    return [int(digits[-18:]) for digits in re.findall(r'\d+', path.name)], path.name
