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

"""Decoding of recorded ticks into arrays."""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.core.run.state import Block
from flexarm_ros.wire.topics import Topic


def decode_ticks(topics: Sequence[Topic], first: int, ticks: Sequence[Sequence[bytes]]) -> Block:
    """
    Decode complete ticks, each with the messages of ``topics`` in order.

    Raises ValueError for a message that cannot be decoded.
    """
    columns = [
        topic.codec.decode_block([tick[i] for tick in ticks]) for i, topic in enumerate(topics)
    ]
    return Block(first, tuple(c[0] for c in columns), tuple(c[1] for c in columns))
