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

"""The standard's services and action over the wire, where simulation_interfaces is installed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import threading
from typing import Any

from nodetools import Asker, flexarm, flexarm_here, wait_for
import pytest

REASON = 'simulation_interfaces is not installed (ros-DISTRO-simulation-interfaces)'
action = pytest.importorskip('simulation_interfaces.action', reason=REASON)
msg = pytest.importorskip('simulation_interfaces.msg', reason=REASON)
srv = pytest.importorskip('simulation_interfaces.srv', reason=REASON)
pytestmark = pytest.mark.nodes


@pytest.fixture
def asker(tmp_path: Path, rclpy_node: Any) -> Iterator[Asker]:
    """Fly a run that is paused by the standard's service, and let it end."""
    node, executor = rclpy_node
    ask, done = Asker(node, executor), []
    words = ('run', 'pd_tip', '--set', 'duration=0.5', '--rtf', '0.02', '--no-pictures',
             '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        wait_for(lambda: ask.tick() > 5, 90, 'the run has begun')
        assert set_state(ask, msg.SimulationState.STATE_PAUSED) == msg.Result.RESULT_OK
        yield ask
        assert ask.assign('plant', 'real_time_factor', 0.0).successful
        assert set_state(ask, msg.SimulationState.STATE_PLAYING) == msg.Result.RESULT_OK
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    fresh = flexarm_here('simulate', 'pd_tip', '--set', 'duration=0.5', '--no-pictures',
                         '--out', tmp_path / 'fresh')  # fmt: skip
    assert fresh.returncode == 0, fresh.stderr
    for file in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (tmp_path / 'run' / file).read_bytes() == (tmp_path / 'fresh' / file).read_bytes()


def set_state(ask: Asker, wanted: int) -> int:
    state = msg.SimulationState(state=wanted)
    answer = ask.call(srv.SetSimulationState, '/set_simulation_state', state=state)
    return int(answer.result.result)


def test_states_steps_and_the_action(asker: Asker) -> None:
    from rclpy.action import ActionClient

    told = asker.call(srv.GetSimulatorFeatures, '/get_simulator_features').features
    assert msg.SimulatorFeatures.STEP_SIMULATION_ACTION in told.features
    held = asker.tick()
    answer = asker.call(srv.StepSimulation, '/step_simulation', steps=5)
    assert answer.result.result == msg.Result.RESULT_OK
    assert asker.tick() == held + 5

    client = ActionClient(asker.node, action.SimulateSteps, '/simulate_steps')
    assert client.wait_for_server(20)
    seen: list[tuple[int, int]] = []

    def wait(future: Any) -> Any:
        asker.executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done()
        return future.result()

    def see(update: Any) -> None:
        seen.append((update.feedback.completed_steps, update.feedback.remaining_steps))

    goal = wait(client.send_goal_async(action.SimulateSteps.Goal(steps=20), see))
    assert goal.accepted
    assert wait(goal.get_result_async()).result.result.result == msg.Result.RESULT_OK
    assert asker.tick() == held + 25
    assert seen == [(n, 20 - n) for n in range(1, 21)]

    goal = wait(client.send_goal_async(action.SimulateSteps.Goal(steps=10**6), see))
    second = wait(client.send_goal_async(action.SimulateSteps.Goal(steps=1)))
    assert not second.accepted  # one at a time
    wait(goal.cancel_goal_async())
    ended = wait(goal.get_result_async()).result.result
    assert 'cancelled after' in ended.error_message
    state = asker.call(srv.GetSimulationState, '/get_simulation_state').state.state
    assert state == msg.SimulationState.STATE_PAUSED
    client.destroy()
