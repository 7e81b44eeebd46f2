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

"""Nodes started one by one, as `ros2 run` does."""

from __future__ import annotations

import json
from pathlib import Path

from nodetools import Asker, finish, flexarm_here, ROLES, start_node, wait_for, write_scenario
import pytest

pytestmark = pytest.mark.nodes


@pytest.mark.essential
@pytest.mark.parametrize('order', [ROLES, ROLES[::-1]], ids=['plant first', 'recorder first'])
def test_any_order_gives_the_bytes_of_a_simulation(
    tmp_path: Path, ros_domain: int, order: tuple[str, ...], request: pytest.FixtureRequest
) -> None:
    if order == ROLES:  # once as for a user
        request.getfixturevalue('fresh_processes')
    file = write_scenario(tmp_path / 's.yaml', 'fls_mid_corrected', 'duration=0.3')
    own = {'recorder': ['-p', f'output:={tmp_path / "run"}', '-p', 'name:=s']}
    nodes = [start_node(role, file, *own.get(role, [])) for role in order]
    texts = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(nodes), texts
    assert (
        flexarm_here('simulate', file, '--no-pictures', '--out', tmp_path / 'sim').returncode == 0
    )
    for name in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (tmp_path / 'run' / name).read_bytes() == (tmp_path / 'sim' / name).read_bytes()
    assert json.loads((tmp_path / 'run' / 'summary.json').read_text())['stable'] is True


@pytest.mark.essential
def test_nodes_that_disagree_refuse_to_start(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3', 'start_timeout=20')
    nodes = [
        start_node(role, file, *(['-p', 'duration:=0.2'] if role == 'encoder' else []))
        for role in ROLES[:-1]
    ] + [start_node('recorder', file, '-p', f'output:={tmp_path / "run"}')]
    texts = finish(nodes)
    assert all(node.returncode == 1 for node in nodes), texts
    assert any('/**.duration is' in text and 'encoder' in text for text in texts)
    assert not (tmp_path / 'run' / 'bag').exists()


def test_a_missing_node_is_named(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3', 'start_timeout=2.0')
    nodes = [start_node(role, file) for role in ('plant', 'encoder', 'trajectory')]
    texts = finish(nodes)
    assert all(node.returncode == 1 for node in nodes)
    assert any('tip_sensor, controller, recorder' in text for text in texts), texts


@pytest.mark.essential
def test_a_second_plant_is_refused_and_the_run_goes_on(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=1.0')
    paced = ['-p', 'real_time_factor:=0.02']
    own = {'recorder': ['-p', f'output:={tmp_path / "run"}'], 'plant': paced}
    nodes = [start_node(role, file, *own.get(role, [])) for role in ROLES]
    try:
        wait_for((tmp_path / 'run' / 'bag').exists, 60, 'the recorder has begun')
        second = start_node('plant', file)
        (text,) = finish([second])
        assert second.returncode == 1
        assert 'another plant' in text
        assert Asker(*rclpy_node).assign('plant', 'real_time_factor', 0.0).successful
    finally:
        texts = finish(nodes)
    assert [node.returncode for node in nodes] == [0] * len(nodes), texts


@pytest.mark.parametrize('role', ROLES)
def test_parameters_are_described(role: str, tmp_path: Path, ros_domain: int) -> None:
    from flexarm_ros.core.parameters.sections import SECTIONS, specs
    from flexarm_ros.nodes.process import node_class
    from flexarm_ros.nodes.runtime.process.supervisor import Supervisor
    from flexarm_ros.scenario.reader import is_of_ros
    import rclpy

    context = rclpy.Context()
    rclpy.init(context=context)
    node = node_class(role)([], Supervisor(), context=context)
    try:
        names = list(node._parameters)
        node.get_parameters(names)  # those without a value too, as for a dump
        told = dict(zip(names, node.describe_parameters(names), strict=True))
        described = {n: (d.description, d.read_only, d.type) for n, d in told.items()}
    finally:
        node.destroy_node()
        rclpy.shutdown(context=context)
    assert all(text for name, (text, _, _) in described.items() if not is_of_ros(name))
    for section in ('/**', role):
        for key, (_, spec, _) in specs(SECTIONS[section]).items():
            text, read_only, kind = described[key]
            assert spec.doc in text
            assert spec.unit in text
            assert read_only is not spec.live
            assert kind != 0


def test_a_bad_parameter_is_named_in_one_line(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip')
    node = start_node('encoder', file, '-p', 'latency:=-1.0')
    (text,) = finish([node])
    assert node.returncode == 2
    assert 'encoder.latency' in text
    assert 'Traceback' not in text
