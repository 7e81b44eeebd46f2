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

"""Run control: pause, step, speed, reset; a reset run gives the bytes of a fresh one."""

from __future__ import annotations

from pathlib import Path
import threading
from typing import Any

from flexarm_ros.bag.checks.verify import verify
from nodetools import Asker, flexarm, flexarm_here, wait_for
import pytest

pytestmark = pytest.mark.nodes


def caller(rclpy_node: Any, **kinds: Any) -> Any:
    """Return a function that calls a service of the plant by its name, of the types ``kinds``."""
    node, executor = rclpy_node
    clients = {name: node.create_client(kind, f'/plant/{name}') for name, kind in kinds.items()}

    def call(name: str, **request: object) -> Any:
        assert clients[name].wait_for_service(60)
        future = clients[name].call_async(kinds[name].Request(**request))
        executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done(), name
        return future.result()

    return call


def test_pause_step_speed_and_reset(tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import SetParameters
    from std_srvs.srv import SetBool, Trigger

    call = caller(
        rclpy_node, pause=SetBool, step=Trigger, reset=Trigger, state=Trigger,
        set_parameters=SetParameters,
    )  # fmt: skip

    def tick() -> int:
        return int(call('state').message.split('tick ')[1].split(',')[0])

    def paused() -> bool:
        return call('state').message.startswith('paused')

    done = []
    words = ('run', 'pd_tip', '--set', 'duration=1.0', '--rtf', '0.05', '--no-pictures',
             '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        wait_for(lambda: tick() > 20, 60, 'the run has begun')
        assert not call('step').success  # not paused
        assert call('pause', data=True).success
        before = tick()
        wait_for(paused, 60, 'the plant says that it is paused')
        held = tick()
        assert held - before <= 1
        for _ in range(3):
            assert call('step').success
        wait_for(paused, 60, 'the steps are done')
        assert tick() == held + 3
        ask = Asker(*rclpy_node)
        assert ask.assign('controller', 'kp', 80.0).successful
        assert ask.get('controller', 'kp') == 80.0
        assert call('reset').success
        assert call('pause', data=False).success
        assert tick() < held
        wait_for(lambda: tick() > held, 60, 'the run goes on after the reset')
        assert ask.get('controller', 'kp') == 150.79  # as a fresh run has it
        fast = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=0.0)
        change = [Parameter(name='real_time_factor', value=fast)]
        assert call('set_parameters', parameters=change).results[0].successful
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    assert (tmp_path / 'run' / 'bag-before-reset-1' / 'metadata.yaml').exists()
    fresh = flexarm_here('simulate', 'pd_tip', '--set', 'duration=1.0', '--no-pictures',
                         '--out', tmp_path / 'fresh')  # fmt: skip
    assert fresh.returncode == 0, fresh.stderr
    for file in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (tmp_path / 'run' / file).read_bytes() == (tmp_path / 'fresh' / file).read_bytes()


def test_a_composed_free_run_is_reset(tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    """Its recorder, on a thread of its own, begins again with the others."""
    from std_srvs.srv import SetBool, Trigger

    call = caller(rclpy_node, reset=Trigger, pause=SetBool, state=Trigger)
    done = []
    words = ('run', 'pd_tip', '--compose', '--set', 'sync=free', '--set', 'trajectory.kind=hold',
             '--set', 'start_paused=true',
             '--set', 'control_period=0.005', '--set', 'duration=2', '--set',
             'plant.command_hold=30', '--rtf', '1', '--no-pictures',
             '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        # Paused until every service is connected: the run takes 2 s.
        wait_for(lambda: 'paused' in call('state').message, 60, 'the run has begun')
        assert call('pause', data=False).success
        wait_for(lambda: 'running at tick 1' in call('state').message, 60, 'the run goes on')
        assert call('reset').success
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    assert (tmp_path / 'run' / 'bag-before-reset-1' / 'metadata.yaml').exists()
    verdict = verify(tmp_path / 'run')
    assert verdict.same, verdict.first
    assert verdict.ticks == 400
