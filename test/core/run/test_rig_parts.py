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

"""The drives' set point and lag, the disturbance's tables, and what is refused."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
import re

from flexarm_ros import scenario
from flexarm_ros.core.parameters.rig import ActuatorParameters, DisturbanceParameters
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import highest_frequency, is_driven, make_plant
from flexarm_ros.core.run.parts import check_parts, columns, parts_of
from flexarm_ros.core.run.required_parts import PlantPart
from flexarm_ros.core.run.rig_parts import ActuatorPart, DisturbancePart
from flexarm_ros.scenario import ScenarioError
import pytest


def with_part(name: str, held: object, **run: object) -> RunConfig:
    return RunConfig(run=RunParameters(**run), further=((name, held),))  # type: ignore[arg-type]


def test_an_ideal_drive_passes_the_command_on() -> None:
    part = ActuatorPart(with_part('actuator', ActuatorParameters()))
    assert part.answer(0, (3.0, -2.0)) == (3.0, -2.0, 3.0, -2.0)
    assert part.answer(1, (0.1, 7.0)) == (0.1, 7.0, 0.1, 7.0)


def test_the_set_point_is_rounded_then_reduced_then_saturated() -> None:
    drive = ActuatorParameters(
        resolution=(0.5, 0.0), efficiency=(0.8, 0.75), torque_limit=(5.0, 3.0)
    )
    part = ActuatorPart(with_part('actuator', drive))
    assert part.answer(0, (2.7, -2.0))[2:] == (0.8 * 2.5, -1.5)
    assert part.answer(1, (-20.0, 20.0))[2:] == (-5.0, 3.0)


def test_the_applied_torque_is_a_first_order_lag_of_the_set_point() -> None:
    part = ActuatorPart(with_part('actuator', ActuatorParameters(bandwidth=(50.0, 0.0))))
    fall, torque = math.exp(-2.0 * math.pi * 50.0 * 1e-3), 0.0
    for k, command in enumerate((4.0, 4.0, -1.0, 0.0)):
        found = part.answer(k, (command, command))
        assert found == (pytest.approx(torque, abs=1e-14), command, command, command)
        torque = command + (torque - command) * fall


def test_currents_become_torques_at_the_joint() -> None:
    drive = ActuatorParameters(
        torque_constant=(0.119, 0.0234), gear_ratio=(100.0, 50.0), efficiency=(0.75, 0.75)
    )
    assert drive.torque_per_ampere == pytest.approx((8.925, 0.8775))


def test_without_the_sections_there_is_neither_part_nor_topic() -> None:
    plain = RunConfig()
    assert not is_driven(plain)
    assert PlantPart.reads(plain) == ('joint_command',)
    assert not {ActuatorPart, DisturbancePart} & {*parts_of(plain)}
    both = RunConfig(
        further=(('actuator', ActuatorParameters()), ('disturbance', DisturbanceParameters()))
    )
    assert is_driven(both)
    assert PlantPart.reads(both) == ('actuator/torque', 'disturbance/wrench')
    names = [column.name for column in columns(both)]
    assert names == ['applied1', 'applied2', 'force_x', 'force_y']


def test_a_drive_in_its_gap_leaves_the_joint_faster() -> None:
    drive = ActuatorParameters(backlash=(0.01, 0.0))
    assert highest_frequency(with_part('actuator', drive)) > 1.2 * highest_frequency(RunConfig())


def test_the_force_is_linear_between_rows_at_the_middle_of_the_tick() -> None:
    held = DisturbanceParameters(
        force_times=(0.001, 0.003, 0.003), force_x=(0.0, 4.0, -1.0), force_y=(2.0, 2.0, 0.0)
    )
    part = DisturbancePart(with_part('disturbance', held))
    found = [part.answer(k, None) for k in range(5)]
    expected = [(0.0, 2.0), (1.0, 2.0), (3.0, 2.0), (-1.0, 0.0), (-1.0, 0.0)]
    assert found == [pytest.approx(pair) for pair in expected]
    assert DisturbancePart(with_part('disturbance', DisturbanceParameters())).answer(0, None) == (
        0.0,
        0.0,
    )


def test_the_payload_is_on_a_topic_where_it_varies() -> None:
    held = DisturbanceParameters(payload_times=(0.002, 0.004), payload_masses=(0.5, 0.1))
    part = DisturbancePart(with_part('disturbance', held))
    assert [part.answer(k, None)[1] for k in range(6)] == [
        *((0.0,), (0.0,), (0.5,), (0.5,), (0.1,), (0.1,)),
    ]
    for varied in (held, DisturbanceParameters(payload_live=True)):
        config = with_part('disturbance', varied)
        assert PlantPart.reads(config)[1:] == ('disturbance/wrench', 'disturbance/payload')
        assert columns(config)[-1].name == 'payload'


def test_the_steps_are_those_of_the_lightest_payload() -> None:
    """Any payload may come where it is live; a lighter one than expected is refused."""
    plant = PlantParameters(model='full', payload_mass=2.0)

    def loaded(**keys: object) -> RunConfig:
        held = DisturbanceParameters(**keys)  # type: ignore[arg-type]
        return replace(with_part('disturbance', held), plant=plant)

    rates = [
        highest_frequency(loaded(**keys))  # type: ignore[arg-type]
        for keys in (
            {}, {'payload_times': (1.0,), 'payload_masses': (0.5,)}, {'payload_live': True},
        )
    ]  # fmt: skip
    assert rates[0] < rates[1] < rates[2]
    arm = make_plant(loaded(payload_times=(1.0,), payload_masses=(0.5,)))
    arm.disturb(0.0, 0.0, 0.5)  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=re.escape('payload 0.4 kg; allowed: 0.5 to 1000000')):
        arm.disturb(0.0, 0.0, 0.4)  # type: ignore[attr-defined]
    make_plant(loaded(payload_live=True)).disturb(0.0, 0.0, 0.0)  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ('config', 'text'),
    [
        (
            RunConfig(
                plant=PlantParameters(hub_inertia=(8.0, 0.0)),
                further=(('actuator', ActuatorParameters(backlash=(0.0, 0.01))),),
            ),
            'actuator.backlash: 0.01 rad of elbow, whose plant.hub_inertia is 0',
        ),
        (
            replace(
                with_part('actuator', ActuatorParameters(), sync='free'),
                plant=PlantParameters(command_loss='zero'),
            ),
            'plant.command_loss: zero; allowed with sync: free and section actuator',
        ),
        (
            with_part('disturbance', DisturbanceParameters(force_file='x.csv')),
            'disturbance.force_file: its contents were not supplied',
        ),
        (
            with_part('disturbance', DisturbanceParameters(payload_times=(0.0, 1.0))),
            'disturbance.payload_times: payload_times, payload_masses must be of one length',
        ),
        (
            with_part(
                'disturbance',
                DisturbanceParameters(payload_times=(1.0, 0.5), payload_masses=(1.0, 2.0)),
            ),
            'disturbance.payload_times: 0.5 s after 1.0 s; times must not decrease',
        ),
    ],
)
def test_what_does_not_fit_is_refused(config: RunConfig, text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        check_parts(config)


def written(directory: Path, rows: str) -> Path:
    (directory / 'push.csv').write_text(rows)
    path = directory / 'pushed.yaml'
    path.write_text(
        '# Pushed\ndisturbance:\n  ros__parameters:\n    force_file: push.csv\n', 'utf-8'
    )
    return path


def test_a_file_beside_the_scenario_travels_in_it(tmp_path: Path) -> None:
    config = scenario.load(written(tmp_path, 't,fx,fy\n0,0,0\n0.5,1.5,-2\n'))
    held = config.section('disturbance')
    assert held == DisturbanceParameters(
        force_times=(0.0, 0.5), force_x=(0.0, 1.5), force_y=(0.0, -2.0)
    )
    (tmp_path / 'push.csv').unlink()
    assert scenario.from_text(scenario.dump(config)).section('disturbance') == held


@pytest.mark.parametrize(
    ('rows', 'text'),
    [
        ('t,fx\n0,0\n', "line 1 is 't,fx'; it must be 't,fx,fy'"),
        ('t,fx,fy\n', "0 rows below 't,fx,fy'; allowed: 1 to 10000"),
        ('t,fx,fy\n0,1,two\n', "line 2: '0,1,two' is not 3 finite numbers"),
    ],
)
def test_a_faulty_file_is_named(tmp_path: Path, rows: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(text)):
        scenario.load(written(tmp_path, rows))


def test_a_path_in_a_bag_is_not_opened(tmp_path: Path) -> None:
    text = written(tmp_path, 't,fx,fy\n0,1,1\n').read_text()
    with pytest.raises(ScenarioError, match='its contents were not supplied'):
        scenario.from_text(text)
