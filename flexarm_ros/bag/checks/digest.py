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

"""A SHA-256 of all messages of a bag, equal for equal runs."""

from __future__ import annotations

import hashlib
import os
import struct

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.mcap.storage import open_files

_FRAME = struct.Struct('<QQ')


def digest_of(run: str | os.PathLike[str]) -> str:
    """
    Return the hexadecimal SHA-256 of topic, log time and bytes of every message of RUN.

    For each topic, sorted by name (as UTF-8): length and name of the topic, then the SHA-256
    of its messages in the order of the bag, each as log time (ns), length and bytes; numbers
    have 64 bits, little endian.  Everything else (scenario, versions, chunks, index) does
    not count.

    Raises BagError if RUN is no bag, is damaged, or holds no message.
    """
    hashes: dict[str, hashlib._Hash] = {}
    for file in open_files(run):
        channels = file.front().channels
        for message in file.messages():
            if message.channel not in channels:
                raise BagContentError(f'{file.path}: a message of an unknown channel')
            one = hashes.setdefault(channels[message.channel].topic, hashlib.sha256())
            one.update(_FRAME.pack(message.log_time, len(message.data)))
            one.update(message.data)
    if not hashes:
        raise BagContentError(f'{run}: no messages')
    whole = hashlib.sha256()
    for name, one in sorted((topic.encode(), one) for topic, one in hashes.items()):
        whole.update(struct.pack('<Q', len(name)) + name + one.digest())
    return whole.hexdigest()
