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

"""Parameters that change during a run: key, value and first tick."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Change(NamedTuple):
    """``node.key`` has ``value`` from ``tick`` on (SI units, as in a scenario)."""

    tick: int
    node: str
    key: str
    value: float


class Agenda:
    """Changes in order of ticks; those of equal ticks in order of arrival."""

    def __init__(self, changes: Iterable[Change]) -> None:
        self._left = sorted(changes, key=lambda change: change.tick)[::-1]
        self.next = self._following()

    def _following(self) -> float:
        return self._left[-1].tick if self._left else float('inf')

    def due(self, tick: int) -> list[Change]:
        """Return the changes up to ``tick`` that have not been returned yet."""
        found = []
        while self._left and self._left[-1].tick <= tick:
            found.append(self._left.pop())
        self.next = self._following()
        return found
