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

from collections.abc import Callable
from dataclasses import replace
import os
from pathlib import Path
import time
from typing import Any

from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.recording import BAG, finish_run, prepare_directory
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.state import Block

MOST_KEPT = 1 << 16
"""Ticks of a run that are kept in memory (15 MiB); of a longer one the bag is read back."""


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
    # Without a wall clock a free-running scenario is simulated in lock-step.
    config = replace(config, run=replace(config.run, sync='lockstep'))
    loop = ClosedLoop(config)
    prepare_directory(directory, config, name)
    total, interrupted = loop.timeline.ticks, False
    kept: list[Block] | None = []
    with BagWriter(directory / BAG, config, Provenance.here(name)) as writer:
        start = time.perf_counter()
        for block in loop_blocks(loop):
            writer.write_block(block)
            if kept is not None:
                kept.append(block)
            if loop.k > MOST_KEPT:
                kept = None
            watch(loop.k, total)
            if stop():
                interrupted = loop.k < total
                break
        wall_s = time.perf_counter() - start
    unstable = None
    if loop.unstable is not None and loop.unstable_tick is not None:
        unstable = (loop.unstable_tick, loop.unstable)
    problem = f'interrupted at tick {loop.k}' if interrupted else ''
    return finish_run(directory, config, name, wall_s, problem, unstable, blocks=kept)
