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

"""The loop that drives one participant: when it polls its peers, and when it may sleep."""

from __future__ import annotations

from itertools import count
from types import SimpleNamespace
from typing import Any

from flexarm_ros.nodes.runtime import lockstep
import pytest

MOST = 1000
"""Calls of `drive` after which a loop would go on for ever."""


class Participant:
    """Notes what is called; ends at the second poll."""

    def __init__(self, moves: bool) -> None:
        self.context, self.board = None, SimpleNamespace(going=True)
        self.look_interval, self.finished = 0.0, False
        self.calls: list[str] = []
        self.drive_moves = moves

    def drive(self) -> bool:
        self.calls.append('drive')
        assert len(self.calls) < MOST
        return self.drive_moves

    def run_on(self, *_: Any) -> bool:
        return True

    def poll_peers(self, now: float) -> None:
        self.calls.append('poll')
        self.finished = self.calls.count('poll') == 2

    def max_sleep_s(self, now: float) -> float:
        return 0.1

    def blocked_on(self) -> list[Any]:
        return []


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let nothing sleep; each look at the clock takes 10 ms."""
    clock = SimpleNamespace(monotonic=(0.01 * tick for tick in count()).__next__)
    monkeypatch.setattr(lockstep, 'time', clock)
    monkeypatch.setattr(lockstep, 'Waiter', lambda _: SimpleNamespace(wait=lambda *_: None))


def test_a_message_that_a_poll_has_read_is_used_before_sleeping() -> None:
    """Time limits look for messages as well; nothing wakes a node for one that has been read."""
    participant: Any = Participant(moves=False)
    participant.blocked_on = lambda: participant.calls.append('sleep') or []
    participant.look_interval = 0.05
    lockstep._spin_alone(participant)
    first = participant.calls.index('poll')
    assert participant.calls[first : first + 3] == ['poll', 'drive', 'sleep']


def test_peers_are_polled_although_every_message_is_given_back() -> None:
    participant: Any = Participant(moves=True)
    lockstep._spin_alone(participant)
    assert participant.calls == ['drive', 'poll'] * 2
