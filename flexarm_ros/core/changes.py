"""Parameters that change while a run goes on: what, to which value, from which tick on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple


class Change(NamedTuple):
    """``node.key`` has ``value`` from ``tick`` on (in SI units, as in a scenario)."""

    tick: int
    node: str
    key: str
    value: float


class Agenda:
    """Changes in order of ticks; of equal ticks in the order that they came in."""

    def __init__(self, changes: Iterable[Change]) -> None:
        self._left = sorted(changes, key=lambda change: change.tick)[::-1]
        self.next = self._following()

    def _following(self) -> float:
        return self._left[-1].tick if self._left else float("inf")

    def due(self, tick: int) -> list[Change]:
        """Return the changes up to ``tick`` that have not been returned before."""
        found = []
        while self._left and self._left[-1].tick <= tick:
            found.append(self._left.pop())
        self.next = self._following()
        return found
