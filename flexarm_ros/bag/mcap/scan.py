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
Sequential reading of an MCAP file that may be damaged or hostile.

The file's own index is neither trusted nor used: records are read in sequence, every length is
checked against the rest of the file and against a limit before memory of that size is
allocated, and chunks are decompressed to at most their declared size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
import io
import mmap
from pathlib import Path
import re
import struct
from typing import Any, BinaryIO, TypeVar
import zlib

from flexarm_ros.bag.errors import BagError, BagFormatError, BagLimitError
from flexarm_ros.bag.mcap.mcapfile import MAGIC
import lz4.frame  # type: ignore[import-untyped]
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Chunk, DataEnd, Footer
import zstandard

MAX_RECORD = 128 * 1024 * 1024
"""Largest record that is read, bytes (a torque file may have 64 MiB)."""

MAX_CHUNK_DATA = 64 * 1024 * 1024
"""Largest chunk that is decompressed, bytes (this package ends chunks at 8 MiB)."""

DATA_CHECKSUM = 'checksum of the data section'

_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_MESSAGE_OPCODE = int(Opcode.MESSAGE)
_KNOWN = frozenset(int(opcode) for opcode in Opcode)
_CHUNK_START = re.compile(
    rb'\x06[\s\S]{5}\x00{3}[\s\S]{16}[\s\S]{4}\x00{4}[\s\S]{4}'
    rb'(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd)[\s\S]{5}\x00{3}'
)
"""A chunk record of less than 1 TiB, up to the length of its data."""

T = TypeVar('T')


@dataclass(frozen=True)
class Record:
    """One record: its opcode, its offset in the file, and its content."""

    opcode: int
    offset: int
    body: bytes

    @property
    def end(self) -> int:
        """Offset of the next record."""
        return self.offset + _HEAD.size + len(self.body)


@dataclass(frozen=True)
class Message:
    """One message record."""

    channel: int
    sequence: int
    log_time: int
    publish_time: int
    data: bytes


class Damage(BagFormatError):
    """The file is truncated or damaged at byte ``offset``."""

    def __init__(self, path: Path, offset: int, what: str) -> None:
        super().__init__(f'{path}: damaged at byte {offset}: {what}')
        self.offset = offset
        self.what = what


class Scanner:
    """
    Reads the records of one file in order.

    Raises BagError if the file cannot be opened and BagFormatError if it is not an MCAP file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            if not path.is_file():
                raise BagError(f'{path}: not a file')
            self._file: BinaryIO = open(path, 'rb')  # noqa: SIM115 - closed by close()
            self.size = self._file.seek(0, io.SEEK_END)
        except OSError as error:
            raise BagError(f'{path}: cannot be read: {error.strerror}') from None
        except ValueError as error:
            raise BagError(f'{path!r}: cannot be read: {error}') from None

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Scanner:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def is_mcap(self) -> bool:
        """Whether the file starts with MCAP's magic bytes."""
        self._file.seek(0)
        return self._file.read(len(MAGIC)) == MAGIC

    def records(self, start: int | None = None, bodies: bool = True) -> Iterator[Record]:
        """
        Yield the records of the file, or those from byte ``start`` on, to the footer.

        With ``bodies`` false the content of chunks is skipped.  Raises BagFormatError if the
        file is not MCAP, Damage if it is truncated, lengths do not fit, a checksum of the data
        section or of the summary is wrong, or the end is missing.
        """
        if start is None and not self.is_mcap():
            raise BagFormatError(f'{self.path}: not an MCAP file')
        checked = bodies and start is None
        crc = zlib.crc32(MAGIC)
        position, summary = len(MAGIC) if start is None else start, -1
        while True:
            record = self._read(position, bodies)
            if record.opcode == Opcode.DATA_END:
                end = parse(self.path, record, DataEnd.read)
                if checked and end.data_section_crc not in (0, crc):
                    raise Damage(self.path, position, DATA_CHECKSUM)
                summary = record.end
            if summary < 0 and checked:
                crc = zlib.crc32(record.body, zlib.crc32(self._head, crc))
            yield record
            position = record.end if record.body or not self._skipped else self._skipped
            if record.opcode == Opcode.FOOTER:
                self._check_end(record, summary, position)
                return

    def contents(self) -> Iterator[Message | Record]:
        """
        Yield every message, and every other record but chunks, inside and outside of chunks.

        Raises as :meth:`records`, `unpack` and `inner_records`.
        """
        for record in self.records():
            if record.opcode == Opcode.CHUNK:
                yield from inner_records(self.path, record.offset, unpack(self.path, record))
            elif record.opcode == Opcode.MESSAGE:
                yield message_of(self.path, record)
            else:
                yield record

    def _read(self, position: int, bodies: bool) -> Record:
        self._file.seek(position)
        self._head = self._file.read(_HEAD.size)
        if len(self._head) < _HEAD.size:
            raise Damage(self.path, position, 'the file is truncated')
        opcode, length = _HEAD.unpack(self._head)
        if opcode not in _KNOWN and opcode < 0x80:  # 0x80 and above: private, to be ignored
            raise Damage(self.path, position, f'no record (opcode {opcode})')
        end = position + _HEAD.size + length
        if end > self.size:
            raise Damage(self.path, position, 'a truncated record')
        self._skipped = 0
        if opcode == Opcode.CHUNK and not bodies:
            self._skipped = end
            return Record(opcode, position, b'')
        if length > MAX_RECORD:
            raise BagLimitError(
                f'{self.path}: a record of {length} bytes; at most {MAX_RECORD} are read'
            )
        return Record(opcode, position, self._file.read(length))

    def _check_end(self, record: Record, summary: int, position: int) -> None:
        footer = parse(self.path, record, Footer.read)
        self._file.seek(position)
        if self._file.read(len(MAGIC) + 1) != MAGIC:
            raise Damage(self.path, position, 'the end of the file')
        if not footer.summary_crc:
            return
        # Without a summary its start is 0, and the checksum covers the footer alone.
        if summary < 0 or (footer.summary_start or record.offset) != summary:
            raise Damage(self.path, record.offset, 'the position of the summary')
        self._file.seek(summary)
        left, crc = position - 4 - summary, 0
        while left > 0:
            part = self._file.read(min(left, 1 << 20))
            if not part:
                break
            crc, left = zlib.crc32(part, crc), left - len(part)
        if crc != footer.summary_crc:
            raise Damage(self.path, summary, 'checksum of the summary')

    def next_chunk(self, start: int) -> int | None:
        """Return the offset of the next intact chunk after damage, or ``None``."""
        if start >= self.size:
            return None
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as view:
            position = start
            while found := _CHUNK_START.search(view, position):
                position = found.start()
                if self._is_chunk(position):
                    return position
                position += 1
        return None

    def find_attachment(self, name: str) -> bytes | None:
        """Return the data of an intact attachment of this name, wherever it is."""
        needle = len(name).to_bytes(4, 'little') + name.encode()
        if not self.size:
            return None
        with mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ) as view:
            place = view.find(needle)
            while place >= 0:
                try:
                    record = self._read(max(place - 16 - _HEAD.size, 0), True)
                    if record.opcode == Opcode.ATTACHMENT and attachment_sound(record):
                        attachment = parse(self.path, record, Attachment.read)
                        if attachment.name == name:
                            return bytes(attachment.data)
                except BagError:
                    pass
                place = view.find(needle, place + 1)
        return None

    def _is_chunk(self, position: int) -> bool:
        try:
            record = self._read(position, True)
            chunk = parse(self.path, record, Chunk.read)
            return chunk.uncompressed_crc != 0 and bool(unpack(self.path, record))
        except BagError:
            return False


def attachment_sound(record: Record) -> bool:
    """Whether an attachment's checksum is correct (or absent)."""
    crc = int.from_bytes(record.body[-4:], 'little')
    return crc in (0, zlib.crc32(record.body[:-4]))


def parse(path: Path, record: Record, reader: Callable[[ReadDataStream], T]) -> T:
    """
    Parse a record's content with the ``mcap`` library's ``reader``.

    Raises Damage if the content is invalid.
    """
    stream = ReadDataStream(io.BytesIO(record.body))
    try:
        found = reader(stream)
    except Exception as error:  # any error of the library on damaged bytes
        raise Damage(
            path, record.offset, f'content of a record ({type(error).__name__})'
        ) from None
    return found


def unpack(path: Path, record: Record) -> bytes:
    """
    Return the records inside a chunk, decompressed and checked.

    Raises Damage, or BagLimitError if the chunk is too large.
    """
    chunk = parse(path, record, Chunk.read)
    size = chunk.uncompressed_size
    if size > MAX_CHUNK_DATA:
        raise BagLimitError(
            f'{path}: a chunk of {size} bytes; at most {MAX_CHUNK_DATA} are decompressed'
        )
    try:
        data = _DECOMPRESS[chunk.compression](chunk.data, size)
    except KeyError:
        raise Damage(path, record.offset, 'unknown compression of a chunk') from None
    except (zstandard.ZstdError, RuntimeError, EOFError, ValueError, MemoryError):
        raise Damage(path, record.offset, 'compressed data of a chunk') from None
    if len(data) != size:
        raise Damage(path, record.offset, 'length of a chunk')
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise Damage(path, record.offset, 'checksum of a chunk')
    return data


def _unzstd(data: bytes, size: int) -> bytes:
    decompressor = zstandard.ZstdDecompressor(max_window_size=1 << 27)
    with decompressor.stream_reader(data) as stream:
        return bytes(stream.read(size + 1))


def _unlz4(data: bytes, size: int) -> bytes:
    decompressor = lz4.frame.LZ4FrameDecompressor()
    return bytes(decompressor.decompress(data, max_length=size + 1))


_DECOMPRESS: dict[str, Callable[[bytes, int], bytes]] = {
    '': lambda data, size: data,
    'lz4': _unlz4,
    'zstd': _unzstd,
}


def inner_records(path: Path, offset: int, data: bytes) -> Iterator[Message | Record]:
    """Yield the messages (and other records) in a chunk's data; Damage if truncated."""
    position, size = 0, len(data)
    while position < size:
        if position + _HEAD.size > size:
            raise Damage(path, offset, 'records inside of a chunk')
        opcode, length = _HEAD.unpack_from(data, position)
        position += _HEAD.size
        if length > size - position:
            raise Damage(path, offset, 'records inside of a chunk')
        end = position + length
        if opcode == _MESSAGE_OPCODE:
            yield _message(path, offset, data, position, end)
        else:
            yield Record(opcode, offset, data[position:end])
        position = end


def message_of(path: Path, record: Record) -> Message:
    """Return the content of a message record outside of a chunk; Damage if it is too short."""
    return _message(path, record.offset, record.body, 0, len(record.body))


def _message(path: Path, offset: int, data: bytes, start: int, end: int) -> Message:
    if end - start < _MESSAGE.size:
        raise Damage(path, offset, 'a message')
    channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, start)
    return Message(channel, sequence, log_time, publish_time, data[start + _MESSAGE.size : end])


def library_record(path: Path, record: Record, kind: Any) -> Any:
    """Parse a record as a class of ``mcap.records``."""
    return parse(path, record, kind.read)
