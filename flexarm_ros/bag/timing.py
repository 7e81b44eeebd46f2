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
The timing of a free-running run: taken from its bag, kept beside it as ``timing.csv``.

One row a tick, shortest text that reads back exactly: ``t``, s of simulated time; ``begin`` and
``due``, s of wall time since the first tick was due; ``answers``, the tick that the held command
answers (-1: there is none); ``arrival``, s of the same wall time at which it arrived.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.mcap.files import write_atomically
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.real_time import RunTiming
from flexarm_ros.core.run.state import Block
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.cdr import FloatArray
from flexarm_ros.wire.topics import TIMING, Topic, torque_place
import numpy as np

FILE = 'timing.csv'
COLUMNS = ('t', 'begin', 'due', 'answers', 'arrival')


class TimingLog:
    """Collects the times of a run's ticks while its bag is read."""

    def __init__(self, config: RunConfig, topics: Sequence[Topic]) -> None:
        self._timeline = Timeline.of(config.run)
        names = [topic.name for topic in topics]
        self._place = names.index(TIMING) if TIMING in names else None
        self._torque = torque_place(topics) if TIMING in names else None
        self._rows: list[FloatArray] = []

    def watch(self, blocks: Iterable[Block]) -> Iterator[Block]:
        """Yield the blocks, and keep the times in them."""
        first, period = self._timeline.stamp_ns(0), self._timeline.period_ns
        for block in blocks:
            if self._place is not None and self._torque is not None:
                times, stamps = block.values[self._place], block.stamps[self._torque]
                answers = np.where(stamps > 0, (stamps - first) // period, -1)
                ticks = np.arange(block.first, block.first + len(block))
                seconds = ticks * period / 1e9
                self._rows.append(np.column_stack(
                    (seconds, times[:, 0], times[:, 1], answers, times[:, 2])
                ))  # fmt: skip
            yield block

    @property
    def rows(self) -> FloatArray:
        """Return the `COLUMNS` of every tick, shape ``(n, 5)``."""
        return np.concatenate([np.empty((0, len(COLUMNS))), *self._rows])

    @property
    def timing(self) -> RunTiming | None:
        """Return the run's timing, None if it did not run freely."""
        if self._place is None:
            return None
        return timing_of(self.rows, self._timeline.period_ns / 1e9)

    def write(self, directory: Path) -> None:
        """Write ``timing.csv`` if the run ran freely; BagError if it cannot be written."""
        if self._place is None:
            return
        lines = [','.join(COLUMNS)]
        lines += [','.join([_text(value) for value in row]) for row in self.rows.tolist()]
        write_atomically(directory / FILE, '\n'.join(lines) + '\n')


def _text(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(value)


def timing_of(rows: FloatArray, control_period: float) -> RunTiming:
    """Return the timing of rows with the `COLUMNS`."""
    _, begin, due, answers, arrival = rows.T
    return RunTiming(begin, due, arrival, answers, control_period)


def read_timing(directory: Path) -> RunTiming | None:
    """
    Return the timing of the run in a directory, None if it did not run freely.

    Raises BagContentError for a file of another format.
    """
    path = directory / FILE
    try:
        with open(path, encoding='ascii') as file:
            head = file.readline().rstrip('\n')
            rows = np.loadtxt(file, delimiter=',', ndmin=2) if head else np.empty((0, 0))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        raise BagContentError(f'{path}: cannot be read: {error}') from None
    if head != ','.join(COLUMNS) or (rows.size and rows.shape[1] != len(COLUMNS)):
        raise BagContentError(f'{path}: not the timing of a run')
    rows = rows.reshape(-1, len(COLUMNS))
    period = float(rows[1, 0] - rows[0, 0]) if len(rows) > 1 else 0.0
    return timing_of(rows, period)
