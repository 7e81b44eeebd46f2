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
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import NS_PER_S, Timeline

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
        self._rows = config.torques
        self._period_ns = Timeline.of(config.run).period_ns
        self._next = 0

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        time = (2 * k + 1) * self._period_ns / (2 * NS_PER_S)
        rows = self._rows
        while self._next < len(rows) and rows[self._next][0] <= time:
            self._next += 1
        tau1, tau2 = _between(rows, self._next, time)
        limit = self.config.controller.torque_limit
        return limited(tau1, limit), limited(tau2, limit)


def _between(rows: tuple[Row, ...], following: int, time: float) -> tuple[float, float]:
    if following == 0 or following == len(rows):
        row = rows[max(following - 1, 0)]
        return row[1], row[2]
    (t0, a0, b0), (t1, a1, b1) = rows[following - 1], rows[following]
    part = (time - t0) / (t1 - t0)
    return a0 + part * (a1 - a0), b0 + part * (b1 - b0)


def check_torques(rows: tuple[Row, ...]) -> None:
    """Raise ``ValueError``, naming the key, for a table that is empty or not sorted by time."""
    if not rows:
        raise ValueError('controller.torque_file: missing or empty, needed by law open_loop')
    for number, (before, after) in enumerate(pairwise(rows), start=2):
        if after[0] < before[0]:
            raise ValueError(
                f'controller.torque_file: row {number}: t = {after[0]!r} s after {before[0]!r} s, '
                'times must not fall'
            )
