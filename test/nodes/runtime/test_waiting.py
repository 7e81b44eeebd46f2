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

"""Time limits of a participant, without a node: when they count, and which node is blamed."""

from __future__ import annotations

import time

from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.status import PACE, Phase
from membertools import FakeMember
import pytest

START, TICK = 20.0, 5.0


@pytest.fixture
def me() -> FakeMember:
    return FakeMember('encoder', f'/**.start_timeout={START}', f'/**.tick_timeout={TICK}')


def test_peers_that_are_not_ready_in_time_are_named(me: FakeMember) -> None:
    now = time.monotonic()
    me.waiting.ready(now)
    me.peers.put('trajectory', Phase.JOINING)
    me.peers.put('controller', Phase.RESETTING)
    me.waiting.check_ready(now + START)
    with pytest.raises(RunFailed, match='trajectory, controller not ready within 20 s') as caught:
        me.waiting.check_ready(now + START + 0.1)
    assert caught.value.blame in ('trajectory', 'controller')


def test_the_plant_is_blamed_where_the_run_does_not_begin(me: FakeMember) -> None:
    now = time.monotonic()
    me.waiting.ready(now)
    me.board.publish(phase=Phase.RUNNING)
    me.waiting.check_running(now + START)
    with pytest.raises(RunFailed, match='start: not begun within 20 s') as caught:
        me.waiting.check_running(now + START + 0.1)
    assert caught.value.blame == 'plant'


def begun(me: FakeMember) -> float:
    """Let the run have begun; return the time of it."""
    now = time.monotonic()
    me.waiting.ready(now)
    me.board.publish(phase=Phase.RUNNING)
    me.peers.put('plant', Phase.RUNNING)
    return now


@pytest.mark.parametrize('by', ['message', 'status'])
def test_a_tick_counts_from_the_first_sign_that_the_run_has_begun(me: FakeMember, by: str) -> None:
    now = begun(me)
    if by == 'message':
        me.peers.put('plant', Phase.READY)
        me.input.tick = 0
    with pytest.raises(RunFailed, match='tick 3: no message on plant/state within 5 s') as caught:
        me.tick = 3
        me.waiting.check_running(now + TICK + 0.6)
    assert caught.value.blame == 'plant'


def test_a_slow_tick_is_shown_before_it_is_too_slow(me: FakeMember) -> None:
    now = begun(me)
    me.waiting.check_running(now + 0.9)
    assert me.missing == ''
    me.waiting.check_running(now + 1.1)
    assert me.missing == 'waiting for plant: no message on plant/state'
    me.waiting.restart()
    me.waiting.check_running(time.monotonic())
    assert me.missing == ''


def test_the_limit_has_the_roles_patience_and_the_plants_pace(me: FakeMember) -> None:
    now = begun(me)
    me.peers.put('plant', Phase.RUNNING, extra={PACE: '3'})
    me.waiting.check_running(now + TICK + 3.0 + 0.4)
    with pytest.raises(RunFailed):
        me.waiting.check_running(now + TICK + 3.0 + 0.6)


@pytest.mark.parametrize('where', ['plant', 'here'])
def test_a_paused_run_has_no_limit(me: FakeMember, where: str) -> None:
    now = begun(me)
    if where == 'plant':
        me.peers.put('plant', Phase.PAUSED)
    else:
        me.board.publish(phase=Phase.PAUSED)
    me.waiting.check_running(now + 1e6)
    begun(me)
    me.waiting.check_running(now + TICK)


def test_a_process_that_was_stopped_waits_for_nothing_meanwhile(me: FakeMember) -> None:
    now = begun(me)
    me.waiting.poll(now + 1e3)  # no poll between: it was this process that stood still
    me.waiting.check_running(now + 1e3 + TICK)
    for step in range(1, 12):
        me.waiting.poll(now + 1e3 + 0.5 * step)
    with pytest.raises(RunFailed):
        me.waiting.check_running(now + 1e3 + TICK + 0.6)


def test_progress_restarts_the_limit_and_keeps_the_longest_wait(me: FakeMember) -> None:
    me.waiting.ready(time.monotonic() - 2.0)
    me.waiting.progress()
    me.waiting.progress()
    assert 2.0 <= me.longest_wait_s < 10.0
    me.peers.put('controller', Phase.JOINING)
    me.waiting.check_ready(time.monotonic() + START - 1.0)


def test_ticks_of_the_fast_path_are_progress(me: FakeMember) -> None:
    now = begun(me)
    me.waiting.advanced(now + 3.0, 0.7)
    me.waiting.advanced(now, 0.1)  # nothing new
    assert (me.waiting.since, me.longest_wait_s) == (now + 3.0, 0.7)
    me.waiting.check_running(now + 3.0 + TICK)
    with pytest.raises(RunFailed, match='within 5 s'):
        me.waiting.check_running(now + 3.0 + TICK + 2.0)
