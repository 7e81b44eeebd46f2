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
"""``flexarm doctor``, and what a node asks of the system."""

from __future__ import annotations

import errno
import gc
import json
import os
import sys

from flexarm_ros.cli import main
from flexarm_ros.nodes.realtime import system
from flexarm_ros.nodes.realtime.measure import bare_jitter
import pytest


def test_it_tells_what_is_allowed_and_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['doctor', '--duration', '0.05']) == 0
    text = capsys.readouterr().out
    for word in ('CPUs', 'SCHED FIFO', 'locked memory', 'PREEMPT_RT', 'ticks at 1000 Hz'):
        assert word in text
    assert main(['doctor', '--duration', '0.05', '--rate', '200', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    measured = found['timing']['default priority']
    assert measured['rate_hz'] == 200.0
    assert 0 <= measured['late_ticks'] <= measured['ticks']
    assert measured['p50'] <= measured['p99'] <= measured['max']


@pytest.mark.parametrize('words', [['--duration', '0'], ['--rate', 'x'], ['--rate', 'nan']])
def test_a_bad_option_is_named(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['doctor', *words]) == 2
    assert words[0] in capsys.readouterr().err


def test_the_bare_loop_never_wakes_early() -> None:
    assert (bare_jitter(200_000, 20) >= 0.0).all()


@pytest.fixture
def collector(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep this process's garbage collector and its threads' turns as they are."""
    for name in ('freeze', 'disable'):
        monkeypatch.setattr(gc, name, lambda: None)
    monkeypatch.setattr(sys, 'setswitchinterval', lambda _: None)


def test_what_is_refused_is_said(collector: None, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(os, 'sched_setscheduler', refuse)
    monkeypatch.setattr(os, 'sched_setaffinity', refuse)
    monkeypatch.setattr(system, 'can_lock', lambda: False)
    priority, cpu, memory, collected = system.ask(10, 0, True)
    assert priority.startswith('SCHED_FIFO 10 not allowed (Operation not permitted; RLIMIT_RTPRIO')
    assert cpu.startswith('CPU 0 not allowed')
    assert memory.startswith('memory not locked (RLIMIT_MEMLOCK')
    assert collected == 'garbage collector off'
    assert not system.can_prioritise(1)


def test_what_is_granted_is_said(collector: None, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []
    monkeypatch.setattr(os, 'sched_setscheduler', lambda *given: asked.append(given))
    monkeypatch.setattr(os, 'sched_setaffinity', lambda *given: asked.append(given))
    assert system.ask(7, 1, False) == ['SCHED_FIFO 7', 'CPU 1', 'garbage collector off']
    assert [given[1] for given in asked] == [os.SCHED_FIFO, {1}]
    assert system.ask(0, -1, False) == ['garbage collector off']
