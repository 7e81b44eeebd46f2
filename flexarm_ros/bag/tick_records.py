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

"""The message records of a tick as one row of fixed size, so that many are made at once."""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.bag.mcap.mcapfile import MESSAGE_FIXED, RECORD_HEAD, RECORD_INDEX
from flexarm_ros.core.timeline import T0_NS
from flexarm_ros.wire.cdr import ByteArray, FloatArray, IntArray
from flexarm_ros.wire.topics import Topic
import numpy as np
from numpy.typing import NDArray


class TickRecords:
    """
    Makes the records of ticks that have a message of each of the topics ``due``, in order.

    A row is a structured array's: for topic i, ``head{i}`` and ``message{i}``.  Constant bytes
    come from a template.
    """

    def __init__(self, topics: Sequence[Topic], due: Sequence[int], period_ns: int) -> None:
        self.due, self._period_ns = tuple(due), period_ns
        self._codecs = [topics[i].codec for i in due]
        parts = [
            part
            for i, codec in zip(due, self._codecs, strict=True)
            for part in ((f'head{i}', RECORD_HEAD), (f'message{i}', codec.record))
        ]
        self._row = np.dtype(parts)
        head = np.zeros((), RECORD_HEAD)
        head['opcode'] = 5
        template = b''
        for i, codec in zip(due, self._codecs, strict=True):
            head['length'], head['channel'] = MESSAGE_FIXED + codec.size, i + 1
            template += head.tobytes() + codec.template
        self._template = np.frombuffer(template, np.uint8)
        self.size = len(template)
        """Bytes of a row."""
        self._channels = [i + 1 for i in due]
        self._lengths = [9 + MESSAGE_FIXED + codec.size for codec in self._codecs]

    def index(self, first: int, count: int) -> NDArray[np.void]:
        """Return the `RECORD_INDEX` of ``count`` rows from tick ``first`` on."""
        entries = np.empty((count, len(self.due)), RECORD_INDEX)
        entries['channel'], entries['length'] = self._channels, self._lengths
        entries['time'] = self._stamps(first, count)[:, None]
        return entries.ravel()

    def encode(
        self, first: int, stamps: Sequence[IntArray], values: Sequence[FloatArray]
    ) -> ByteArray:
        """Return rows (n, size) from tick ``first`` on; the arrays are those of each due topic."""
        rows = self._with_heads(first, len(stamps[0]))
        for i, codec, at, numbers in zip(self.due, self._codecs, stamps, values, strict=True):
            codec.fill(rows[f'message{i}'], at, numbers)
        return rows.view(np.uint8).reshape(len(rows), self.size)

    def copy(self, first: int, messages: Sequence[ByteArray]) -> ByteArray:
        """Return rows (n, size) from tick ``first`` on, of encoded messages (n, bytes) each."""
        rows = self._with_heads(first, len(messages[0]))
        octets = rows.view(np.uint8).reshape(len(rows), self.size)
        for i, data in zip(self.due, messages, strict=True):
            start: int = self._row.fields[f'message{i}'][1]  # type: ignore[index]
            octets[:, start : start + data.shape[1]] = data
        return octets

    def _with_heads(self, first: int, count: int) -> NDArray[np.void]:
        rows = np.tile(self._template, count).view(self._row)
        for i in self.due:
            head = rows[f'head{i}']
            head['sequence'] = np.arange(first + 1, first + 1 + count)
            head['log_time'] = head['publish_time'] = self._stamps(first, count)
        return rows

    def _stamps(self, first: int, count: int) -> IntArray:
        return T0_NS + np.arange(first, first + count) * self._period_ns
