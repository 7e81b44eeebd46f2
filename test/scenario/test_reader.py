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

"""Scenarios as a whole: defaults, overrides, merging, and one clear line for what is wrong."""

from __future__ import annotations

import os
from pathlib import Path

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, specs
from flexarm_ros.core.parameters.spec import exact_ns
from flexarm_ros.scenario import ScenarioError
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

PAPER_CASES = [
    f'{law}_{place}'
    for law in ('pd', 'fls')
    for place in ('collocated', 'tip', 'tip_corrected', 'mid', 'mid_corrected')
]


def params(section: str, body: str) -> str:
    return f'{section}:\n  ros__parameters:\n    {body}\n'


def message(text: str) -> str:
    """Return the error of a scenario's text, checked to be one line."""
    with pytest.raises(ScenarioError) as caught:
        scenario.from_text(text)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def test_left_out_keys_have_their_defaults() -> None:
    assert scenario.from_text(params('plant', 'modes: 1')) == RunConfig()


def test_the_papers_ten_cases_are_shipped_with_its_numbers() -> None:
    names = scenario.shipped()
    assert set(PAPER_CASES) <= set(names)
    for name in PAPER_CASES:
        config = scenario.load(name)
        law, place, *corrected = name.split('_')
        latency = {'collocated': 0.0, 'tip': 0.001238, 'mid': 0.0009289}[place]
        assert config.controller.law == law
        assert config.controller.feedback == ('encoder' if place == 'collocated' else 'tip_sensor')
        assert config.tip_sensor.latency == latency
        assert config.tip_sensor.location == (6.75 if place == 'mid' else 9.0)
        assert config.trajectory.delay == (latency if corrected else 0.0)
        assert (config.run.control_period, config.run.duration) == (0.001, 16.0)
        assert (config.trajectory.side, config.trajectory.side_time) == (12.6, 4.0)
        assert (config.controller.kp, config.controller.kd) == (150.79, 17.364)
        assert config.plant.hub_inertia == (8.0, 8.0)
        assert config.plant.substeps is None


@pytest.mark.parametrize('name', sorted(scenario.shipped()))
def test_a_shipped_scenario_survives_every_way_of_writing_it(name: str) -> None:
    config = scenario.load(name)
    assert scenario.from_text(scenario.dump(config), config.torques) == config
    assert scenario.from_dict(scenario.to_dict(config), config.torques) == config
    assert scenario.with_values(config, []) == config


def test_every_form_of_a_section_and_a_key_means_the_same() -> None:
    for text in (
        'plant: {ros__parameters: {length: [4, 5.0]}}',
        '/plant:\n  ros__parameters:\n    length: [4.0, 5]\n    use_sim_time: true\n',
    ):
        assert scenario.from_text(text).plant.length == (4.0, 5.0)


def test_integers_where_floats_are_due_become_floats() -> None:
    config = scenario.load('fls_tip', ['duration=4', 'plant.length=[5, 5]', 'controller.kp=0x10'])
    for value in (config.run.duration, *config.plant.length, config.controller.kp):
        assert type(value) is float
    assert config.controller.kp == 16.0


def test_overrides_add_up_and_the_last_one_wins() -> None:
    config = scenario.load(
        'fls_tip',
        ['duration=8', '/**.seed=3', 'controller.kp=1', '/controller.kp=2', 'duration=4.0'],
    )
    assert (config.run.duration, config.run.seed, config.controller.kp) == (4.0, 3, 2.0)


def test_data_of_python_is_taken_as_a_files() -> None:
    base = scenario.load('fls_tip', ['plant.substeps=4'])
    changed = scenario.with_values(
        base,
        ['controller.kp=1'],
        {'plant': {'hub_inertia': np.array([10, 10]), 'substeps': None}, 'run': {'duration': 4}},
    )
    assert changed.plant.hub_inertia == (10.0, 10.0)
    assert (changed.plant.substeps, changed.run.duration) == (None, 4.0)
    assert (changed.controller.kp, changed.controller.kd) == (1.0, base.controller.kd)
    for data, words in (
        ({'plant': {'modes': 9}}, 'at most 6'),
        ({'plant': {'mods': 1}}, "'plant.modes'"),
        ({'plants': {'modes': 1}}, "did you mean 'plant'"),
        ({'plant': 3}, 'not a map'),
        ({'plant': {'modes': object()}}, 'must be a number'),
        ({'controller': {'kp': float('nan')}}, 'finite'),
    ):
        with pytest.raises(ScenarioError, match=words):
            scenario.with_values(base, data=data)


def test_of_several_files_the_later_wins(tmp_path: Path) -> None:
    first, second = tmp_path / 'a.yaml', tmp_path / 'b.yaml'
    first.write_text(params('controller', '{kp: 1, kd: 2}'))
    second.write_text(params('/controller', '{kp: 3.5}'))
    config = scenario.load([first, second])
    assert (config.controller.kp, config.controller.kd) == (3.5, 2.0)


def way_points(times: str, x: str, y: str) -> str:
    arrays = f'waypoint_times: [{times}], waypoint_x: [{x}], waypoint_y: [{y}]'
    return params('trajectory', f'{{kind: waypoints, {arrays}}}')


WRONG = {
    'unknown section': (params('plnt', 'modes: 1'), ['plnt', "did you mean 'plant'"]),
    'unknown key': (params('plant', 'lenght: [4, 4]'), ['plant.lenght', "'plant.length'"]),
    'key of another section': (params('/**', 'kp: 4.0'), ['/**.kp', "'controller.kp'"]),
    'no ros__parameters': ('plant:\n  modes: 1\n', ['plant', 'ros__parameters']),
    'wrong type': (params('plant', 'modes: one'), ['plant.modes', "'one'", 'integer', '6']),
    'float for an integer': (params('plant', 'modes: 1.0'), ['plant.modes', '1.0', 'integer']),
    'bool for a number': (params('controller', 'kp: yes'), ['controller.kp', 'yes', 'number']),
    'text for a number': (params('controller', "kp: '1'"), ['controller.kp', "'1'", 'number']),
    'number for a text': (params('controller', 'law: 3'), ['controller.law', '3', 'pd, fls']),
    'map for a number': (params('controller', 'kp: {a: 1}'), ['controller.kp', 'number']),
    'unknown choice': (params('controller', 'law: pid'), ['controller.law', "'pid'", 'pd, fls']),
    'nan': (params('controller', 'kp: .nan'), ['controller.kp', '.nan', 'finite']),
    'nan in an array': (params('plant', 'length: [nan, 1]'), ['plant.length[0]', 'nan', 'finite']),
    'infinity': (params('controller', 'kp: .inf'), ['controller.kp', '.inf', 'finite']),
    'negative length': (
        params('plant', 'length: [-1, 4.5]'), ['plant.length[0]', '-1', 'above 0'],
    ),
    'zero length': (params('plant', 'length: [4.5, 0]'), ['plant.length[1]', '0', 'above 0']),
    'one length': (params('plant', 'length: [4.5]'), ['plant.length', 'two']),
    'scalar length': (params('plant', 'length: 4.5'), ['plant.length', '4.5', 'two']),
    'empty array': (params('plant', 'length: []'), ['plant.length', '[]', 'two']),
    'latency': (
        params('tip_sensor', 'latency: -1e-3'), ['tip_sensor.latency', '-1e-3', 'least 0'],
    ),
    'subnormal': (params('controller', 'kp: 0x1p-1060'), ['controller.kp', '0x1p-1060']),
    'period': (params('/**', 'control_period: 0.0000000015'), ['control_period', 'nanoseconds']),
    'period, long text': (
        params('/**', 'control_period: 0.0010000000000000000001'),
        ['control_period', '0.0010000000000000000001', 'nanoseconds'],
    ),
    'period zero': (params('/**', 'control_period: 0'), ['/**.control_period', '0', 'above 0']),
    'duration': (params('/**', 'duration: 4.0005'), ['duration', '4.0005', '0.001']),
    'duration, digits': (
        params('/**', '{duration: 9999999.999999999, control_period: 1e-9}'),
        ['/**.duration', '9999999.999999999', '64-bit'],
    ),
    'rate': (params('tip_sensor', 'rate: 300'), ['tip_sensor.rate', '300', 'whole number']),
    'buffer': (
        params('/**', '{control_period: 1e-9, duration: 1}') + params('encoder', 'latency: 0.5'),
        ['encoder.latency', '0.5', '1000000'],
    ),
    'square': (params('trajectory', 'side: 12.8'), ['trajectory.side', '12.8', '0 to 9 m']),
    "square's inside": (params('plant', 'length: [8.5, 0.5]'), ['trajectory.side', '8 to 9']),
    'hold': (
        params('trajectory', '{kind: hold, hold_position: [9, 1]}'),
        ['trajectory.hold_position', '9.0', '0 to 9'],
    ),
    'location below': (params('tip_sensor', 'location: 4.4'), ['location', '4.4', '4.5', '9.0']),
    'location above': (params('tip_sensor', 'location: 9.1'), ['location', '9.1', '4.5', '9.0']),
    'no way points': (params('trajectory', 'kind: waypoints'), ['waypoint_times', 'missing']),
    'way points': (
        way_points('0, 1', '5', '0, 0'),
        ['trajectory.waypoint_x', '1 values', 'waypoint_times has 2'],
    ),
    "way points' order": (
        way_points('0, 1, 1', '5, 5, 5', '0, 0, 0'),
        ['trajectory.waypoint_times', '1.0, 1.0', 'must increase'],
    ),
    "way points' start": (
        way_points('1', '5', '0'),
        ['trajectory.waypoint_times', '[1.0]', 'from 0'],
    ),
    'substeps': (
        params('plant', '{substeps: 1, flexural_rigidity: [1e9, 1e9]}'),
        ['plant.substeps', '1 is too few', 'or more'],
    ),
    'no deflection': (
        params('plant', 'deflection_limit: [0.0, 1.0]'),
        ['plant.deflection_limit[0]', '0.0', 'above 0'],
    ),
    'no substeps': (
        params('plant', 'mass_density: [1e-300, 1e-300]'),
        ['plant.substeps', 'not set', '100000'],
    ),
    'no torques': (params('controller', 'law: open_loop'), ['controller.torque_file', 'missing']),
    'array of arrays': (params('plant', 'length: [[1], 2]'), ['plant.length']),
    "section's list": ('plant:\n  ros__parameters: [1]\n', ['plant', 'map']),
    'not a map': ('[1, 2]\n', ['map of sections']),
    'given twice': (
        params('plant', 'modes: 1') + params('/plant', 'modes: 2'), ['plant.modes', 'twice']
    ),
    'alias': (params('plant', '{a: &b 1, c: *b}'), ['line 3', 'alias']),
    'depth': ('[' * 1000, ['nested too deeply']),
}  # fmt: skip


@pytest.mark.parametrize('case', WRONG)
def test_an_error_names_the_key_the_value_and_what_is_allowed(case: str) -> None:
    text, words = WRONG[case]
    found = message(text)
    assert not [word for word in words if word not in found], found


@pytest.mark.parametrize(
    ('override', 'words'),
    [
        ('duration', ['node.key=value']),
        ('=4', ['node.key=value']),
        ('duration=', ['duration', 'no value']),
        ('kp=4', ['kp', "'controller.kp'"]),
        ('plant.modes=[1', ['plant.modes', '[1', 'YAML']),
        ('plant.modes={a: 1}', ['plant.modes', 'integer']),
        ('plnt.modes=1', ['plnt.modes', "'plant.modes'"]),
        ('controller.pd.kp=1', ['controller.pd.kp', "'controller.kp'"]),
        ('controller.kp=\udcff', ['controller.kp', 'UTF-8']),
        ('plant.modes=*x', ['plant.modes', 'alias']),
        ('plant.modes=1\n', []),
    ],
)
def test_a_bad_override_is_named(override: str, words: list[str]) -> None:
    if not words:
        assert scenario.load('fls_tip', [override]).plant.modes == 1
        return
    with pytest.raises(ScenarioError) as caught:
        scenario.load('fls_tip', [override])
    found = str(caught.value)
    assert '\n' not in found
    assert not [word for word in words if word not in found], found


def test_a_path_that_touches_the_workspaces_edge_is_allowed() -> None:
    hold = ['trajectory.kind=hold', 'trajectory.hold_position=[0, 9]']
    assert scenario.load('pd_tip', hold).trajectory.hold_position == (0.0, 9.0)
    with pytest.raises(ScenarioError, match='hold_position'):
        scenario.load('pd_tip', [hold[0], 'trajectory.hold_position=[0, 9.000001]'])


def test_the_tips_location_is_compared_in_decimal() -> None:
    # In binary 0.7 + 0.1 is below 0.8.
    config = scenario.load(
        'pd_tip',
        [
            'plant.length=[0.7, 0.1]',
            'tip_sensor.location=0.8',
            'trajectory.kind=hold',
            'trajectory.hold_position=[0.7, 0]',
        ],
    )
    assert config.tip_sensor.location == 0.8


def test_unusable_files_are_named(tmp_path: Path) -> None:
    huge, binary, latin = (tmp_path / name for name in ('huge.yaml', 'b.yaml', 'l.yaml'))
    huge.write_text('#' * (1024 * 1024 + 1))
    binary.write_bytes(bytes(range(256)))
    latin.write_bytes('plant: ä'.encode('latin-1'))
    pipe = tmp_path / 'pipe.yaml'
    os.mkfifo(pipe)
    (tmp_path / 'directory.yaml').mkdir()
    for path, words in {
        huge: 'larger', binary: 'UTF-8', latin: 'UTF-8', pipe: 'not a file',
        tmp_path / 'directory.yaml': 'not a file', tmp_path / 'none.yaml': 'no such file',
    }.items():  # fmt: skip
        with pytest.raises(ScenarioError, match=words) as caught:
            scenario.load(path)
        assert str(path) in str(caught.value)
    with pytest.raises(ScenarioError, match="did you mean 'fls_tip'"):
        scenario.load('fls_tipp')


def test_a_path_of_torques_is_relative_to_its_scenario_or_to_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'there').mkdir()
    file = tmp_path / 'there' / 's.yaml'
    file.write_text(params('controller', '{law: open_loop, torque_file: t.csv}'))
    (tmp_path / 'there' / 't.csv').write_text('t,tau1,tau2\n0,1,2\n1.5,3,-4e-1\n')
    (tmp_path / 'u.csv').write_text('t,tau1,tau2\n0,9,9\n')
    monkeypatch.chdir(tmp_path)
    config = scenario.load(file)
    assert config.torques == ((0.0, 1.0, 2.0), (1.5, 3.0, -0.4))
    assert scenario.load(file, ['controller.torque_file=u.csv']).torques == ((0.0, 9.0, 9.0),)
    assert scenario.load(file, ['controller.law=pd']).torques == ()
    with pytest.raises(ScenarioError, match=r'none\.csv'):
        scenario.load(file, ['controller.torque_file=none.csv'])
    # What travels in a bag is data: the path is kept, and never opened.
    (tmp_path / 'there' / 't.csv').unlink()
    again = scenario.from_text(scenario.dump(config), config.torques)
    assert again == config
    with pytest.raises(ScenarioError, match=r'controller\.torque_file'):
        scenario.from_text(scenario.dump(config))


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', 't,tau1,tau2'),
        ('time,a,b\n0,0,0\n', 't,tau1,tau2'),
        ('t,tau1,tau2\n', 'at least one'),
        ('t,tau1,tau2\n0,0\n', 'line 2: 2 values'),
        ('t,tau1,tau2\n0,0,x\n', "line 2: tau2 is 'x'"),
        ('t,tau1,tau2\n0,nan,0\n', "line 2: tau1 is 'nan'"),
        ('t,tau1,tau2\n0,0,0\n-1,0,0\n', 'line 3: t is -1.0 after 0.0'),
        ('t,tau1,tau2\n0,1_0,0\n', '1_0'),
        ('t,tau1,tau2\n0,1e999,0\n', '1e999'),
        ('t,tau1,tau2\n0,"1', 'line'),
    ],
)
def test_a_bad_torque_file_is_named_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / 't.csv'
    path.write_text(text)
    with pytest.raises(ScenarioError) as caught:
        scenario.read_torques(path)
    assert words in str(caught.value)
    assert str(path) in str(caught.value)
    assert '\n' not in str(caught.value)


@settings(max_examples=100, deadline=None)
@given(
    st.lists(
        st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3),
        min_size=1, max_size=20,
    )
)  # fmt: skip
def test_torques_read_back_exactly(rows: list[tuple[float, float, float]]) -> None:
    from flexarm_ros.scenario.torque_file import parse_torques

    torques = tuple(sorted(rows, key=lambda row: row[0]))
    assert parse_torques(scenario.write_torques(torques), 't.csv') == torques


@pytest.mark.parametrize(
    ('text', 'nanoseconds'),
    [
        ('0.001', 1_000_000), ('1e-3', 1_000_000), ('1e-9', 1), ('16', 16 * 10**9),
        ('1e-10', None), ('0.0012380001', None), ('1.5e-9', None), ('nan', None), ('x', None),
        ('86400.000000001', 86400 * 10**9 + 1), ('1e99999999', None),
    ],
)  # fmt: skip
def test_seconds_are_whole_nanoseconds_by_their_decimal_text(
    text: str, nanoseconds: int | None
) -> None:
    assert exact_ns(text) == nanoseconds


def test_every_default_is_allowed_by_its_own_specification() -> None:
    for cls in SECTIONS.values():
        for key, (name, spec, default) in specs(cls).items():
            assert name == key.replace('.', '_')
            assert spec.doc
            if default is not None and spec.choices:
                assert default in spec.choices
            if isinstance(default, float) and spec.low is not None:
                assert default >= spec.low
