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

"""Recorded simulation of the closed loop in one process, as in ``flexarm simulate``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
import os
from pathlib import Path
import time
from typing import Any

from flexarm_ros.bag.blocks import Block
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.recording import BAG, finish_run, prepare_directory
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop, TickRecord
from flexarm_ros.core.run.parts import signals
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.topics import CLOCK, per_tick_topics, STATE
import numpy as np

_BLOCK_TICKS = 512


class BlockMaker:
    """Collects the ticks of a simulation into blocks."""

    def __init__(self, config: RunConfig) -> None:
        widths = [len(topic.codec.fields) for topic in per_tick_topics(config)]
        self._values = [np.empty((_BLOCK_TICKS, width)) for width in widths]
        self._stamps = [np.empty(_BLOCK_TICKS, np.int64) for _ in widths]
        late = [part.LATE for part, _ in signals(config)]
        self._late = [i for i, is_late in enumerate(late) if is_late]
        self._prompt = [
            i for i, is_late in enumerate(late) if not is_late and i not in (CLOCK, STATE)
        ]
        self._timeline = Timeline.of(config.run)
        self._first = 0
        self._count = 0

    @property
    def full(self) -> bool:
        """Whether the block must be taken before the next tick."""
        return self._count == _BLOCK_TICKS

    def add(self, record: TickRecord) -> None:
        """Add one tick."""
        i = self._count
        if i == 0:
            self._first = record.k
        now = self._timeline.stamp_ns(record.k)
        values, stamps = self._values, self._stamps
        values[STATE][i] = record.state.values()
        stamps[CLOCK][i] = stamps[STATE][i] = now
        for place in self._late:
            message = record.messages[place]
            stamps[place][i] = message[0]
            values[place][i] = message[1:]
        for place in self._prompt:
            stamps[place][i] = now
            values[place][i] = record.messages[place]
        self._count += 1

    def take(self) -> Block:
        """Return the collected ticks and start a new block."""
        count, self._count = self._count, 0
        return Block(
            self._first,
            tuple(stamps[:count].copy() for stamps in self._stamps),
            tuple(values[:count].copy() for values in self._values),
        )


def loop_blocks(loop: ClosedLoop) -> Iterator[Block]:
    """Run a closed loop to its end and yield its ticks in blocks."""
    maker = BlockMaker(loop.config)
    while (record := loop.tick()) is not None:
        maker.add(record)
        if maker.full:
            yield maker.take()
    last = maker.take()
    if len(last):
        yield last


def simulate(
    config: RunConfig,
    directory: str | os.PathLike[str],
    name: str = '',
    watch: Callable[[int, int], None] = lambda *_: None,
    stop: Callable[[], bool] = lambda: False,
) -> dict[str, Any]:
    """
    Simulate a scenario in this process, record it in ``directory``, return the summary.

    ``watch(ticks, of all)`` and ``stop()`` are called after every block of 512 ticks.  Raises
    BagExistsError or BagError; ValueError if the core rejects the scenario, before anything
    is written.
    """
    directory = Path(directory)
    # There is no wall clock here to run freely by: each tick is answered.
    config = replace(config, run=replace(config.run, sync='lockstep'))
    loop = ClosedLoop(config)
    prepare_directory(directory, config, name)
    total, interrupted = loop.timeline.ticks, False
    with BagWriter(directory / BAG, config, Provenance.here(name)) as writer:
        start = time.perf_counter()
        for block in loop_blocks(loop):
            writer.write_block(block)
            watch(loop.k, total)
            if stop():
                interrupted = loop.k < total
                break
        wall_s = time.perf_counter() - start
    unstable = None
    if loop.unstable is not None and loop.unstable_tick is not None:
        unstable = (loop.unstable_tick, loop.unstable)
    problem = f'interrupted at tick {loop.k}' if interrupted else ''
    return finish_run(directory, config, name, wall_s, problem, unstable)
