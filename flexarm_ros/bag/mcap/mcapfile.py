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
Writing of an MCAP file, chunk by chunk.

The records come from the ``mcap`` library.  Only the messages of a chunk are encoded here: the
library's writer takes 43 us a tick of six messages, this one 6 (see docs/bag.md), and the
caller decides where chunks end.

The data section holds schemas and channels, then attachments and metadata, then the chunks with
their message indexes.  So a file truncated anywhere after its first few kilobytes still holds
its description and its scenario.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import os
from pathlib import Path
import struct
import zlib

from flexarm_ros.bag.errors import BagError, BagExistsError
import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
import numpy as np
from numpy.typing import NDArray
import zstandard

MAGIC = b'\x89MCAP0\r\n'
LIBRARY = 'flexarm_ros'
MESSAGE_HEADER = struct.Struct('<BQHIQQ')
"""Opcode, length of the rest, channel, sequence, log time, publish time."""
MESSAGE_FIXED = 2 + 4 + 8 + 8
"""Bytes of a message record that its length includes, before the data."""

RECORD_HEAD = np.dtype(
    [
        ('opcode', 'u1'),
        ('length', '<u8'),
        ('channel', '<u2'),
        ('sequence', '<u4'),
        ('log_time', '<u8'),
        ('publish_time', '<u8'),
    ]
)
"""`MESSAGE_HEADER` as a numpy type."""

RECORD_INDEX = np.dtype([('channel', 'u2'), ('time', 'u8'), ('length', 'u8')])
"""A message record in a chunk: channel, log time (ns), bytes with opcode and length field."""

_INDEX_HEADER = struct.Struct('<BQHI')
_INDEX_ENTRY = np.dtype([('time', '<u8'), ('offset', '<u8')])


def _compress_lz4(data: bytes) -> bytes:
    packed: bytes = lz4.frame.compress(data, store_size=True)
    return packed


Compress = Callable[[bytes], bytes]

COMPRESSORS: dict[str, tuple[str, Callable[[], Compress]]] = {
    'none': ('', lambda: bytes),
    'lz4': ('lz4', lambda: _compress_lz4),
    'zstd': ('zstd', lambda: zstandard.ZstdCompressor(level=3).compress),
}
"""
Name of a compression -> its name in the file and what makes its function.

A function is for one file: a compressor of zstd must not be shared between threads.
"""


class McapFile:
    """
    A new MCAP file of profile ``ros2``; BagError if it cannot be written.

    Add schemas and channels first (more may follow between chunks), then attachments and
    metadata, then chunks, then call `finish`.  Each call hands its data to the operating system
    before it returns.
    """

    def __init__(self, path: Path, compression: str) -> None:
        self.path = path
        self._compression, make_compress = COMPRESSORS[compression]
        self._compress = make_compress()
        self._position = 0
        self._crc = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.counts: dict[int, int] = {}
        self.start_time = 0
        self.end_time = 0
        try:
            self._file = open(path, 'xb', buffering=0)  # noqa: SIM115 - closed by finish
        except FileExistsError:
            raise BagExistsError(f'{path}: exists already, not overwritten') from None
        except OSError as error:
            raise BagError(f'{path}: cannot be written: {error.strerror}') from None
        self._put(MAGIC + _record(Header(profile='ros2', library=LIBRARY)))

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._position

    def _put(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                written = self._file.write(view)
                view = view[written:]
        except OSError as error:
            raise BagError(f'{self.path}: cannot be written: {error.strerror}') from None
        self._position += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def add_schema(self, name: str, text: str) -> int:
        """Add a ``ros2msg`` schema and return its id."""
        schema = Schema(
            id=len(self._schemas) + 1, name=name, encoding='ros2msg', data=text.encode()
        )
        self._schemas.append(schema)
        self._put(_record(schema))
        return schema.id

    def add_channel(self, topic: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Add a channel of CDR messages and return its id."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding='cdr',
            schema_id=schema_id,
            metadata=dict(metadata),
        )
        self._channels.append(channel)
        self.counts[channel.id] = 0
        self._put(_record(channel))
        return channel.id

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Add a metadata record."""
        record = _record(Metadata(name=name, metadata=dict(data)))
        self._metadata.append(MetadataIndex(offset=self._position, length=len(record), name=name))
        self._put(record)

    def add_attachment(self, name: str, media_type: str, data: bytes, time_ns: int) -> None:
        """Add an attachment; ``time_ns`` is its log and its creation time."""
        attachment = Attachment(
            create_time=time_ns, log_time=time_ns, name=name, media_type=media_type, data=data
        )
        record = _record(attachment)
        self._attachments.append(
            AttachmentIndex(
                offset=self._position,
                length=len(record),
                create_time=time_ns,
                log_time=time_ns,
                data_size=len(data),
                name=name,
                media_type=media_type,
            )
        )
        self._put(record)

    def add_chunk(self, data: bytes, records: NDArray[np.void]) -> None:
        """Add a chunk of message records; ``records``: the `RECORD_INDEX` of each."""
        ids = records['channel']
        entries = np.zeros(len(ids), _INDEX_ENTRY)
        entries['time'] = records['time']
        np.cumsum(records['length'][:-1], out=entries['offset'][1:])
        packed = self._compress(data)
        start = self._position
        first, last = int(entries['time'].min()), int(entries['time'].max())
        chunk = Chunk(
            compression=self._compression,
            data=packed,
            message_start_time=first,
            message_end_time=last,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        blob = [_record(chunk)]
        chunk_length = position = len(blob[0])
        index_offsets: dict[int, int] = {}
        for channel in sorted(self.counts):
            mine = entries[ids == channel]
            if len(mine):
                index_offsets[channel] = start + position
                blob.append(_message_index(channel, mine))
                position += len(blob[-1])
                self.counts[channel] += len(mine)
        self._put(b''.join(blob))
        self._chunks.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
                chunk_start_offset=start,
                chunk_length=chunk_length,
                message_index_offsets=index_offsets,
                message_index_length=position - chunk_length,
                compression=self._compression,
                compressed_size=len(packed),
                uncompressed_size=len(data),
            )
        )
        self.start_time = min(self.start_time, first) if len(self._chunks) > 1 else first
        self.end_time = max(self.end_time, last)

    def finish(self) -> None:
        """Write the end of the data, the summary and the footer, and close the file."""
        self._put(_record(DataEnd(data_section_crc=self._crc)))
        summary_start = self._position
        summary = b''
        offsets: list[SummaryOffset] = []
        for opcode, records in self._summary():
            group = b''.join(_record(record) for record in records)
            if group:
                offsets.append(SummaryOffset(opcode, summary_start + len(summary), len(group)))
            summary += group
        offset_start = summary_start + len(summary)
        summary += b''.join(_record(record) for record in offsets)
        footer = Footer(summary_start, offset_start, 0)
        crc = zlib.crc32(summary + _record(footer)[:-4])
        self._put(summary + _record(Footer(summary_start, offset_start, crc)) + MAGIC)
        self.close()

    def _summary(self) -> list[tuple[int, Sequence[McapRecord]]]:
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=dict(self.counts),
            chunk_count=len(self._chunks),
            message_count=sum(self.counts.values()),
            message_end_time=self.end_time,
            message_start_time=self.start_time,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        return [
            (Opcode.SCHEMA, self._schemas),
            (Opcode.CHANNEL, self._channels),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunks),
            (Opcode.ATTACHMENT_INDEX, self._attachments),
            (Opcode.METADATA_INDEX, self._metadata),
        ]

    def close(self) -> None:
        """Close the file as it is (without `finish`: incomplete)."""
        if not self._file.closed:
            try:
                os.fsync(self._file.fileno())
                self._file.close()
            except OSError as error:
                raise BagError(f'{self.path}: cannot be written: {error.strerror}') from None


def _record(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data


def _message_index(channel: int, entries: NDArray[np.void]) -> bytes:
    raw = entries.tobytes()
    return _INDEX_HEADER.pack(Opcode.MESSAGE_INDEX, 6 + len(raw), channel, len(raw)) + raw
