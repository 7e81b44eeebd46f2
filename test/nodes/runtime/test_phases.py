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

"""The phases of a participant, without a node: joining, reset, the end as the plant tells it."""

from __future__ import annotations

import time

from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.status import EPOCH, Phase
from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S, JOIN_INTERVAL_S
from membertools import Calls, FakeMember, Side
import pytest


@pytest.fixture
def me() -> FakeMember:
    return FakeMember()


@pytest.fixture
def running(me: FakeMember) -> FakeMember:
    me.inputs['plant/state'].configure = me.outputs['joint_states'].configure = lambda *_: None
    me.phases.poll(time.monotonic())
    me.peers.put('plant', Phase.RUNNING)
    me.calls.clear()
    return me


def test_a_node_is_built_once_all_agree_and_ready_once_all_are_connected(me: FakeMember) -> None:
    configured = []
    me.inputs['plant/state'].configure = lambda topic, _: configured.append(topic.name)
    me.outputs['joint_states'].configure = lambda topic, _: configured.append(topic.name)
    now = time.monotonic()
    me.peers.joined = False
    me.phases.poll(now)
    assert me.names() == []
    me.peers.joined, me.peers.matching = True, False
    me.phases.poll(now)
    assert me.names() == ['make_endpoints', 'restore', 'build', 'warm_up']
    assert configured == ['plant/state', 'joint_states']
    assert me.peers.built
    assert me.board.mine.phase is Phase.JOINING
    me.peers.matching = True
    me.phases.poll(now)
    assert me.names().count('build') == 1
    assert me.peers.locked
    assert [status.phase for status in me.board.published] == [Phase.READY, Phase.RUNNING]


@pytest.mark.parametrize(('external', 'prepared'), [(set(), 0), ({'plant'}, 1)])
def test_another_layout_is_prepared_for_before_tick_0(
    me: FakeMember, external: set[str], prepared: int
) -> None:
    me.inputs['plant/state'].configure = me.outputs['joint_states'].configure = lambda *_: None
    me.input.topic.codec = Calls(me.calls)
    me.peers.external |= external
    me.phases.poll(time.monotonic())
    assert me.names().count('prepare_any') == prepared


def test_a_subscription_that_gets_nothing_is_named_in_the_log(me: FakeMember) -> None:
    me.inputs['plant/state'].configure = me.outputs['joint_states'].configure = lambda *_: None
    me.peers.deaf['/plot: best effort'] = None
    me.phases.poll(time.monotonic())
    assert me.log == [('warning', 'a subscription gets no messages: /plot: best effort')]


@pytest.mark.parametrize('phase', [Phase.READY, Phase.RESETTING, Phase.RUNNING])
def test_a_failed_peer_ends_the_run_in_every_phase(running: FakeMember, phase: Phase) -> None:
    running.board.publish(phase=phase)
    running.peers.failure = RunFailed('tip_sensor', 'its reason', reported_by='tip_sensor')
    with pytest.raises(RunFailed, match='its reason'):
        running.phases.poll(time.monotonic())


def test_a_running_node_polls_less_often_and_repeats_its_progress(running: FakeMember) -> None:
    running.tick = 7
    running.phases.poll(time.monotonic())
    assert running.look_interval == HOUSEKEEPING_S
    assert running.side_output.told == [7]


def test_a_reset_goes_through_every_step_and_drains_the_queues(running: FakeMember) -> None:
    running.tick, running.last_tick = 50, 99
    running.peers.put('plant', Phase.RESETTING, extra={EPOCH: '1'})
    running.phases.poll(time.monotonic())
    assert (running.tick, running.last_tick, running.epochs.number) == (0, None, 1)
    assert running.look_interval == JOIN_INTERVAL_S
    assert running.names() == ['restore', 'build']
    assert running.input.done[-1] == 'reset'
    assert running.board.mine.phase is Phase.RESETTING
    assert running.board.mine.extra[EPOCH] == '1'
    running.phases.poll(time.monotonic())  # the others are still in the run before
    assert running.board.mine.phase is Phase.RESETTING
    assert 'drain' not in running.input.done
    for role in running.peers.required():
        running.peers.put(role, Phase.RESETTING, extra={EPOCH: '1'})
    running.phases.poll(time.monotonic())
    assert running.input.done[-1] == running.side_input.done[-1] == 'drain'
    assert running.board.mine.phase is Phase.RUNNING


def test_an_external_node_does_not_hold_up_a_reset(running: FakeMember) -> None:
    running.peers.put('plant', Phase.RESETTING, extra={EPOCH: '1'})
    running.phases.poll(time.monotonic())
    for role in running.peers.required():
        running.peers.put(role, Phase.RESETTING, extra={EPOCH: '1'})
    del running.peers.held['controller']
    running.peers.external.add('controller')
    running.phases.poll(time.monotonic())
    assert running.board.mine.phase is Phase.RUNNING


@pytest.mark.parametrize(('told', 'last'), [(41, 41), (10**9, 99)])
def test_the_plant_ends_the_run_at_its_tick(running: FakeMember, told: int, last: int) -> None:
    running.peers.put('plant', Phase.DONE, last_tick=told)
    running.tick = last
    running.phases.poll(time.monotonic())
    assert running.last_tick == last
    assert not running.finished
    running.tick = last + 1
    running.phases.poll(time.monotonic())
    assert running.finished
    assert running.board.mine.phase is Phase.DONE


def test_an_error_in_a_service_ends_the_run(running: FakeMember) -> None:
    running.crashed = 'ZeroDivisionError: x'
    with pytest.raises(RunFailed, match='tick 0: in a service: ZeroDivisionError: x'):
        running.phases.poll(time.monotonic())


@pytest.mark.parametrize('way', ['signal', 'launcher'])
def test_a_request_to_leave_comes_before_everything_else(running: FakeMember, way: str) -> None:
    asked = []
    running.interrupt = lambda: asked.append(way)  # type: ignore[method-assign]
    running.interrupted = int(way == 'signal')
    running.supervisor.gone = way == 'launcher'
    running.peers.failure = RunFailed('plant', 'another reason')
    running.phases.poll(time.monotonic())
    assert asked == [way]


def test_every_endpoint_is_looked_at(me: FakeMember) -> None:
    me.peers.joined = False
    further = me.outputs['further'] = Side()
    me.phases.poll(time.monotonic())
    assert me.input.done == me.output.done == further.done == ['look']
