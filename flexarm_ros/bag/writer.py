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
Recording of a run into a rosbag2 directory with one MCAP file.

The bytes depend only on the scenario, the messages and the package versions: no wall time, host,
user or process number is stored, chunks end at ticks, and messages are in canonical order (tick
by tick, within a tick in the order of `flexarm_ros.wire.topics`), independent of the order of
arrival.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import contextlib
import os
from pathlib import Path
from types import TracebackType

from flexarm_ros.bag.definitions import definition
from flexarm_ros.bag.embedded_metadata import attachments, FORMAT, front_matter, scenario_text
from flexarm_ros.bag.errors import BagContentError, BagError
from flexarm_ros.bag.mcap.files import make_directory, write_atomically
from flexarm_ros.bag.mcap.mcapfile import McapFile, MESSAGE_FIXED, MESSAGE_HEADER, RECORD_INDEX
from flexarm_ros.bag.metadata import bag_information, BagTopic, qos_text, to_yaml
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.tick_records import TickRecords
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.state import Block
from flexarm_ros.core.timeline import seconds_to_ns, T0_NS
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.cdr import ByteArray
from flexarm_ros.wire.topics import per_tick_topics, Topic
import numpy as np
from numpy.typing import NDArray

FILE_NAME = 'bag_0.mcap'

MAX_CHUNK = 8 * 1024 * 1024
"""A chunk ends at this many bytes even if ``recorder.chunk_time`` is longer."""


class BagWriter:
    """
    Writes a bag from messages in any order across topics.

    Parameters: the new directory of the bag; the scenario; its provenance (default: this
    process); the topics, if other than the scenario's own.  Raises BagExistsError if the
    directory exists, BagError if it cannot be written (disk full included) or a message is
    repeated or too late.

    A tick is written once every topic has its message.  `end_tick` declares a tick complete;
    ticks up to it are then written as they are, and closing does the same for all that are left:
    an interrupted run keeps every received message.  A chunk is handed to the operating
    system after every ``recorder.chunk_time`` of simulated time (and at 8 MiB), so a killed
    recorder loses less than that.
    """

    def __init__(
        self,
        directory: str | os.PathLike[str],
        config: RunConfig,
        provenance: Provenance | None = None,
        topics: Sequence[Topic] | None = None,
    ) -> None:
        self.directory = Path(directory)
        self.topics = tuple(per_tick_topics(config) if topics is None else topics)
        self.complete_ticks = 0
        self._period_ns = seconds_to_ns(config.run.control_period)
        chunk_ns = round(config.recorder.chunk_time * 1e9)
        self._chunk_ticks = max(1, chunk_ns // self._period_ns)
        self._provenance = provenance or Provenance.here()
        self._width = len(self.topics)
        self._next = 0
        self._pending: dict[int, list[bytes | None]] = {}
        self._missing: dict[int, int] = {}
        self._changes: dict[int, list[Change]] = {}
        self._changes_channel = 0
        self._layouts: dict[tuple[int, ...], TickRecords] = {}
        self._clear_chunk()
        make_directory(self.directory)
        self._file = McapFile(self.directory / FILE_NAME, config.recorder.compression)
        self._closed = False
        self._write_front(config)

    # --- called by the recorder -----------------------------------------------------

    def write(self, topic: int, tick: int, data: bytes) -> None:
        """Add the serialized message of topic number ``topic`` at ``tick``."""
        slots = self._pending.get(tick)
        if slots is None:
            if tick < self._next:
                raise BagContentError(
                    f'{self.topics[topic].path}: message of tick {tick} too late'
                )
            slots = self._pending[tick] = [None] * self._width
            self._missing[tick] = sum(topic.due(tick) for topic in self.topics)
        if not self.topics[topic].due(tick):
            raise BagContentError(f'{self.topics[topic].path}: no message belongs to tick {tick}')
        if slots[topic] is not None:
            raise BagContentError(f'{self.topics[topic].path}: second message of tick {tick}')
        slots[topic] = data
        self._missing[tick] -= 1
        while self._missing.get(self._next) == 0:
            self._emit(self._next)

    def write_ticks(self, first: int, columns: Sequence[Sequence[bytes]]) -> None:
        """
        Add complete ticks from ``first`` on: the serialized messages of each topic in order.

        Equivalent to as many calls of :meth:`write`, several times as fast.
        """
        ticks = range(first, first + max(len(column) for column in columns))
        sizes = [topic.codec.size for topic in self.topics]
        same = all(
            len(data) == size
            for size, column in zip(sizes, columns, strict=True)
            for data in column
        )
        if (
            not same
            or self._pending
            or first != self._next
            or any(c in ticks for c in self._changes)
        ):
            left = [iter(column) for column in columns]
            for tick in ticks:
                for topic in self._due(tick):
                    self.write(topic, tick, next(left[topic]))
            return
        images = [
            np.frombuffer(b''.join(column), np.uint8).reshape(len(column), size)
            for size, column in zip(sizes, columns, strict=True)
        ]
        for begin, count, due in self._alike(ticks):
            start = [topic.count(begin) - topic.count(first) for topic in self.topics]
            records = self._records(due)
            rows = records.copy(begin, [images[i][start[i] :][:count] for i in due])
            self._append_rows(rows, records)

    def _due(self, tick: int) -> list[int]:
        """Return the numbers of the topics that have a message of ``tick``."""
        return [i for i, topic in enumerate(self.topics) if topic.due(tick)]

    def _alike(self, ticks: range) -> Iterator[tuple[int, int, list[int]]]:
        """Split ``ticks`` into runs with the same topics: first tick, number, topics."""
        sparse = [topic for topic in self.topics if topic.every > 1]
        start = ticks.start
        while start < ticks.stop:
            until = min((start // t.every + 1) * t.every for t in sparse) if sparse else ticks.stop
            if any(t.due(start) for t in sparse):
                until = start + 1
            until = min(until, ticks.stop)
            yield start, until - start, self._due(start)
            start = until

    def write_change(self, change: Change) -> None:
        """Add a parameter change at a tick; it is written before that tick's messages."""
        if not self._changes_channel:
            text, digest = definition(changes.TYPE)
            schema = self._file.add_schema(changes.TYPE, text)
            channel = {'offered_qos_profiles': qos_text(changes.QOS), 'topic_type_hash': digest}
            self._changes_channel = self._file.add_channel(changes.PATH, schema, channel)
        if change.tick < self._next:
            self._append_change(change, 0)
        else:
            self._changes.setdefault(change.tick, []).append(change)

    def write_block(self, block: Block) -> None:
        """Add the next complete ticks as numbers; the same bytes, four times as fast."""
        if block.first != self._next or self._pending:
            raise BagError(f'{self.directory}: ticks from {block.first} where {self._next} is due')
        for begin, count, due in self._alike(range(block.first, block.first + len(block))):
            part = slice(begin - block.first, begin - block.first + count)
            records = self._records(due)
            stamps = [block.stamps[i][part] for i in due]
            values = [block.values[i][part] for i in due]
            self._append_rows(records.encode(begin, stamps, values), records)

    def _append_rows(self, rows: ByteArray, records: TickRecords) -> None:
        """Append the records of the next ticks, one row per tick; end chunks where due."""
        done = 0
        while done < len(rows):
            room = self._chunk_ticks - self._next % self._chunk_ticks
            room = min(room, -(-(MAX_CHUNK - self._bytes) // rows.shape[1]))
            part = rows[done:][:room]
            self._append(part, self._next, records)
            done += len(part)
            self._next += len(part)
            self.complete_ticks += len(part)
            self._end_chunk_if_due()

    def end_tick(self, tick: int) -> None:
        """Write all ticks up to ``tick``, complete or not."""
        for due in sorted(k for k in self._pending if k <= tick):
            self._emit(due)
        self._next = max(self._next, tick + 1)

    def flush(self) -> None:
        """Hand complete ticks to the operating system as a chunk, before its time."""
        self._end_chunk()

    def close(self) -> None:
        """Write the remaining ticks, the index and ``metadata.yaml``."""
        if self._closed:
            return
        if self._pending:
            self.end_tick(max(self._pending))
        self._end_chunk()
        self._closed = True
        topics = [
            BagTopic(t.path, t.type_name, definition(t.type_name)[1], t.qos, self._file.counts[i])
            for i, t in enumerate(self.topics, 1)
        ]
        if self._changes_channel:
            digest, count = definition(changes.TYPE)[1], self._file.counts[self._changes_channel]
            topics.append(BagTopic(changes.PATH, changes.TYPE, digest, changes.QOS, count))
        custom = {'scenario': self._provenance.name, 'format': FORMAT}
        information = bag_information(
            FILE_NAME, self._file.start_time, self._file.end_time, topics, custom
        )
        self._file.add_metadata('rosbag2', {'serialized_metadata': to_yaml(information)})
        self._file.finish()
        write_atomically(
            self.directory / 'metadata.yaml',
            to_yaml({'rosbag2_bagfile_information': information}),
        )

    def abandon(self) -> None:
        """Close the file as it is, without an index, after a write error."""
        self._closed = True
        with contextlib.suppress(BagError):
            self._file.close()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is not None and issubclass(kind, BagError):
            self.abandon()
        else:
            self.close()

    # --- chunks -----------------------------------------------------------------------

    def _clear_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._index: list[NDArray[np.void]] = []
        self._single: list[tuple[int, int, int]] = []
        self._bytes = 0

    def _emit(self, tick: int) -> None:
        """Append the messages of ``tick`` to the chunk; end the chunk if due."""
        stamp = T0_NS + tick * self._period_ns
        sequence = tick + 1
        for number, change in enumerate(self._changes.pop(tick, ())):
            self._append_change(change, number)
        parts, header = self._parts, MESSAGE_HEADER.pack
        for channel, data in enumerate(self._pending.pop(tick), 1):
            if data is not None:
                length = MESSAGE_FIXED + len(data)
                parts.append(header(5, length, channel, sequence, stamp, stamp))
                parts.append(data)
                self._single.append((channel, stamp, 9 + length))
                self._bytes += 9 + length
        if not self._missing.pop(tick):
            self.complete_ticks += 1
        self._next = tick + 1
        self._end_chunk_if_due()

    def _append_change(self, change: Change, number: int) -> None:
        """Append one change to the chunk."""
        stamp = T0_NS + change.tick * self._period_ns
        data = changes.encode(change, self._period_ns)
        length = MESSAGE_FIXED + len(data)
        header = MESSAGE_HEADER.pack(5, length, self._changes_channel, number, stamp, stamp)
        self._parts += [header, data]
        self._single.append((self._changes_channel, stamp, 9 + length))
        self._bytes += 9 + length

    def _records(self, due: Sequence[int]) -> TickRecords:
        """Return what makes the records of ticks with messages of the topics ``due``."""
        key = tuple(due)
        if key not in self._layouts:
            self._layouts[key] = TickRecords(self.topics, key, self._period_ns)
        return self._layouts[key]

    def _append(self, rows: ByteArray, first: int, records: TickRecords) -> None:
        """Append records of complete ticks to the chunk."""
        self._gather_single()
        self._parts.append(rows.tobytes())
        self._index.append(records.index(first, len(rows)))
        self._bytes += rows.size

    def _gather_single(self) -> None:
        """Move the index entries of messages that came one by one behind the others."""
        if self._single:
            self._index.append(np.array(self._single, RECORD_INDEX))
            self._single = []

    def _end_chunk_if_due(self) -> None:
        if self._next % self._chunk_ticks == 0 or self._bytes >= MAX_CHUNK:
            self._end_chunk()

    def _end_chunk(self) -> None:
        if self._parts:
            data = b''.join(self._parts)
            self._gather_single()
            self._file.add_chunk(data, np.concatenate(self._index))
            self._clear_chunk()

    # --- before the messages -----------------------------------------------------------

    def _write_front(self, config: RunConfig) -> None:
        schemas: dict[str, int] = {}
        for topic in self.topics:
            text, digest = definition(topic.type_name)
            if topic.type_name not in schemas:
                schemas[topic.type_name] = self._file.add_schema(topic.type_name, text)
            self._file.add_channel(
                topic.path,
                schemas[topic.type_name],
                {
                    'offered_qos_profiles': qos_text(topic.qos),
                    'topic_type_hash': digest,
                },
            )
        text = scenario_text(config)
        for name, data in front_matter(config, text, self._provenance).items():
            self._file.add_metadata(name, data)
        for name, media_type, content in attachments(config, text, self._provenance):
            self._file.add_attachment(name, media_type, content.encode(), T0_NS)
