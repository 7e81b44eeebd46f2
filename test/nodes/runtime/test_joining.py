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

"""
A controller on its way into a run whose seat is taken: it is refused, however late it hears.

The controller is in the test's own process and is told what time it is, so that nothing here
depends on how fast the machine is.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticStatus
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining import status
from flexarm_ros.nodes.runtime.joining.status import Phase
from nodetools import ROLES, wait_for, write_scenario
import pytest
from wiretools import Joining

pytestmark = pytest.mark.nodes


@pytest.fixture
def joining(tmp_path: Path, ros_domain: int) -> Iterator[Joining]:
    """Yield a controller that everybody is waiting for, as it thinks."""
    made = Joining(write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3'))
    yield made
    made.close()


def test_a_controller_waits_until_all_in_the_graph_have_said_who_they_are(
    joining: Joining,
) -> None:
    member = joining.second.membership
    assert not member.join(0.0)
    assert not member.join(1.9)
    joining.introduce('9')  # a later identity: that it is ready already is what counts
    joining.hear(len(ROLES))
    with pytest.raises(RunFailed, match=r'refused: another controller \(/first\) takes part'):
        member.join(1.95)
    assert member.refused


def test_who_joins_says_so_again_and_again(joining: Joining) -> None:
    """As a volatile reader shows, which is not told what was said before it was there."""
    node, mine = joining.second, joining.second.board.mine
    late = joining.first.node.create_subscription(
        DiagnosticStatus, status.TOPIC, lambda _: None, 9
    )

    def heard() -> bool:
        node.poll_peers(time.monotonic())
        taken = late.handle.take_message(DiagnosticStatus, False)
        return taken is not None and taken[0].hardware_id == mine.identity

    wait_for(heard, 60, 'told again')
    assert node.board.mine.phase is Phase.JOINING


def test_it_does_not_wait_for_ever(joining: Joining) -> None:
    member = joining.second.membership
    assert not member.join(0.0)
    assert member.join(2.1)


def test_a_run_that_has_begun_is_not_joined(joining: Joining) -> None:
    member = joining.second.membership
    assert not member.join(0.0)
    joining.peers.boards['plant'].publish(phase=Phase.RUNNING)

    def running() -> bool:
        joining.second.board.update()
        plant = member.status_of('plant')
        return plant is not None and plant.phase is Phase.RUNNING

    wait_for(running, 60, 'the plant runs')
    with pytest.raises(RunFailed, match='refused: this run has begun already'):
        member.join(0.1)
    assert member.refused
