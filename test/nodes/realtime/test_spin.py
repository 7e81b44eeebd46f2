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

"""The loop of composed nodes: what shares a thread, and what a tick waits for."""

from __future__ import annotations

import threading
from types import SimpleNamespace
from typing import Any

from flexarm_ros.nodes.runtime import lockstep
from flexarm_ros.nodes.runtime.participant import Participant
import pytest

ROLES = ('plant', 'encoder', 'recorder')


class Fake:
    """A participant that leaves its run at its third poll; ``calls`` are shared."""

    look_interval, under_way, context = 0.0, True, None

    def __init__(self, role: str, sync: str, calls: list[tuple[str, str, int]]) -> None:
        self.ROLE, self._calls, self._polls = role, calls, 0
        self.config = SimpleNamespace(run=SimpleNamespace(sync=sync))
        self.board = SimpleNamespace(going=True)

    @property
    def finished(self) -> bool:
        return self._polls >= 3

    def _note(self, what: str) -> None:
        self._calls.append((what, self.ROLE, threading.get_ident()))

    def drive(self) -> bool:
        self._note('drive')
        return False

    def poll_peers(self, _now: float) -> None:
        self._note('poll')
        self._polls += 1

    def max_sleep_s(self, _now: float) -> float:
        return 0.0

    def blocked_on(self) -> list[Any]:
        return []


def spun(monkeypatch: pytest.MonkeyPatch, sync: str) -> list[tuple[str, str, int]]:
    """Return what was called in a process of three nodes, in order, with the thread."""
    waiter = SimpleNamespace(wait=lambda *_: None)
    monkeypatch.setattr(lockstep, 'Waiter', lambda _context: waiter)
    calls: list[tuple[str, str, int]] = []
    nodes: Any = [Fake(role, sync, calls) for role in ROLES]
    lockstep.spin(nodes)
    assert all(node.finished for node in nodes)
    return calls


@pytest.mark.parametrize('sync', ['free', 'lockstep'])
def test_the_recorder_of_a_free_run_has_its_own_thread(
    sync: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads = {role: thread for _, role, thread in spun(monkeypatch, sync)}
    assert threads['plant'] == threads['encoder'] == threading.get_ident()
    assert (threads['recorder'] == threads['plant']) == (sync == 'lockstep')


def test_a_tick_waits_for_one_poll_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = [(what, role) for what, role, _ in spun(monkeypatch, 'lockstep')]
    polled = [i for i, (what, _) in enumerate(calls) if what == 'poll']
    assert len(polled) == 9
    for first, second in zip(polled, polled[1:], strict=False):
        assert ('drive', 'plant') in calls[first:second]
    assert [role for what, role in calls if what == 'poll'][:3] == list(ROLES)


@pytest.mark.parametrize('near', [True, False])
def test_copies_of_messages_passed_directly_wake_no_node(near: bool) -> None:
    missing = SimpleNamespace(near=near, handle='topic')
    node: Any = SimpleNamespace(_missing=missing, board=SimpleNamespace(going=True))
    assert Participant.blocked_on(node) == ([] if near else ['topic'])
