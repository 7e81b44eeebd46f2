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

"""A bag's messages as tables, one per topic, in constant memory."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.wire.cdr import FloatArray, IntArray
import numpy as np

BATCH = 512


@dataclass(frozen=True)
class Batch:
    """
    Consecutive messages of one topic.

    ``ticks`` and ``stamps`` (ns), shape ``(n,)``; ``values``, shape
    ``(n, fields)``, columns as in the topic's ``codec.fields``.
    """

    topic: int
    ticks: IntArray
    stamps: IntArray
    values: FloatArray


def batches(reader: BagReader, size: int = BATCH) -> Iterator[list[Batch]]:
    """
    Yield the messages of ``size`` ticks at a time, one batch per topic.

    Missing ticks or messages are missing from the batches.  Raises BagContentError for a
    message that cannot be decoded.
    """
    ticks: list[list[int]] = [[] for _ in reader.topics]
    data: list[list[bytes]] = [[] for _ in reader.topics]
    count = 0
    for tick, messages in reader.ticks():
        for i, message in enumerate(messages):
            if message is not None:
                ticks[i].append(tick)
                data[i].append(message)
        count += 1
        if count == size:
            yield _decode(reader, ticks, data)
            ticks, data, count = [[] for _ in reader.topics], [[] for _ in reader.topics], 0
    if count:
        yield _decode(reader, ticks, data)


def _decode(reader: BagReader, ticks: list[list[int]], data: list[list[bytes]]) -> list[Batch]:
    found = []
    for i, topic in enumerate(reader.topics):
        try:
            stamps, values = topic.codec.decode_block(data[i])
        except ValueError as error:
            raise BagContentError(
                f'{reader.path}: {topic.path}, ticks {ticks[i][0]} to {ticks[i][-1]}: {error}'
            ) from None
        found.append(Batch(i, np.array(ticks[i], np.int64), stamps, values))
    return found
