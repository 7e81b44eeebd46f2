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
The fast path of a node: its messages into the buffers of its fused step.

It serves a node that has a process of its own, a step (`flexarm_ros.wire.fused_step`) and inputs
whose messages have sequence numbers (`Input.plain`).  Any other message is given back to the
inputs, which treat it as newly arrived.
"""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S
from flexarm_ros.nodes.runtime.topics.channels import Input
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter
from flexarm_ros.wire.fused_step import Buffer

_LONGEST_NS = int(HOUSEKEEPING_S * 1e9)


class FastInputs:
    """
    The inputs of a node with the buffers that their messages are read into.

    ``entries``: the one that arrives last first.  Messages of topics that are published ahead of
    their tick are read beforehand, by `read_ahead`.
    """

    def __init__(
        self, entries: Sequence[Input], buffers: Sequence[Buffer], waiter: Waiter
    ) -> None:
        self._entries, self._waiter = entries, waiter
        self._last = entries[0], buffers[0].put
        self._handles = [entries[0].handle]
        others = [(e, buffer.put) for e, buffer in zip(entries, buffers, strict=True)][1:]
        self._others = [pair for pair in others if not pair[0].topic.ahead]
        self._ahead = [pair for pair in others if pair[0].topic.ahead]
        self._read: list[Input] = []
        """Inputs whose message of the current tick is in its buffer."""

    def usable(self, tick: int) -> bool:
        """Whether the messages of ``tick``, none of which has been read, can be read here."""
        return all(entry.plain and entry.tick < tick for entry in self._entries)

    def read(self) -> bool:
        """Wait for the messages of a tick; False if one does not arrive, or is not usable here."""
        self._waiter.wait(self._handles, _LONGEST_NS)  # a take before it would fail
        entry, buffer = self._last
        if not entry.read_into(buffer):
            return False
        self._read.append(entry)
        return self._read_each(self._others)

    def read_ahead(self) -> bool:
        """Read what is published ahead of the next tick; as `read`."""
        return self._read_each(self._ahead)

    def _read_each(self, pairs: Sequence[tuple[Input, memoryview]]) -> bool:
        for entry, buffer in pairs:
            found = entry.read_into(buffer)
            if found is None:
                self._waiter.wait([entry.handle], _LONGEST_NS)
                found = entry.read_into(buffer)
            if not found:
                return False
            self._read.append(entry)
        return True

    def accept(self) -> None:
        """Regard the messages that have been read as used."""
        self._read.clear()

    def leave(self, tick: int) -> None:
        """Leave the inputs where ``tick`` is next, and give back what has been read of it."""
        for entry in self._read:
            entry.give_back()
        self._read.clear()
        for entry in self._entries:
            entry.skip_to(tick)
