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

"""Torques from a table: free and forced motions."""

from __future__ import annotations

from itertools import pairwise

from flexarm_ros.core.control.feedback import limited
from flexarm_ros.core.control.law import Law, Sample
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import NS_PER_S, Timeline
import numpy as np

Row = tuple[float, float, float]


class OpenLoopLaw(Law):
    """
    Rows (t, tau1, tau2), interpolated linearly at the middle of each tick and held.

    Before the first and after the last row that row's torques apply.  Two rows
    of equal time make a step.
    """

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        check_torques(config.torques)
        self.table: FloatArray = np.array(config.torques, float)
        self._period_ns = Timeline.of(config.run).period_ns

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        limit = self.config.controller.torque_limit
        torque: tuple[float, float] = torque_at(self.table, k, self._period_ns, limit)
        return torque

    def torques(self, first: int, count: int) -> FloatArray:
        """Return tau1, tau2 (N m) of ``count`` ticks from ``first`` on, shape ``(count, 2)``."""
        out = np.empty((count, 2))
        limit = self.config.controller.torque_limit
        fill_torques(self.table, first, self._period_ns, limit, out)
        return out


@compiled
def fill_torques(
    table: FloatArray, first: int, period_ns: int, limit: float, out: FloatArray
) -> None:
    """Set the rows of ``out`` to `torque_at` of the ticks from ``first`` on."""
    for i in range(len(out)):
        out[i, 0], out[i, 1] = torque_at(table, first + i, period_ns, limit)


@compiled
def torque_at(table: FloatArray, k: int, period_ns: int, limit: float) -> tuple[float, float]:
    """Return tau1, tau2 of tick ``k`` from ``table`` (n, 3), rows t, tau1, tau2 in order of t."""
    time = (2 * k + 1) * period_ns / (2 * NS_PER_S)
    after, end = 0, table.shape[0]  # the first row later than ``time``
    while after < end:
        middle = (after + end) // 2
        if table[middle, 0] <= time:
            after = middle + 1
        else:
            end = middle
    before = max(after - 1, 0)
    tau1, tau2 = table[before, 1], table[before, 2]
    if 0 < after < table.shape[0]:
        start = table[before, 0]
        part = (time - start) / (table[after, 0] - start)
        tau1 += part * (table[after, 1] - tau1)
        tau2 += part * (table[after, 2] - tau2)
    return limited(tau1, limit), limited(tau2, limit)


def check_torques(rows: tuple[Row, ...]) -> None:
    """Raise ``ValueError``, naming the key, for a table that is empty or not sorted by time."""
    if not rows:
        raise ValueError('controller.torque_file: missing or empty, needed by law open_loop')
    for number, (before, after) in enumerate(pairwise(rows), start=2):
        if after[0] < before[0]:
            raise ValueError(
                f'controller.torque_file: row {number}: t = {after[0]!r} s after {before[0]!r} s, '
                'times must not decrease'
            )
