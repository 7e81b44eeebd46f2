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

"""The rows of ``trajectory.csv`` from a bag of this package or of another recorder."""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import NamedTuple

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.core.run.parts import columns
from flexarm_ros.core.run.results.trajectory_rows import Row, Rows
from flexarm_ros.core.run.state import MessageState
from flexarm_ros.core.timeline import NS_PER_S
from flexarm_ros.wire.topics import COMMAND, REFERENCE, STATE, TIP

_NAN = (math.nan, math.nan)


class TickRow(NamedTuple):
    """One row; ``whole``: every tick up to this one has all messages that the row needs."""

    tick: int
    row: Row
    whole: bool


def trajectory(reader: BagReader) -> Iterator[TickRow]:
    """
    Yield the rows of a run.

    For a bag of this package: the complete ticks from the start.  For one of another recorder:
    every tick with a state, with nan for missing values and, without a scenario, for elbow,
    tip, rigid and lambda; the reference is then the recorded one.
    """
    return _own(reader) if reader.own else _matched(reader)


def _own(reader: BagReader) -> Iterator[TickRow]:
    rows = Rows(reader.config, reader.provenance.external)
    for block in reader.blocks():
        for tick, row in enumerate(rows.table(block).tolist(), block.first):
            yield TickRow(tick, tuple(row), True)


def _matched(reader: BagReader) -> Iterator[TickRow]:
    rows = Rows(reader.config) if reader.has_scenario else None
    due = 0
    for tick, messages in reader.ticks():
        state = _values(reader, tick, STATE, messages)
        if state is None:
            continue
        arm = MessageState(state)
        measured, torque = (_values(reader, tick, topic, messages) for topic in (TIP, COMMAND))
        due += due == tick and measured is not None and torque is not None
        point, effort = _pair(measured), _pair(torque)
        if rows is not None:
            further = _further(reader, tick, messages)
            row = rows.row(tick, arm.q, arm.qd, arm.ends[:2], point, effort, further=further)
        else:
            target = _pair(_values(reader, tick, REFERENCE, messages))
            time = tick * reader.timeline.period_ns / NS_PER_S
            row = (
                time, *arm.positions[:2], *arm.rates[:2], *arm.ends[:2], *_NAN * 3, *point,
                *target, *effort, math.nan,
            )  # fmt: skip
        yield TickRow(tick, row, due > tick)


def _further(
    reader: BagReader, tick: int, messages: list[bytes | None]
) -> tuple[float, ...]:  # fmt: skip
    """Return the values of the optional parts' columns, nan where a message is missing."""
    places = {topic.name: i for i, topic in enumerate(reader.topics)}
    found = []
    for column in columns(reader.config):
        values = _values(reader, tick, places[column.topic], messages)
        found.append(math.nan if values is None else values[column.place])
    return tuple(found)


def _pair(values: tuple[float, ...] | None) -> tuple[float, float]:
    return _NAN if values is None else (values[0], values[1])


def _values(
    reader: BagReader, tick: int, topic: int, messages: list[bytes | None]
) -> tuple[float, ...] | None:
    data = messages[topic]
    try:
        return None if data is None else reader.topics[topic].codec.decode_any(data)[1]
    except ValueError as error:
        raise BagContentError(
            f'{reader.path}: {reader.topics[topic].path}, tick {tick}: {error}'
        ) from None
