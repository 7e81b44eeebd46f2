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

"""Two arms in two namespaces of one graph, and what they tell on /diagnostics."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from nodetools import Asker, finish, flexarm_here, ROLES, start_node, wait_for, write_scenario
import pytest
from repository import ROOT

pytestmark = pytest.mark.nodes


def value(status, key: str) -> str:
    (found,) = [pair.value for pair in status.values if pair.key == key]
    return found


@pytest.mark.parametrize(
    'roles',
    [['compose'], pytest.param(ROLES, marks=pytest.mark.slow)],
    ids=['two processes', 'twelve processes'],
)
def test_two_arms_fly_in_lockstep_each(
    tmp_path: Path, ros_domain: int, rclpy_node, roles: list[str]
) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    node, executor = rclpy_node
    told: dict[str, list] = {}

    def heard(message: DiagnosticArray) -> None:
        for status in message.status:
            told.setdefault(status.name, []).append(status)

    node.create_subscription(DiagnosticArray, '/diagnostics', heard, 1000)
    arms = {'left': 'fls_tip', 'right': 'pd_mid'}
    files = {
        arm: write_scenario(tmp_path / f'{arm}.yaml', name, 'duration=0.6')
        for arm, name in arms.items()
    }
    processes = []
    for arm, file in files.items():
        own = {
            'recorder': ['-p', f'recorder:output:={tmp_path / arm}'],
            'plant': ['-p', 'plant:real_time_factor:=0.02'],
        }
        for role in roles:
            words = ['-r', f'__ns:=/{arm}']
            words += own.get(role, []) if role != 'compose' else sum(own.values(), [])
            if arm == 'right':  # and a topic and a node of another name
                words += ['-r', 'joint_command:=torque', '-r', 'controller:__node:=pilot']
            processes.append(start_node(role, file, *words))
    try:
        # While both fly, every one of the twelve has told that it is under way.
        names = {f"/{arm}/{'pilot' if (arm, role) == ('right', 'controller') else role}: lock-step"
                 for arm in arms for role in ROLES}  # fmt: skip

        def all_told() -> bool:
            executor.spin_once(timeout_sec=0.1)
            ended = [process for process in processes if process.poll() not in (None, 0)]
            assert not ended, [process.communicate()[0] for process in ended]
            return all(
                any(value(s, 'phase') == 'running' for s in told.get(name, [])) for name in names
            )

        wait_for(all_told, 90, 'all twelve nodes say that they run')
        for arm in arms:  # slow until then, however late this test is in the graph
            Asker(node, executor).assign(f'{arm}/plant', 'real_time_factor', 0.2)
    finally:
        texts = finish(processes)
    assert [p.returncode for p in processes] == [0] * len(processes), texts
    assert set(told) == names
    plant = [s for s in told['/left/plant: lock-step'] if value(s, 'phase') == 'running'][-1]
    assert plant.level == b'\x00'
    assert value(plant, 'participant controller').endswith('(/left/controller)')
    assert value(plant, 'ticks of the run') == '600'
    assert float(value(plant, 'real-time factor')) > 0.0
    assert float(value(plant, 'longest wait (ms)')) > 0.0
    assert value(plant, 'rejected messages') == '0'
    for arm, file in files.items():
        sim = tmp_path / f'sim_{arm}'
        assert flexarm_here('simulate', file, '--no-pictures', '--out', sim).returncode == 0
        ours, theirs = ((d / 'trajectory.csv').read_bytes() for d in (tmp_path / arm, sim))
        assert ours == theirs


def test_two_arms_of_the_command_line(tmp_path: Path, ros_domain: int) -> None:
    from flexarm_ros.bag.checks.digest import digest_of

    arms = {'left': 'fls_tip', '/right/arm': 'pd_mid'}
    runs = [
        subprocess.Popen(
            [sys.executable, '-m', 'flexarm_ros.cli', 'run', name, '--compose', '--no-pictures',
             '--set', 'duration=0.2', '--namespace', arm],
            cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        for arm, name in arms.items()
    ]  # fmt: skip
    texts = finish(runs)
    assert [run.returncode for run in runs] == [0, 0], texts
    found = {path.name for path in (tmp_path / 'runs').iterdir()}
    assert found == {'left-fls_tip', 'right-arm-pd_mid'}
    for directory, name in (('left-fls_tip', 'fls_tip'), ('right-arm-pd_mid', 'pd_mid')):
        sim = tmp_path / name
        flexarm_here('simulate', name, '--set', 'duration=0.2', '--no-pictures', '--out', sim)
        assert digest_of(tmp_path / 'runs' / directory) == digest_of(sim)


def test_a_recorder_by_hand_names_its_directory_by_the_namespace(
    tmp_path: Path, ros_domain: int
) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.1')
    nodes = [
        subprocess.Popen(
            [sys.executable, '-m', 'flexarm_ros.nodes', 'compose', '--ros-args', '--params-file',
             str(file), '-r', '__ns:=/left', '-p', 'recorder:name:=pd_tip'],
            cwd=tmp_path, env={**os.environ, 'PYTHONPATH': str(ROOT)},
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
    ]  # fmt: skip
    texts = finish(nodes)
    assert nodes[0].returncode == 0, texts
    assert (tmp_path / 'runs' / 'left-pd_tip' / 'summary.json').exists()


@pytest.mark.parametrize('given', ['a b', '1a', 'a//b', 'a/', 'é', 'a-b'])
def test_a_namespace_that_ros_refuses(given: str) -> None:
    for words in (['run', 'pd_tip'], ['replay', 'nosuch'], ['view']):
        done = flexarm_here(*words, '--namespace', given)
        assert done.returncode == 2
        (line,) = done.stderr.splitlines()
        assert line.startswith(f'flexarm {words[0]}: error: --namespace {given}: not a namespace')


def test_a_missing_participant_is_told(tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    node, executor = rclpy_node
    heard: list = []
    node.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 100)
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'start_timeout=4.0')
    plant = start_node('plant', file)
    try:

        def failed() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return bool(heard) and heard[-1].status[0].level == b'\x02'

        wait_for(failed, 60, 'the plant tells of its failure')
    finally:
        (text,) = finish([plant])
    assert plant.returncode == 1, text
    first, last = heard[0].status[0], heard[-1].status[0]
    assert value(first, 'participant encoder') == 'missing'
    assert value(first, 'phase') == 'joining'
    assert 'no encoder' in last.message
