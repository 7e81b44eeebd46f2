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

"""How a participant leaves its run, without a node: what is published, reported and closed."""

from __future__ import annotations

import time

from flexarm_ros.nodes.runtime.errors import NeverMet, RunFailed
from flexarm_ros.nodes.runtime.joining.status import Phase
from membertools import FakeMember
import pytest


@pytest.fixture
def me() -> FakeMember:
    made = FakeMember()
    made.board.publish(phase=Phase.RUNNING)
    made.board.published.clear()
    made.calls.clear()
    return made


def test_a_complete_run_is_closed_before_it_is_said_to_be_done(me: FakeMember) -> None:
    me.tick = 100
    me.close = lambda: me.calls.append(('close', me.board.mine.phase))  # type: ignore[method-assign]
    me.ending.finish()
    me.ending.finish()
    assert me.calls == [
        ('close', Phase.RUNNING),
        ('report', 'encoder', 'done', 'done after 100 ticks'),
    ]
    (status,) = me.board.published
    assert (status.phase, status.last_tick) == (Phase.DONE, 99)


def test_files_that_cannot_be_completed_are_a_failure(me: FakeMember) -> None:
    def full() -> None:
        raise OSError('disk full')

    me.close = full  # type: ignore[method-assign]
    with pytest.raises(RunFailed, match='tick 0: OSError: disk full') as caught:
        me.ending.finish()
    assert caught.value.blame == 'encoder'
    assert not me.finished
    me.ending.fail(caught.value)
    assert me.board.mine.phase is Phase.FAILED


@pytest.mark.parametrize(
    ('reporter', 'blame', 'line'),
    [
        ('', '', 'no torque'),
        ('', 'controller', 'controller: no torque'),
        ('plant', 'controller', 'ended by the plant: controller: no torque'),
    ],
)
def test_a_failure_names_who_is_blamed_and_who_found_it(
    me: FakeMember, reporter: str, blame: str, line: str
) -> None:
    me.ending.fail(RunFailed(blame, 'no torque', reported_by=reporter))
    assert me.log == [('error', line)]
    (status,) = me.board.published
    assert (status.phase, status.text, status.blame) == (Phase.FAILED, 'no torque', blame)
    assert status.extra == {'heard': 'plant 1'}
    assert me.calls[0] == ('report', 'encoder', 'failed', blame, 'no torque', 0, False)
    assert me.names() == ['close', 'tell', 'flush']


def test_only_the_first_failure_counts(me: FakeMember) -> None:
    me.ending.fail(RunFailed('plant', 'first'))
    me.ending.fail(RunFailed('plant', 'second'))
    assert [status.text for status in me.board.published] == ['first']
    assert me.failure is not None
    assert me.failure.reason == 'first'
    assert me.names().count('close') == 1


def test_a_refused_node_says_so(me: FakeMember) -> None:
    me.peers.refused = True
    me.ending.fail(RunFailed('encoder', 'refused: another'))
    assert me.board.mine.phase is Phase.REFUSED


def test_the_launcher_learns_that_the_nodes_never_met(me: FakeMember) -> None:
    me.ending.fail(NeverMet('', 'start: not connected'))
    assert me.calls[0][-1] is True


def test_an_unexpected_error_is_logged_with_its_traceback(me: FakeMember) -> None:
    me.tick = 4
    try:
        raise ZeroDivisionError('x' * 1000)
    except ZeroDivisionError as error:
        failure = me.ending.failure_of(error)
    assert failure.blame == 'encoder'
    assert failure.reason.startswith('tick 4: ZeroDivisionError: xxx')
    assert len(failure.reason) < 320
    assert 'Traceback' in me.log[0][1]


def test_messages_that_nobody_confirms_are_waited_for_within_limits(me: FakeMember) -> None:
    me.output.acked = False
    began = time.monotonic()
    me.ending.flush(0.0)
    assert time.monotonic() - began < 1.0
    me.side_output.acked = True
    me.output.acked = True
    me.ending.flush()
    assert time.monotonic() - began < 1.0
