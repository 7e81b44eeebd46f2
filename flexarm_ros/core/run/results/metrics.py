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
The metrics of ``summary.json``, from rows of ``trajectory.csv``, in constant memory.

Errors are distances (m) from the undelayed reference: ``rigid`` is the rigid kinematics of the
joint angles, ``tip`` the tip of the bent arm.  The root mean square is over the ticks.  An
overshoot is the distance (m) by which the point passes a corner in the direction before the switch
within one second of it, both ends included, 0 if it does not pass it; there is one value per
direction switch.  Differences within the rounding error of the kinematics count as zero.
"""

from __future__ import annotations

from collections.abc import Collection
import math
from typing import Any

from flexarm_ros.core.arm.kinematics import round_off
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.run.results.metric_list import NAMES
from flexarm_ros.core.run.results.trajectory_rows import Row
from flexarm_ros.core.timeline import NS_PER_S, Timeline
from flexarm_ros.core.trajectory import make_path, Switch
import numpy as np

WINDOW_NS = NS_PER_S
"""Time after a switch within which its overshoot is evaluated."""

_BLOCK = 256
_AT = {name: index for index, name in enumerate(COLUMNS)}
_DELTA, _TORQUE, _REFERENCE = _AT['delta1'], _AT['tau1'], _AT['ref_x']
_TIP, _RIGID = _AT['tip_x'], _AT['rigid_x']

_round_off = compiled(round_off)


class Metrics:
    """
    Accumulates rows in order of time; :meth:`result` may be called at any time.

    ``external``: roles of external nodes.  The direction switches of an external trajectory are
    unknown, so that there are no overshoots.
    """

    def __init__(self, config: RunConfig, external: Collection[str] = ()) -> None:
        self._switches_known = 'trajectory' not in external
        timeline = Timeline.of(config.run)
        self._period_ns, self._end_ns = timeline.period_ns, timeline.duration_ns
        self._path, self._lengths = make_path(config), config.plant.spans
        self._sums: FloatArray = np.zeros(6)
        self._rows: list[Row] = []
        self._done = 0
        self._first_open = 0
        self._overshoot: list[float] = []
        self._tip_overshoot: list[float] = []

    @property
    def ticks(self) -> int:
        """Number of rows so far."""
        return self._done + len(self._rows)

    def add(self, row: Row) -> None:
        """Add the row of the next tick."""
        self._rows.append(row)
        if len(self._rows) == _BLOCK:
            self._flush()

    def add_table(self, table: FloatArray) -> None:
        """Take the rows of the next ticks, shape ``(n, 20)`` or more columns."""
        self._flush()
        self._take(table)

    def _flush(self) -> None:
        if self._rows:
            self._take(np.array(self._rows))
            self._rows.clear()

    def _take(self, block: FloatArray) -> None:
        accumulate(self._sums, block, self._lengths)
        self._watch_corners(block)
        self._done += len(block)

    def _switch(self, index: int) -> Switch | None:
        """Return the switch ``index`` of the run, ``None`` past its end."""
        switch = self._path.switch(index) if self._switches_known else None
        return switch if switch is not None and switch.time_ns < self._end_ns else None

    def _watch_corners(self, block: FloatArray) -> None:
        """Update the overshoot of every switch whose second overlaps ``block``."""
        index = self._first_open
        while (switch := self._switch(index)) is not None:
            first = -(-switch.time_ns // self._period_ns) - self._done
            last = (switch.time_ns + WINDOW_NS) // self._period_ns - self._done
            if first >= len(block):
                return
            if last < 0:
                self._first_open = index + 1
            if index == len(self._overshoot):
                self._overshoot.append(0.0)
                self._tip_overshoot.append(0.0)
            start, end = max(first, 0), max(last + 1, 0)
            seen = block[start:end]
            for values, column in ((self._overshoot, _RIGID), (self._tip_overshoot, _TIP)):
                values[index] = max(values[index], farthest(seen, column, switch))
            index += 1

    def result(self) -> dict[str, Any]:
        """
        Return the metrics by `NAMES`, ``None`` for a value that is not finite or unknown.

        The overshoot of a switch that was not reached is ``None``.
        """
        self._flush()
        count = self._done
        rms, largest, tip_rms, tip_largest, deflection, torque = self._sums.tolist()
        values = (
            _known(rms / count if count else math.nan, root=True),
            _known(largest if count else math.nan, root=True),
            _known(tip_rms / count if count else math.nan, root=True),
            _known(tip_largest if count else math.nan, root=True),
            self._padded(self._overshoot),
            max(map(_finite_or_zero, self._overshoot), default=None),
            self._padded(self._tip_overshoot),
            _known(deflection if count else math.nan),
            _known(torque if count else math.nan),
            count,
        )
        return dict(zip(NAMES, values, strict=True))

    def _padded(self, values: list[float]) -> list[float | None]:
        padded = [_known(value) for value in values]
        while self._switch(len(padded)) is not None:
            padded.append(None)
        return padded


def _known(value: float, root: bool = False) -> float | None:
    if not math.isfinite(value):
        return None
    return math.sqrt(value) if root else value


def _finite_or_zero(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def farthest(block: FloatArray, column: int, switch: Switch) -> float:
    """Return how far the point in ``block[:, column:column + 2]`` passes the corner, m."""
    result: float = _farthest(
        block, column, switch.x, switch.y, switch.along_x, switch.along_y
    )  # fmt: skip
    return result


@compiled
def _farthest(
    block: FloatArray, column: int, x: float, y: float, along_x: float, along_y: float
) -> float:
    most = 0.0
    for i in range(block.shape[0]):
        past = (block[i, column] - x) * along_x + (block[i, column + 1] - y) * along_y
        most = max(most, past)
    return most


@compiled
def accumulate(sums: FloatArray, block: FloatArray, lengths: tuple[float, float]) -> None:
    """
    Add rows ``(n, 20)`` to ``sums`` ``(6,)``, in order.

    Sum and largest of the squared error of ``rigid``, the same of ``tip``, the
    largest deflection and the largest torque.
    """
    for i in range(block.shape[0]):
        ref_x, ref_y = block[i, _REFERENCE], block[i, _REFERENCE + 1]
        dx, dy = block[i, _RIGID] - ref_x, block[i, _RIGID + 1] - ref_y
        rigid = dx * dx + dy * dy
        noise = _round_off(lengths, math.sqrt(ref_x * ref_x + ref_y * ref_y))
        noise *= noise
        rigid = 0.0 if rigid <= noise else rigid
        dx, dy = block[i, _TIP] - ref_x, block[i, _TIP + 1] - ref_y
        tip = dx * dx + dy * dy
        tip = 0.0 if tip <= noise else tip
        sums[0] += rigid
        sums[1] = max(sums[1], rigid)
        sums[2] += tip
        sums[3] = max(sums[3], tip)
        for j in (0, 1):
            sums[4] = max(sums[4], abs(block[i, _DELTA + j]))
            sums[5] = max(sums[5], abs(block[i, _TORQUE + j]))
