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


"""The IMU: exact motion of the bent arm, noise and bias by their Allan variance, in every run."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
import re
from typing import Any

from flexarm_ros import cli, scenario
from flexarm_ros.core.arm.kinematics import frame_motion, frame_shapes, make_point
from flexarm_ros.core.parameters.rig import (
    ActuatorParameters,
    DisturbanceParameters,
    ImuParameters,
)
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.part import ACCELERATION
from flexarm_ros.core.run.parts import check_parts, parts_of
from flexarm_ros.core.run.state import State
from flexarm_ros.core.sensing.imu import IMU, ImuPart
from flexarm_ros.wire.topics import per_tick_topics
import numpy as np
import pytest

STEP = 2e-5
ARMS = {
    'eq14': PlantParameters(modes=2),
    'full': PlantParameters(model='full', modes=2, hub_radius=(0.2, 0.1), end_offset=(0.1, 0.3)),
    'friction': PlantParameters(model='full', modes=2, coulomb_friction=(5.0, 3.0)),
    'drives': PlantParameters(modes=2, coulomb_friction=(5.0, 3.0)),
}
RIG: tuple[tuple[str, Any], ...] = (
    ('actuator', ActuatorParameters(bandwidth=(20.0, 0.0))),
    ('disturbance', DisturbanceParameters()),
)


def moving(name: str) -> tuple[Any, PlantParameters]:
    """Return a plant in motion, with ticks of `STEP`."""
    plant = replace(ARMS[name], initial_position=(0.4, 0.9), initial_velocity=(0.6, -1.1))
    further = RIG if name == 'drives' else ()
    arm: Any = make_plant(RunConfig(RunParameters(control_period=STEP), plant, further=further))
    q, qd = arm.q.copy(), arm.qd.copy()
    q[2:], qd[2:] = (0.3, -0.02, 0.4, 0.03), (0.5, 0.4, -0.8, 0.3)
    arm.set_state(q, qd)
    if name == 'drives':
        arm.disturb(3.0, -4.0)
    return arm, plant


@pytest.mark.parametrize('name', ARMS)
@pytest.mark.parametrize('share', [0.2, 0.45, 0.8, 1.0])
def test_acceleration_and_rate_are_those_of_a_fine_solution(name: str, share: float) -> None:
    """Central differences of the velocity of the point and of the direction of its tangent."""
    arm, plant = moving(name)
    place = share * sum(plant.spans)
    point, frame = make_point(plant, place, elastic=True), frame_shapes(plant, place)
    ahead = make_point(plant, place + 1e-6, elastic=True)
    torque = (40.0, -25.0)
    arm.step(*torque)
    before = point(arm.q, arm.qd)[2:]
    arm.step(*torque)
    rate, along, across = frame_motion(arm.q, arm.qd, np.array(arm.acceleration()), *frame)
    here, there = point(arm.q, arm.qd), ahead(arm.q, arm.qd)
    arm.step(*torque)
    after = point(arm.q, arm.qd)[2:]
    ax, ay = ((b - a) / (2.0 * STEP) for a, b in zip(before, after, strict=True))
    tangent = math.atan2(there[1] - here[1], there[0] - here[0])
    cosine, sine = math.cos(tangent), math.sin(tangent)
    scale = math.hypot(ax, ay)
    # The tangent of a foreshortened link is inexact in the second order of its slope.
    assert along == pytest.approx(cosine * ax + sine * ay, abs=3e-2 * scale)
    assert math.hypot(along, across) == pytest.approx(scale, rel=1e-5)
    normal = (-sine, cosine)
    relative = [(b - a) / 1e-6 for a, b in zip(here[2:], there[2:], strict=True)]
    assert rate == pytest.approx(np.dot(relative, normal), rel=3e-2, abs=1e-3)


@pytest.mark.parametrize('model', ['eq14', 'full'])
@pytest.mark.parametrize('place', [3.0, 8.0])
def test_a_stiff_arm_is_the_rigid_closed_form(model: str, place: float) -> None:
    plant = PlantParameters(model=model, modes=1, flexural_rigidity=(1e9, 1e9))
    a, b, da, db, dda, ddb = 0.3, 0.8, 0.7, -1.3, 2.0, 3.0
    q, qd, qdd = (np.array([*values, 0.0, 0.0]) for values in ((a, b), (da, db), (dda, ddb)))
    rate, along, across = frame_motion(q, qd, qdd, *frame_shapes(plant, place))
    if place < 4.5:
        assert (rate, along, across) == pytest.approx((da, -place * da**2, place * dda))
        return
    w, alpha, rest = da + db, dda + ddb, place - 4.5
    x, y = -4.5 * da**2, 4.5 * dda
    expected = math.cos(b) * x + math.sin(b) * y, math.cos(b) * y - math.sin(b) * x
    assert rate == pytest.approx(w)
    assert (along, across) == pytest.approx(
        (expected[0] - rest * w**2, expected[1] + rest * alpha)
    )


def test_a_flown_stiff_arm_measures_the_rigid_motion() -> None:
    stiff = ['plant.flexural_rigidity=[1e8, 1e8]', 'plant.damping_ratio=0.9']
    config = scenario.load('pd_tip', ['duration=1.0', *stiff])
    loop, rows = ClosedLoop(replace(config, further=(('imu', ImuParameters(location=3.0)),))), []
    places = [loop.answers.places[topic] for topic in (IMU, ACCELERATION)]
    while (record := loop.tick()) is not None:
        measured, change = (record.messages[place] for place in places)
        rows.append([*measured[1:], record.qd[0], change[0]])
    rate, along, across, spin, alpha = np.array(rows)[200:].T
    assert rate == pytest.approx(spin, abs=1e-2 * abs(spin).max())
    scale = abs(across).max()
    assert along == pytest.approx(-3.0 * spin**2, abs=1e-2 * scale)
    assert across == pytest.approx(3.0 * alpha, abs=1e-2 * scale)


@pytest.mark.parametrize('name', ARMS)
def test_the_accelerations_are_the_change_of_the_rates(name: str) -> None:
    arm, _ = moving(name)
    arm.step(10.0, 5.0)
    before = arm.qd.copy()
    arm.step(10.0, 5.0)
    found = np.array(arm.acceleration())
    arm.step(10.0, 5.0)
    expected = (arm.qd - before) / (2.0 * STEP)
    assert found == pytest.approx(expected, abs=1e-4 * np.abs(expected).max())


def test_before_the_first_step_there_is_no_torque() -> None:
    for name in ('eq14', 'full', 'friction'):
        config = RunConfig(plant=ARMS[name])
        assert make_plant(config).acceleration() == pytest.approx([0.0] * 6, abs=1e-12)


def still(held: ImuParameters, ticks: int, period: float = 0.01) -> np.ndarray:
    """Return what an IMU reads on an arm at rest, (ticks, 3)."""
    config = RunConfig(RunParameters(control_period=period), further=(('imu', held),))
    part, zeros = ImuPart(config), np.zeros(4)
    state = State(zeros, zeros, (0.0,) * 4)
    return np.array([part.answer(k, state, (0.0,) * 4)[1:] for k in range(ticks)])


def allan_variance(values: np.ndarray, count: int) -> np.ndarray:
    """Return the Allan variance of each column at an averaging time of ``count`` samples."""
    whole = len(values) // count * count
    means = values[:whole].reshape(-1, count, values.shape[1]).mean(axis=1)
    return np.asarray(0.5 * np.mean(np.diff(means, axis=0) ** 2, axis=0))


def test_white_noise_has_its_allan_variance() -> None:
    gyro, accel = 0.02, 0.3
    held = ImuParameters(gyro_noise_density=gyro, accel_noise_density=accel)
    values = still(held, 40_000)
    for count in (1, 10, 50):
        expected = np.array([gyro, accel, accel]) ** 2 / (count * 0.01)
        assert allan_variance(values, count) == pytest.approx(expected, rel=0.15)
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 0.03


def test_a_walking_bias_has_its_allan_variance() -> None:
    gyro, accel = 0.05, 0.4
    held = ImuParameters(
        gyro_bias_walk=gyro, accel_bias_walk=accel, gyro_bias=0.7, accel_bias=-2.0
    )
    values = still(held, 40_000)
    assert values[0] == pytest.approx([0.7, -2.0, -2.0])
    for count in (20, 50):
        expected = np.array([gyro, accel, accel]) ** 2 * (count * 0.01) / 3.0
        assert allan_variance(values, count) == pytest.approx(expected, rel=0.2)


def test_the_message_has_no_orientation_and_its_variances(tmp_path: Path) -> None:
    from flexarm_ros.wire.generic_decode import message

    held = ImuParameters(gyro_noise_density=0.01, accel_noise_density=0.02)
    config = replace(scenario.load('pd_tip'), further=(('imu', held),))
    topic = next(t for t in per_tick_topics(config) if t.name == IMU)
    found = message(topic.type_name, topic.codec.encode(1_500_000_000, 0.1, 0.2, 0.3))
    assert topic.type_name == 'sensor_msgs/msg/Imu'
    assert found.header.frame_id == 'imu'
    assert found.orientation_covariance[0] == -1.0
    assert found.angular_velocity.z == 0.1
    assert (found.linear_acceleration.x, found.linear_acceleration.y) == (0.2, 0.3)
    assert found.angular_velocity_covariance[8] == pytest.approx(1e-4 * 1000.0)
    expected = [4e-4 * 1000.0, 0, 0, 0, 4e-4 * 1000.0, 0, 0, 0, 0]
    assert found.linear_acceleration_covariance.tolist() == pytest.approx(expected)


def test_a_place_beyond_the_tip_is_refused() -> None:
    config = replace(scenario.load('pd_tip'), further=(('imu', ImuParameters(location=9.1)),))
    text = 'imu.location: 9.1 m, allowed: 0 (shoulder) to 9 m (tip)'
    with pytest.raises(ValueError, match=re.escape(text)):
        check_parts(config)
    assert ImuPart not in parts_of(scenario.load('pd_tip'))


@pytest.mark.parametrize('case', ['fls_tip', 'fls_full', 'lab_arm'])
def test_a_run_is_verified(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        'imu.latency=0.005', 'imu.gyro_noise_density=0.001', 'imu.accel_bias_walk=0.01',
        'imu.accel_noise_density=0.01', 'duration=0.2',
    ]  # fmt: skip
    sets = [part for word in words for part in ('--set', word)]
    out = tmp_path / 'run'
    assert cli.main(['simulate', case, *sets, '--no-pictures', '--out', str(out)]) == 0
    assert cli.main(['verify', str(out)]) == 0
    told = capsys.readouterr().out
    assert re.search(r'imu +\d+ messages the same', told)
    header = (out / 'trajectory.csv').read_text().splitlines()[0]
    assert 'imu_gyro_z,imu_accel_x,imu_accel_y' in header
    assert cli.main(['export', str(out), '--out', str(tmp_path / 'rows')]) == 0
    rows = (tmp_path / 'rows' / 'imu_data.csv').read_text().splitlines()
    assert rows[0].endswith('linear_acceleration.x,linear_acceleration.y')
    assert (tmp_path / 'rows' / 'plant_acceleration.csv').is_file()
