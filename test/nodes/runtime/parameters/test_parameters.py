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

"""Nodes started with the parameters of launch_ros, and with what `ros2 param dump` printed."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

from flexarm_ros import scenario
from nodetools import Asker, finish, flexarm_here, ROLES, start_node, wait_for, write_scenario
import pytest
import yaml

pytestmark = pytest.mark.nodes


def launch_file(path: Path, node_name: str, parameters: dict[str, object]) -> Path:
    """Write the temporary file of a launch_ros Node: its full name, or ``/**`` if not known."""
    text = yaml.dump({node_name: {'ros__parameters': parameters}}, default_flow_style=False)
    path.write_text(text)
    return path


def expect_same(run: Path, sim: Path) -> None:
    for name in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (run / name).read_bytes() == (sim / name).read_bytes()


def test_launchs_parameters_of_each_node_make_a_run(tmp_path: Path, ros_domain: int) -> None:
    """Each node gets its own parameters only; half of them have a name, all a namespace."""
    sets = ['duration=0.3', 'plant.length=[4.5, 4.6]', 'controller.kp=80', 'encoder.latency=0.001']
    words = [word for text in sets for word in ('--set', text)]
    sim = tmp_path / 'sim'
    assert (
        flexarm_here('simulate', 'fls_tip', *words, '--no-pictures', '--out', sim).returncode == 0
    )
    sections = scenario.to_dict(scenario.load('fls_tip', sets))
    nodes = []
    for number, role in enumerate(ROLES):
        own = {k: v for k, v in {**sections['/**'], **sections[role]}.items() if v is not None}
        if role == 'recorder':
            own.update(output=str(tmp_path / 'run'), name='fls_tip')
        name = ['-r', f'__node:=my_{role}'] if number % 2 else []
        file = launch_file(tmp_path / f'{role}.yaml', f'/arm1/my_{role}' if name else '/**', own)
        nodes.append(start_node(role, file, '-r', '__ns:=/arm1', *name))
    texts = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(nodes), texts
    expect_same(tmp_path / 'run', sim)


def dump(node: str) -> subprocess.Popen[str]:
    command = [sys.executable, '-m', 'flexarm_ros.ros2_standin', 'param', 'dump', node]
    return subprocess.Popen([*command, '--timeout', '60'], stdout=subprocess.PIPE, text=True)


def test_a_dump_of_every_node_gives_the_run_again(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    sets = ('duration=0.5', 'plant.payload_mass=1.0')
    file = write_scenario(tmp_path / 's.yaml', 'fls_mid_corrected', *sets)
    out = {'recorder': ['-p', f'output:={tmp_path / "run"}', '-p', 'name:=s']}
    slow = {**out, 'plant': ['-p', 'real_time_factor:=0.01']}
    nodes = [start_node(role, file, *slow.get(role, [])) for role in ROLES]
    try:
        wait_for((tmp_path / 'run' / 'bag').exists, 60, 'the recorder has begun')
        dumps = [dump(f'/{role}') for role in ROLES]
        texts = finish(dumps)
        assert [process.returncode for process in dumps] == [0] * len(dumps)
        assert Asker(*rclpy_node).assign('plant', 'real_time_factor', 0.0).successful
    finally:
        said = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(nodes), said
    again = {
        'recorder': ['-p', f'output:={tmp_path / "again"}'],
        'plant': ['-p', 'real_time_factor:=0.0'],
    }
    nodes = []
    for role, text in zip(ROLES, texts, strict=True):
        (written,) = yaml.safe_load(text)[f'/{role}'].values()
        assert written['duration'] == 0.5
        (tmp_path / f'{role}.yaml').write_text(text)
        nodes.append(start_node(role, tmp_path / f'{role}.yaml', *again.get(role, [])))
    said = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(nodes), said
    expect_same(tmp_path / 'again', tmp_path / 'run')


def test_a_dump_of_the_player_plays_again(tmp_path: Path, ros_domain: int) -> None:
    sim = tmp_path / 'sim'
    words = ('--set', 'duration=0.1', '--no-pictures', '--out', sim)
    assert flexarm_here('simulate', 'fls_tip', *words).returncode == 0
    section = launch_file(
        tmp_path / 'p.yaml', '/player', {'bag': str(sim), 'rate': 2, 'paused': True}
    )
    player = start_node('player', section)
    try:
        dumped = dump('/player')
        (text,) = finish([dumped])
        assert dumped.returncode == 0
    finally:
        player.terminate()
        finish([player])
    assert yaml.safe_load(text)['/player']['ros__parameters']['rate'] == 2.0
    (tmp_path / 'dump.yaml').write_text(text)
    player = start_node('player', tmp_path / 'dump.yaml', '-p', 'paused:=false')
    (said,) = finish([player])
    assert player.returncode == 0, said
    assert 'played 100 ticks' in said


@pytest.mark.parametrize('role', [*ROLES, 'viewer', 'player'])
def test_an_unknown_key_ends_every_node(role: str, tmp_path: Path, ros_domain: int) -> None:
    file = launch_file(tmp_path / 'p.yaml', f'/{role}', {'no_such_key': 1})
    node = start_node(role, file)
    (text,) = finish([node])
    assert node.returncode == 2
    assert f'/{role}.no_such_key: unknown key' in text
    assert 'Traceback' not in text
