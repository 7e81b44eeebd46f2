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

"""`flexarm run --compose`: nodes of one process hand messages over; others see and do the same."""

from __future__ import annotations

from pathlib import Path
import re
import threading

from nodetools import Asker, flexarm, flexarm_here, wait_for
import pytest

pytestmark = pytest.mark.nodes


def composed(out: Path, done: list, *words: str) -> threading.Thread:
    """Start a composed run of 1 s on a thread, slow until `hurry`; its end goes to ``done``."""
    command = ('run', 'fls_tip', '--compose', '--rtf', '0.02', '--set', 'duration=1.0',
               '--no-pictures', '--out', out, *words)  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm_here(*command)))
    run.start()
    return run


def hurry(asker: Asker) -> None:
    """Let a run that has been found go on as fast as it can."""
    assert asker.assign('plant', 'real_time_factor', 0.0).successful


@pytest.mark.essential
def test_who_listens_gets_every_message(tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    from sensor_msgs.msg import JointState

    node, executor = rclpy_node
    stamps: list[int] = []

    def heard(message: JointState) -> None:
        stamps.append(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)

    node.create_subscription(JointState, '/joint_command', heard, 1000)
    done: list = []
    run = composed(tmp_path / 'run', done)
    try:
        wait_for(lambda: executor.spin_once(0.01) or stamps, 60, 'a message of the run')
        hurry(Asker(node, executor))
        while run.is_alive():
            executor.spin_once(timeout_sec=0.1)
        wait_for(lambda: executor.spin_once(0.1) or stamps[-1:] == [1_999_000_000], 60, 'the end')
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    # It may have been found a little after the start; from then on nothing is left out.
    assert stamps == list(range(stamps[0], 2_000_000_000, 1_000_000))
    simulated = flexarm_here('simulate', 'fls_tip', '--set', 'duration=1.0', '--no-pictures',
                             '--out', tmp_path / 'sim')  # fmt: skip
    assert simulated.returncode == 0
    bags = [(tmp_path / way / 'bag' / 'bag_0.mcap').read_bytes() for way in ('run', 'sim')]
    assert bags[0] == bags[1]


@pytest.mark.essential
@pytest.mark.parametrize('on_invalid', ['error', 'ignore'])
def test_who_speaks_in_anothers_place_is_noticed(
    tmp_path: Path, ros_domain: int, rclpy_node, on_invalid: str
) -> None:
    from sensor_msgs.msg import JointState

    node, executor = rclpy_node
    clocks: list = []
    from rosgraph_msgs.msg import Clock

    node.create_subscription(Clock, '/clock', clocks.append, 1000)
    done: list = []
    run = composed(tmp_path / 'run', done, '--set', f'on_invalid={on_invalid}')
    asker = Asker(node, executor)
    try:
        # The run has begun, since who comes earlier is refused, and waits until all is connected.
        wait_for(lambda: executor.spin_once(0.01) or clocks, 60, 'the run has begun')
        stranger = node.create_publisher(JointState, '/joint_command', 10)
        wait_for(lambda: stranger.get_subscription_count() >= 2, 60, 'plant and recorder hear it')
        stranger.publish(JointState(effort=[1e6, 1e6]))
        if on_invalid == 'ignore':
            hurry(asker)
    finally:
        run.join(120)
    if on_invalid == 'error':
        assert done[0].returncode == 1
        assert 'invalid message on joint_command' in done[0].stderr
    else:
        assert done[0].returncode == 0, done[0].stderr
        log = (tmp_path / 'run' / 'logs' / 'compose.log').read_text()
        assert re.search('invalid messages?, last on joint_command', log)


@pytest.mark.parametrize('way', [[], ['--compose']], ids=['six processes', 'composed'])
def test_another_arms_clock_is_passed_over(
    tmp_path: Path, ros_domain: int, rclpy_node, way: list[str]
) -> None:
    from rosgraph_msgs.msg import Clock

    node, executor = rclpy_node
    clock = node.create_publisher(Clock, '/clock', 10)
    done: list = []
    words = ('run', 'fls_tip', *way, '--rtf', '1', '--set', 'duration=0.2', '--no-pictures',
             '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        while run.is_alive():
            executor.spin_once(timeout_sec=0.002)
            clock.publish(Clock())
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
