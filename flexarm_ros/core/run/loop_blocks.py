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

"""A closed loop in blocks of ticks: compiled, or tick by tick."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from flexarm_ros.core.run.kernel import Kernel
from flexarm_ros.core.run.loop import ClosedLoop, TickRecord
from flexarm_ros.core.run.part import CLOCK, STATE
from flexarm_ros.core.run.parts import place
from flexarm_ros.core.run.state import Block
import numpy as np

BLOCK_TICKS = 1024
_CLOCK, _STATE = place(CLOCK), place(STATE)

Stamped = tuple[int, tuple[float, ...]]
"""Stamp (ns) and values of one message."""


def loop_blocks(loop: ClosedLoop) -> Iterator[Block]:
    """Run a closed loop to its end and yield its ticks in blocks of at most `BLOCK_TICKS`."""
    kernel = Kernel.of(loop)
    while True:
        block = kernel.block(BLOCK_TICKS) if kernel else single_ticks(loop, BLOCK_TICKS)
        if not len(block):
            return
        yield block


def single_ticks(loop: ClosedLoop, most: int) -> Block:
    """Run at most ``most`` ticks one by one and return what is published in them."""
    first = loop.k
    ticks: list[list[Stamped]] = []
    while len(ticks) < most and (record := loop.tick()) is not None:
        ticks.append(loop_messages(loop, record))
    columns = list(zip(*ticks, strict=True)) or [()]
    return Block(
        first,
        tuple(np.array([stamp for stamp, _ in column], np.int64) for column in columns),
        tuple(np.array([values for _, values in column], float) for column in columns),
    )


def loop_messages(loop: ClosedLoop, record: TickRecord) -> list[Stamped]:
    """Return the messages of one tick of the closed loop, in the order of `signals`."""
    stamp = loop.timeline.stamp_ns(record.k)
    found = [
        stamped(message, late, stamp)
        for message, late in zip(record.messages, loop.answers.late, strict=True)
    ]
    found[_CLOCK], found[_STATE] = (stamp, ()), (stamp, record.state.values())
    return found


def stamped(message: Any, late: bool, stamp: int) -> Stamped:
    """Return stamp and values of a part's output at the tick with ``stamp``, ns."""
    return (message[0], message[1:]) if late else (stamp, message)
