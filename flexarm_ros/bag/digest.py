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

"""One number for all messages of a bag: equal digests, equal runs."""

from __future__ import annotations

from collections.abc import Iterator
import hashlib
import os
from pathlib import Path
import struct

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.reader import find_bag
from flexarm_ros.bag.scan import (
    inner_records,
    library_record,
    Message,
    Record,
    Scanner,
    unpack,
)
from mcap.opcode import Opcode
from mcap.records import Channel

_FRAME = struct.Struct('<QQ')


def digest_of(run: str | os.PathLike[str]) -> str:
    """
    Return the SHA-256, in hexadecimal, of topic, log time and bytes of every message of RUN.

    For each topic, in order of name (as UTF-8): the topic's length and name, then
    the SHA-256 of its messages in the order of the file, each as log time (ns),
    length and bytes; numbers are of 64 bits, little endian.  What is not a message
    (scenario, versions, chunks, index) does not count.

    Raises BagError where RUN is no bag, is damaged, or holds no message.
    """
    path = find_bag(run)
    topics: dict[int, str] = {}
    hashes: dict[str, hashlib._Hash] = {}
    for record in _records(path):
        if isinstance(record, Message):
            if record.channel not in topics:
                raise BagContentError(f'{path}: a message of channel {record.channel}, unknown')
            one = hashes.setdefault(topics[record.channel], hashlib.sha256())
            one.update(_FRAME.pack(record.log_time, len(record.data)))
            one.update(record.data)
        elif record.opcode == Opcode.CHANNEL:
            channel = library_record(path, record, Channel)
            topics[channel.id] = channel.topic
    if not hashes:
        raise BagContentError(f'{path}: no messages')
    whole = hashlib.sha256()
    for name, one in sorted((topic.encode(), one) for topic, one in hashes.items()):
        whole.update(struct.pack('<Q', len(name)) + name + one.digest())
    return whole.hexdigest()


def _records(path: Path) -> Iterator[Record | Message]:
    """Yield all records, those of chunks in the place of these."""
    with Scanner(path) as scanner:
        for record in scanner.records():
            if record.opcode == Opcode.CHUNK:
                yield from inner_records(path, record.offset, unpack(path, record))
            else:
                yield record
