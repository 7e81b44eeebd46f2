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

"""Small runs for the tests of bags."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks, loop_messages
from flexarm_ros.wire.topics import per_tick_topics

OPEN_LOOP = ((0.0, 1.0, -2.0), (0.1, 3.5, 0.25), (0.2, -1.0, 1e-3))


def small_config(*overrides: str, duration: float = 0.3, chunk: float = 0.05) -> RunConfig:
    settings = [f'duration={duration}', f'recorder.chunk_time={chunk}', *overrides]
    return scenario.load('fls_tip', settings)


def write_small(directory: Path, config: RunConfig, origin: Provenance | None = None) -> Path:
    """Write the bag of a simulation and return its MCAP file."""
    with BagWriter(directory, config, origin) as writer:
        for block in loop_blocks(ClosedLoop(config)):
            writer.write_block(block)
    return directory / 'bag_0.mcap'


@cache
def small_messages(config: RunConfig) -> tuple[tuple[bytes, ...], ...]:
    """Return the messages of each tick of a simulation."""
    from flexarm_ros.wire.topics import per_tick_topics

    topics = per_tick_topics(config)
    found = []
    for block in loop_blocks(ClosedLoop(config)):
        columns = [
            [t.codec.encode(int(s), *v) for s, v in zip(stamps, values.tolist(), strict=True)]
            for t, stamps, values in zip(topics, block.stamps, block.values, strict=True)
        ]
        found += list(zip(*columns, strict=True))
    return tuple(found)


def read_all(path: Path) -> int:
    """Read whatever there is; anything but a BagError is a failure."""
    try:
        reader = BagReader(path)
        for block in reader.blocks():
            assert len(block)
        count = sum(1 for _ in reader.ticks())
    except BagError as error:
        assert '\n' not in str(error)
        return -1
    assert reader.damage is None or '\n' not in str(reader.damage)
    return count


def write_changed(path: Path, config: RunConfig, late: bool = False) -> Path:
    """Fly ``config`` with its changes and write the bag as the recorder node does."""
    loop = ClosedLoop(config)
    with BagWriter(path / 'bag', replace(config, changes=())) as writer:
        for change in () if late else config.changes:
            writer.write_change(change)
        while (record := loop.tick()) is not None:
            codecs = [topic.codec for topic in per_tick_topics(loop.config)]
            for i, (stamp, values) in enumerate(loop_messages(loop, record)):
                writer.write(i, record.k, codecs[i].encode(stamp, *values))
        for change in config.changes if late else ():
            writer.write_change(change)
    return path
