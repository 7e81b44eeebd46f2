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

"""Somebody else's controller in the loop, and a controller against a recorded run."""

from __future__ import annotations

import json
import math
from pathlib import Path
import subprocess
import sys

from nodetools import Asker, finish, flexarm, flexarm_here, start_node, wait_for, write_scenario
import pytest
from repository import ROOT

pytestmark = pytest.mark.nodes
EXAMPLE = ROOT / 'examples' / 'minimal_controller.py'


def end(node: subprocess.Popen[bytes]) -> None:
    """End a node that spins in rclpy, which now and then sleeps on after its first signal."""
    node.terminate()
    try:
        node.wait(10.0)
    except subprocess.TimeoutExpired:
        node.kill()
        node.wait()


@pytest.mark.essential
def test_the_example_controller_flies_in_lockstep(tmp_path: Path, ros_domain: int) -> None:
    example = subprocess.Popen([sys.executable, str(EXAMPLE)], cwd=ROOT)
    try:
        out = tmp_path / 'run'
        words = ('--set', 'duration=0.5', '--without', 'controller', '--no-pictures', '--out', out)
        done = flexarm_here('run', 'pd_collocated', *words)
        assert done.returncode == 0, done.stderr
        assert example.poll() is None
    finally:
        end(example)
    rows = (out / 'trajectory.csv').read_text().splitlines()
    assert len(rows) == 501
    cell = dict(zip(rows[0].split(','), rows[1].split(','), strict=True))
    # The first torque is the example's own law at the first state, at rest.
    assert float(cell['tau1']) == 2000.0 * (
        -3 * 3.141592653589793 / 4 - 0.14 - float(cell['theta1'])
    )
    summary = json.loads((out / 'summary.json').read_text())
    assert (summary['stable'], summary['external']) == (True, ['controller'])


NAMED = """
import sys
sys.path.insert(0, sys.argv[1])
import minimal_controller, rclpy
from sensor_msgs.msg import JointState

class Named(minimal_controller.MinimalController):
    def __init__(self):
        super().__init__()
        self.real, self.torque = self.torque, self

    def publish(self, command):  # what the example would send
        names = sys.argv[2].split()
        told = dict(zip(command.name, command.effort))
        out = JointState(header=command.header, name=names)
        out.effort = [told.get(name, 1e9) for name in names]
        self.real.publish(out)

rclpy.init()
try:
    rclpy.spin(Named())
except BaseException:
    pass
"""
"""The example, which sends its torques under the names of the second argument."""


def test_torques_go_by_name(tmp_path: Path, ros_domain: int) -> None:
    (tmp_path / 'named.py').write_text(NAMED)
    out, names = tmp_path / 'run', "'elbow gripper shoulder'"
    command = f'{sys.executable} {tmp_path / "named.py"} {EXAMPLE.parent} {names}'
    done = flexarm_here('run', 'pd_collocated', '--node', f'controller={command}', '--set',
                        'duration=0.1', '--no-pictures', '--out', out)  # fmt: skip
    assert done.returncode == 0, done.stderr
    header, first, *_ = (out / 'trajectory.csv').read_text().splitlines()
    cell = dict(zip(header.split(','), map(float, first.split(',')), strict=True))
    assert cell['tau1'] == 2000.0 * (-3 * math.pi / 4 - 0.14 - cell['theta1'])
    assert cell['tau2'] == 600.0 * (0.28 - cell['theta2'])


BROKEN = NAMED.replace('told.get(name, 1e9)', "float('nan')")


def test_a_node_that_sends_nan_is_named_with_the_tick(tmp_path: Path, ros_domain: int) -> None:
    (tmp_path / 'broken.py').write_text(BROKEN)
    out = tmp_path / 'run'
    command = f"{sys.executable} {tmp_path / 'broken.py'} {EXAMPLE.parent} 'elbow shoulder'"
    words = ('--set', 'duration=0.1', '--no-pictures', '--out', out)
    given = ('--compose', '--node', f'controller={command}')
    done = flexarm_here('run', 'pd_collocated', *given, *words)
    assert done.returncode == 1
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['problem'].endswith(
        'tick 0: invalid message on joint_command: effort.shoulder is nan, from /my_controller, '
        'at tick 0'
    )
    assert summary['problem'] in done.stderr


SLOW = """
import sys, time
sys.path.insert(0, sys.argv[1])
import minimal_controller, rclpy

class Slow(minimal_controller.MinimalController):
    def answer(self, state):
        time.sleep(0.4)
        super().answer(state)

rclpy.init()
try:
    rclpy.spin(Slow())
except BaseException:
    pass
"""


def test_a_reset_waits_for_the_answer_of_an_external_node(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    from std_srvs.srv import Trigger

    (tmp_path / 'slow.py').write_text(SLOW)
    out, asker = tmp_path / 'run', Asker(*rclpy_node)
    run = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'pd_collocated', '--out', str(out),
         '--set', 'duration=0.01', '--no-pictures', '--node',
         f"controller={sys.executable} {tmp_path / 'slow.py'} {EXAMPLE.parent}"],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:
        wait_for(lambda: asker.state().startswith('running at tick 2'), 90, 'tick 2 is out')
        answer = asker.call(Trigger, '/plant/reset')
        assert answer.success, answer.message
    finally:
        (text,) = finish([run])
    assert run.returncode == 0, text
    assert (out / 'bag-before-reset-1' / 'metadata.yaml').exists()
    assert len((out / 'trajectory.csv').read_text().splitlines()) == 11


def test_the_protocol_page_shows_the_example_that_is_tested() -> None:
    _, _, code = EXAMPLE.read_text().partition('\n\n')  # below the licence
    assert code.startswith('"""')
    assert len(code.splitlines()) <= 45
    assert 'examples/minimal_controller.py' in (ROOT / 'docs' / 'protocol.md').read_text()


@pytest.mark.essential
def test_our_controller_repeats_a_recorded_run(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'fls_mid', 'duration=0.3')
    out = tmp_path / 'run'
    assert flexarm_here('simulate', file, '--no-pictures', '--out', out).returncode == 0
    controller = start_node('controller', file)
    done = flexarm('replay', out, '--without', 'controller')
    (text,) = finish([controller])
    assert done.returncode == 0, done.stderr
    assert controller.returncode == 0, text
    assert '300 torques, 300 equal to the recorded ones' in done.stderr + done.stdout


@pytest.mark.essential
def test_a_replay_publishes_every_message_again(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    from rosgraph_msgs.msg import Clock
    from sensor_msgs.msg import JointState
    from std_srvs.srv import Trigger

    node, executor = rclpy_node
    clocks: list[int] = []
    torques: list[list[float]] = []

    def heard(message: Clock) -> None:
        clocks.append(message.clock.sec * 10**9 + message.clock.nanosec)

    node.create_subscription(Clock, '/clock', heard, 1000)
    node.create_subscription(
        JointState, '/joint_command', lambda m: torques.append(list(m.effort)), 1000
    )
    out = tmp_path / 'run'
    words = ('pd_tip', '--set', 'duration=0.2', '--no-pictures', '--out', out)
    assert flexarm_here('simulate', *words).returncode == 0
    player = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'replay', str(out), '--rate', '2', '--paused'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        asker = Asker(node, executor)
        # A player that has answered knows the subscriptions that were made before.
        for name in ('pause', 'resume'):
            assert asker.call(Trigger, f'/player/{name}').success
        wait_for(lambda: executor.spin_once(0.01) or len(clocks) == len(torques) == 200, 60, 'all')
    finally:
        (text,) = finish([player])
    assert player.returncode == 0, text
    assert clocks == [10**9 + k * 10**6 for k in range(200)]
    row = (out / 'trajectory.csv').read_text().splitlines()[-1].split(',')
    assert torques[-1] == [float(row[-3]), float(row[-2])]


def test_replay_of_what_is_no_run_is_refused(tmp_path: Path) -> None:
    done = flexarm('replay', tmp_path)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) <= 2
    assert 'Traceback' not in done.stderr
