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
One node of a real run with its costs told: ``python -m bench.traced ROLE OUT ...``.

Counts the processor time from the first tick to the last of this process and of the thread that
drives the lock-step, and by wrapping the calls in question what part each has in it.  With
``FLEXARM_BENCH_PLAIN`` in the environment nothing is wrapped and only the totals are told.
"""

from __future__ import annotations

from collections.abc import Callable
import json
import os
from pathlib import Path
import sys
import time
from typing import Any

from bench.launch import PLAIN
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.nodes import process
from flexarm_ros.nodes.runtime import ending, participant
from flexarm_ros.nodes.runtime.member import Member
from flexarm_ros.nodes.runtime.topics import channels
from flexarm_ros.wire import fused_step

PARTS: dict[str, int] = {}
"""Part -> nanoseconds of processor time."""


def timed(function: Callable[..., Any], part: str) -> Callable[..., Any]:
    """Return ``function`` with its processor time added to ``part``."""
    PARTS.setdefault(part, 0)
    clock = time.thread_time_ns

    def call(*args: Any) -> Any:
        start = clock()
        try:
            return function(*args)
        finally:
            PARTS[part] += clock() - start

    return call


class Meter:
    """Notes the clocks when the first node of this process starts and when the last ends."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._start: tuple[float, ...] = ()
        self._parts: dict[str, int] = {}

    def _now(self) -> tuple[float, ...]:
        return time.monotonic(), time.process_time(), time.thread_time()

    def begin(self) -> None:
        """Note the start, once."""
        if not self._start:
            self._start, self._parts = self._now(), dict(PARTS)

    def end(self, node: Member) -> None:
        """Write what has been used since the start; the last node's word stands."""
        wall, cpu, thread = (b - a for a, b in zip(self._start, self._now(), strict=True))
        parts = {part: (ns - self._parts.get(part, 0)) * 1e-9 for part, ns in PARTS.items()}
        facts = {'wall_s': wall, 'cpu_s': cpu, 'thread_s': thread, 'ticks': node.tick}
        self._out.write_text(json.dumps({**facts, 'parts': parts}), encoding='utf-8')


def hook(meter: Meter, role: str) -> None:
    """Let every participant of this process tell the meter when it begins and ends."""
    drive, finish = participant.Participant.drive, ending.Ending.finish
    moves = 2 if role == 'trajectory' else 1  # its first move comes before tick 0

    def driven(self: participant.Participant) -> bool:
        nonlocal moves
        moved = drive(self)
        moves -= moved
        if moves <= 0:
            meter.begin()
            participant.Participant.drive = drive  # type: ignore[method-assign]
        return moved

    def finishing(self: ending.Ending) -> None:
        if self._me.ROLE in (role, 'plant'):
            meter.end(self._me)
        finish(self)

    participant.Participant.drive = driven  # type: ignore[method-assign]
    ending.Ending.finish = finishing  # type: ignore[method-assign]


def wrap() -> None:
    """Time the calls of the hot path, each as a part of its own."""
    for owner, name, part in (
        (BagWriter, 'write_ticks', 'recording'),
        (channels.Input, '_take_plain', 'taking'),
        (channels.Input, '_judge_block', 'taking'),
    ):
        setattr(owner, name, timed(getattr(owner, name), part))
    bind = fused_step.bound
    fused_step.bound = lambda *args, **words: timed(bind(*args, **words), 'loops')


def main(role: str, out: str, rest: list[str]) -> int:
    """Run the node with a ROS command line."""
    hook(Meter(Path(out)), role)
    if PLAIN not in os.environ:
        wrap()
    return process.run_process(role, rest)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1], sys.argv[2], sys.argv[3:]))
