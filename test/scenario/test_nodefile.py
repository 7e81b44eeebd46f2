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

"""Parameter files as nodes read them: rcl's sections and order, launch's files, unknown keys."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import SECTIONS
from flexarm_ros.nodes.runtime.parameters.declared import assignments, parameter_files
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.scenario.nodefile import NodeName, NodeParameters, read_node
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
import rcl_oracle
import yaml

FLS_TIP = scenario.shipped()['fls_tip']


def section(name: str, **keys: object) -> str:
    """Return a section as launch_ros writes it into its temporary files."""
    return yaml.dump({name: {'ros__parameters': keys}}, default_flow_style=False)


def read(
    directory: Path, *texts: str, role: str = 'plant', name: str = '', set_: tuple[str, ...] = ()
) -> NodeParameters:
    """Return what a node of ours takes from files with these texts, and from ``-p KEY:=VALUE``."""
    files = []
    for number, text in enumerate(texts):
        files.append(directory / f'{number}.yaml')
        files[-1].write_text(text)
    node = NodeName(role, name or f'/{role}', OWN.get(role, ()), OWN, in_run=role != 'player')
    argv = ['--ros-args', *(word for text in set_ for word in ('-p', text))]
    return read_node(files, node, assignments(argv, role, node.name.rpartition('/')[2]))


def value(found: NodeParameters, key: str, role: str = 'plant') -> Any:
    given_value = found.scenario.get((role, key))
    return None if given_value is None else given_value.tree.value


@pytest.mark.parametrize(
    ('name', 'written'),
    [
        ('/plant', '/**'),  # launch_ros without name= and namespace=
        ('/plant', '/plant'),
        ('/arm1/plant', '/**'),
        ('/arm1/plant', '/arm1/plant'),  # with both
        ('/arm1/plant', '/**/plant'),
        ('/arm1/plant', '/arm1/*'),
        ('/pilot', '/pilot'),  # -r __node:=pilot
        ('/arm1/plant', 'plant'),  # the role alone: in every namespace, under every name
        ('/pilot', 'plant'),
    ],
)
def test_a_nodes_own_section(tmp_path: Path, name: str, written: str) -> None:
    found = read(tmp_path, section(written, payload_mass=1.5, step_ticks=3, seed=7), name=name)
    config = found.config()
    assert (config.plant.payload_mass, config.run.seed) == (1.5, 7)
    assert found.own['step_ticks'].tree.value == 3
    assert not found.notes


@pytest.mark.parametrize(
    'written',
    ['rviz2', '/rviz2', '/right/plant', '/plant', '/*', '/*/*/plant', '/pilot', '/left', 'left'],
)
def test_sections_of_other_nodes_are_passed_over(tmp_path: Path, written: str) -> None:
    """Whatever they hold: it is not this node's business."""
    found = read(tmp_path, section(written, no_such_key=1, modes='many'), name='/left/plant')
    assert found == NodeParameters()


def test_namespaces_may_be_nested_maps(tmp_path: Path) -> None:
    text = (
        'arm1:\n  plant: {ros__parameters: {modes: 2}}\n  deep: {x: {ros__parameters: {a: 1}}}\n'
    )
    assert value(read(tmp_path, text, name='/arm1/plant'), 'modes') == 2


PATTERNS = (
    *('/**', '/*', '/**/plant', '/*/plant', '/arm1/*', '/arm1/**', '/arm1/plant', 'arm1/plant'),
    *('/plant', 'plant', '/*/*', '/**/arm1/plant', '/arm1/*/plant', '/arm1/**/plant', '/rviz2'),
    *('/arm1/b/plant', '/arm2/**', 'arm1/**/plant', '/**/*'),
)  # fmt: skip
FILE = st.dictionaries(
    st.sampled_from(PATTERNS),
    st.dictionaries(st.sampled_from(['modes', 'payload_mass', 'seed']), st.integers(1, 6)),
    min_size=1,
    max_size=4,
)


@settings(max_examples=150)
@given(files=st.lists(FILE, min_size=1, max_size=3), data=st.data())
def test_sections_are_matched_and_ordered_as_rcl_does(
    files: list[dict[str, dict[str, int]]], data: st.DataObject, tmp_path_factory: Any
) -> None:
    directory = tmp_path_factory.mktemp('rcl')
    name = data.draw(st.sampled_from(['/plant', '/arm1/plant', '/arm1/b/plant', '/arm1/pilot']))
    texts = [''.join(section(key, **keys) for key, keys in file.items()) for file in files]
    found = read(directory, *texts, name=name)
    ours = {key: given.tree.value for (_, key), given in found.scenario.items()}  # type: ignore[union-attr]
    paths = [directory / f'{number}.yaml' for number in range(len(texts))]
    rcl = rcl_oracle.resolve(paths, name)
    assert {key: ours.get(key) for key in rcl} == rcl
    # What rcl does not choose can only come from the role's own section.
    role: dict[str, int] = {}
    for file in files:
        role.update(file.get('plant', {}))
    assert ours == {**role, **rcl}


def test_the_roles_section_is_below_what_rcl_chooses(tmp_path: Path) -> None:
    texts = section('/arm1/plant', modes=2), section('plant', modes=3, payload_mass=1.0)
    found = read(tmp_path, *texts, name='/arm1/plant')
    assert (value(found, 'modes'), value(found, 'payload_mass')) == (2, 1.0)


def test_a_later_file_that_ranks_lower_is_told(tmp_path: Path) -> None:
    """The dictionary of a launch_ros Node without name= and namespace=, after a scenario."""
    texts = FLS_TIP.read_text('utf-8'), section('/**', kp=80.0)
    found = read(tmp_path, *texts, role='controller')
    assert value(found, 'kp', 'controller') == 150.79  # as rclpy and rclcpp have it
    (note,) = found.notes
    winner = f'{tmp_path}/0.yaml: controller.kp'
    assert note == f'{tmp_path}/1.yaml: /**.kp: not used; {winner} ranks higher'
    assert not read(tmp_path, *texts, role='controller', set_=('kp:=1',), name='/a/x').notes


def test_the_command_line_wins_over_every_file(tmp_path: Path) -> None:
    words = (
        'modes:=2',
        'plant:modes:=3',
        'controller:kp:=1',
        '/**:x:=1',
        'real_time_factor:=1e-3',
    )
    found = read(tmp_path, section('plant', modes=4), set_=words)
    assert value(found, 'modes') == 3
    assert found.own['real_time_factor'].tree.value == 1e-3


def test_a_ros_command_line() -> None:
    argv = ['plant', '-p', 'a:=1', '--params-file', 'no', '--ros-args', '--params-file', 'one']
    argv += ['--param', 'b:=2', '-r', '__ns:=/x', '-p', 'pilot:c:=3', '-p', 'other:d:=4', '--']
    argv += ['-p', 'e:=5', '--ros-args', '-p', 'f:=6', '--params-file', 'two', '-p']
    assert parameter_files(argv) == ['one', 'two']
    assert list(assignments(argv, 'plant', 'pilot')) == [('b', '2'), ('c', '3'), ('f', '6')]


@pytest.mark.parametrize(
    ('text', 'role', 'words'),
    [
        (section('/plant', lenght=[4, 4]), 'plant', ['/plant.lenght', "did you mean 'length'"]),
        (section('/plant', kp=1.0), 'plant', ['/plant.kp', "did you mean 'controller.kp'"]),
        (section('/**', payload_mas=1.0), 'plant', ['/**.payload_mas', "'payload_mass'"]),
        (section('/**', duratoin=1.0), 'plant', ['/**.duratoin', "'duration'"]),
        (section('/**', no_such_key=1.0), 'plant', ['/**.no_such_key', 'unknown key']),
        (section('/**', payload_mas=1) + section('rviz2', a=1), 'plant', ["'payload_mass'"]),
        (section('/recorder', outptu='x'), 'recorder', ['/recorder.outptu', "'output'"]),
        (section('/player', speed=2.0), 'player', ['/player.speed', 'unknown key']),
        (section('/player', duration=2.0), 'player', ["did you mean '/**.duration'"]),
        ('plant: 3\n', 'plant', ['plant: must be a map']),
        ('ros__parameters: {modes: 1}\n', 'plant', ['ros__parameters must be a map of keys in a']),
        ('- 1\n', 'plant', ['must be a map']),
    ],
)
def test_unknown_keys_are_named(tmp_path: Path, text: str, role: str, words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        read(tmp_path, text, role=role)
    message = str(caught.value)
    assert message.startswith(f'{tmp_path}/0.yaml: ')
    assert '\n' not in message
    assert all(word in message for word in words), message


@pytest.mark.parametrize('role', [role for role in SECTIONS if role != '/**'])
def test_a_key_of_any_node_of_ours_may_stand_under_a_wildcard(tmp_path: Path, role: str) -> None:
    keys = {
        'payload_mass': 1.0,
        'hold_at': '',
        'compression': 'none',
        'output': 'runs',
        'kp': 80.0,
    }
    for text in (section('/**', **keys), section('/**', **keys) + section('rviz2', a=1)):
        assert read(tmp_path, text, role=role).notes == []
    with pytest.raises(
        scenario.ScenarioError, match="payload_mas: unknown key; did you mean 'pay"
    ):
        read(tmp_path, section('/**', payload_mas=1.0) + section('rviz2', a=1))


def test_keys_that_other_nodes_share_are_passed_over(tmp_path: Path) -> None:
    common = section('/**', kp=80.0, output='runs', rate=1.0, use_sim_time=True)
    found = read(tmp_path, common)
    assert (found.scenario, found.own, found.notes) == ({}, {}, [])
    shared = common + section('rviz2', a=1) + section('/*', robot_description='<robot/>')
    (note,) = read(tmp_path, shared).notes
    assert note.startswith(
        f'{tmp_path}/0.yaml: /*.robot_description: no parameter of this package'
    )


def test_one_file_for_two_arms(tmp_path: Path) -> None:
    text = section('/**', duration=2.0, seed=3)
    text += section('/left/plant', payload_mass=1.0) + section('/right/plant', payload_mass=2.0)
    text += section('/left/controller', law='pd') + section('/right/controller', law='fls')
    for arm, mass, law in (('left', 1.0, 'pd'), ('right', 2.0, 'fls')):
        for role in ('plant', 'controller', 'recorder'):  # the others' sections are read as well
            config = read(tmp_path, text, role=role, name=f'/{arm}/{role}').config()
            assert (config.run.duration, config.run.seed) == (2.0, 3)
            assert (config.plant.payload_mass, config.controller.law) == (mass, law)


@pytest.mark.parametrize('name', ['/plant', '/left/plant', '/left/pilot'])
def test_a_scenario_serves_every_namespace_and_name(tmp_path: Path, name: str) -> None:
    found = read(tmp_path, FLS_TIP.read_text('utf-8'), name=name)
    assert found.config() == scenario.load('fls_tip')


def test_parts_are_judged_together_only_where_they_are_known(tmp_path: Path) -> None:
    short = section('/**', location=3.0)  # allowed with an arm whose plant tells so
    assert read(tmp_path, short, role='tip_sensor').config().tip_sensor.location == 3.0
    with pytest.raises(ScenarioError, match=r'tip_sensor.location: 3.0 m, allowed: 4.5'):
        read(tmp_path, FLS_TIP.read_text('utf-8'), short, role='tip_sensor', name='/a/b').config()


def test_a_torque_file_is_relative_to_its_parameter_file(tmp_path: Path) -> None:
    (tmp_path / 'torques.csv').write_text('t,tau1,tau2\n0,1,2\n')
    text = section('/**', law='open_loop', torque_file='torques.csv')
    found = read(tmp_path, text, role='controller')
    assert found.torque_base == tmp_path
    assert found.config().torques == ((0.0, 1.0, 2.0),)


def test_a_key_without_a_value_is_left_out_again(tmp_path: Path) -> None:
    texts = section('/plant', substeps=4, modes=2), section('/plant', substeps=None)
    found = read(tmp_path, *texts)
    assert (value(found, 'substeps'), value(found, 'modes')) == (None, 2)
    with pytest.raises(ScenarioError, match=r"plant.modes: 'null' is not an integer"):
        read(tmp_path, section('/plant', modes=None)).config()


def test_a_whole_scenario_is_still_strict() -> None:
    for name in ('/left/plant', 'rviz2', '/**/plant'):
        with pytest.raises(ScenarioError, match='unknown section'):
            scenario.from_text(section(name, modes=1))
    with pytest.raises(ScenarioError, match=r'/\*\*.modes: unknown key'):
        scenario.from_text(section('/**', modes=1))
