#!/usr/bin/env python3
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
Measure the bag's compressions and chunk lengths; prints the table of docs/bag.md.

    .venv/bin/python scripts/bag_table.py [--scenario fls_tip] [--seconds 16]

Processor time, not wall time: what the recorder takes from the nodes beside it, little
disturbed by what else the machine does.  The messages are those of a real run, so that
they compress as such do; they are made before the clock starts.
"""

from __future__ import annotations

import argparse
import gc
from pathlib import Path
import tempfile
import time

from flexarm_ros import scenario
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.wire.topics import per_tick_topics

SETTINGS = [
    (name, chunk) for name in ('none', 'lz4', 'zstd') for chunk in (0.05, 0.1, 0.2, 0.5, 2.0)
]
ROUNDS = 3


def messages_of(config: RunConfig) -> list[list[bytes]]:
    """Return the messages of every tick of a flight, in canonical order."""
    topics = per_tick_topics(config)
    ticks: list[list[bytes]] = []
    for block in loop_blocks(ClosedLoop(config)):
        columns = [
            [t.codec.encode(int(s), *v) for s, v in zip(stamps, values.tolist(), strict=True)]
            for t, stamps, values in zip(topics, block.stamps, block.values, strict=True)
        ]
        ticks += [list(messages) for messages in zip(*columns, strict=True)]
    return ticks


def measure(
    directory: Path, config: RunConfig, ticks: list[list[bytes]]
) -> tuple[float, float, float]:
    """Return CPU time a tick (us), size a tick (bytes) and the longest call (ms, CPU time)."""
    clock, longest = time.thread_time, 0.0
    writer = BagWriter(directory, config)
    front = writer._file.size
    begun = clock()
    for tick, messages in enumerate(ticks):
        start = clock()
        for topic, data in enumerate(messages):
            writer.write(topic, tick, data)
        longest = max(longest, clock() - start)
    spent = clock() - begun
    size = writer._file.size - front
    writer.close()
    return spent / len(ticks) * 1e6, size / len(ticks), longest * 1e3


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--scenario', default='fls_tip')
    parser.add_argument('--seconds', type=float, default=16.0, help='simulated (default 16)')
    args = parser.parse_args()
    base = [f'duration={args.seconds}']
    ticks = messages_of(scenario.load(args.scenario, base))
    raw = sum(map(len, ticks[0]))
    print(f'{args.scenario}: {len(ticks)} ticks of {len(ticks[0])} messages, {raw} bytes a tick;')
    print(f'the best of {ROUNDS} rounds (time), the worst (longest call)\n')
    print('| compression | chunk_time, s | CPU, us a tick | bytes a tick | longest call, ms |')
    print('|---|---|---|---|---|')
    default = scenario.load(args.scenario).recorder
    for compression, chunk in SETTINGS:
        own = [f'recorder.compression={compression}', f'recorder.chunk_time={chunk}']
        config = scenario.load(args.scenario, [*base, *own])
        found = []
        for _ in range(ROUNDS):
            gc.collect()
            with tempfile.TemporaryDirectory() as folder:
                found.append(measure(Path(folder) / 'bag', config, ticks))
        cpu, size, longest = min(f[0] for f in found), found[0][1], max(f[2] for f in found)
        mark = (
            ' (default)'
            if (compression, chunk) == (default.compression, default.chunk_time)
            else ''
        )
        print(
            f'| {compression}{mark} | {chunk:g} | {cpu:.1f} | {size:.0f} | {longest:.1f} |',
            flush=True,
        )


if __name__ == '__main__':
    main()
