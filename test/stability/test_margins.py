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

"""Margins against closed forms, and against what the loop itself does."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.kinematics import jacobian, rigid_point
from flexarm_ros.core.parameters.rig import ActuatorParameters
from flexarm_ros.core.parameters.sections import (
    ControllerParameters,
    EncoderParameters,
    PlantParameters,
    RunConfig,
    RunParameters,
    TipSensorParameters,
    TrajectoryParameters,
)
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.stability.margins import analyse, is_stable, Pose, poses_along
from flexarm_ros.stability.modes import linearise
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

# Links so stiff and damped that the arm is the rigid one.
RIGID = PlantParameters(flexural_rigidity=(1e11, 1e11), damping_ratio=1.0)
KP, KD = 150.79, 17.364
BEND = 0.9


def rigid_loops(bend: float = BEND) -> np.ndarray:
    """
    Return the rigid arm's decoupled loops under J^T: mu of s^2 + mu (Kd s + Kp e^-sd) = 0.

    Kp J^T J and Kd J^T J are diagonal together with the mass matrix.
    """
    arm = linearise(RunConfig(plant=RIGID), bend)
    tip = np.array(jacobian((4.5, 4.5), 0.0, bend, 9.0)).reshape(2, 2)
    return np.asarray(eigh(tip.T @ tip, arm.mass[:2, :2], eigvals_only=True))


def crossing_of_both(mu: float) -> float:
    """Delay of position and rate at which s^2 + mu (Kp + Kd s) e^-sd has roots +-jw."""
    square = 0.5 * ((mu * KD) ** 2 + math.sqrt((mu * KD) ** 4 + 4.0 * (mu * KP) ** 2))
    w = math.sqrt(square)
    return math.atan2(KD * w, KP) / w


def crossing_of_position(mu: float) -> float:
    """Return the same with the position delayed and the rate at hand."""
    square = 0.5 * (-((mu * KD) ** 2) + math.sqrt((mu * KD) ** 4 + 4.0 * (mu * KP) ** 2))
    w = math.sqrt(square)
    return math.atan2(KD * w, w * w / mu) / w


def rigid_config(
    velocity_source: str, period: float, latency: float = 0.0, law: str = 'pd'
) -> RunConfig:
    return RunConfig(
        run=RunParameters(control_period=period, duration=30.0),
        plant=RIGID,
        tip_sensor=TipSensorParameters(latency=latency),
        controller=ControllerParameters(law=law, velocity_source=velocity_source),
    )


@pytest.mark.parametrize(('velocity_source', 'period'), [('feedback', 0.0005), ('encoder', 0.003)])
def test_crossing_delay_of_the_rigid_arm_is_the_closed_form(
    velocity_source: str, period: float
) -> None:
    crossing = crossing_of_both if velocity_source == 'feedback' else crossing_of_position
    expected = min(crossing(mu) for mu in rigid_loops())
    config = rigid_config(velocity_source, period)
    found = analyse(config, Pose(0.0, 0.0, BEND), max_latency_s=1.3 * expected)
    assert found.crossing_s is not None
    # The held torque is a delay of half a tick more, to second order in the tick.
    assert found.crossing_s + 0.5 * period == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize('law', ['pd', 'fls'])
def test_gain_margin_of_the_rigid_arm_is_the_closed_form(law: str) -> None:
    latency = 0.003
    top = max(rigid_loops())
    period = 0.0002
    whole = latency + 0.5 * period
    expected = brentq(lambda g: crossing_of_both(g * top) - whole, 0.1, 100.0)
    found = analyse(
        rigid_config('feedback', period, latency, law), Pose(0.0, 0.0, BEND), max_latency_s=0.005
    )
    assert found.stable
    assert found.gain == pytest.approx(1.0 if law == 'pd' else 2.5)
    assert found.gain_high == pytest.approx(expected, rel=4e-3)
    assert found.gain_low is None
    assert found.gain_margin == pytest.approx(found.gain_high / found.gain)


def test_an_unstable_gain_is_told_how_far_it_must_fall() -> None:
    config = rigid_config('feedback', 0.001, 0.003)
    stable = analyse(config, Pose(0.0, 0.0, BEND))
    assert stable.gain_high is not None
    unstable = analyse(config, Pose(0.0, 0.0, BEND), gain=2.0 * stable.gain_high)
    assert not unstable.stable
    assert unstable.gain_high == pytest.approx(stable.gain_high, rel=1e-3)
    assert unstable.gain_margin == pytest.approx(0.5, rel=1e-3)
    assert unstable.rate > 0.0
    assert unstable.crossing_s is not None
    assert unstable.crossing_s < 0.003
    assert unstable.delay_margin_s == pytest.approx(unstable.crossing_s - 0.003)


def test_the_true_tip_of_the_elastic_arm_is_stable_at_no_gain() -> None:
    """The nonminimum-phase limit: no gain of (20) on the point itself, delay or none."""
    config = RunConfig(
        tip_sensor=TipSensorParameters(measurand='elastic'),
        controller=ControllerParameters(law='pd'),
    )
    for pose in poses_along(config, 3):
        found = analyse(config, pose)
        assert not found.stable
        assert found.crossing_s == 0.0
        assert found.gain_high is None
        assert found.gain_margin is None


def test_poses_cover_the_square() -> None:
    poses = poses_along(RunConfig(), 7)
    bends = [pose.theta2 for pose in poses]
    assert bends == sorted(bends)
    assert len(bends) == 7
    # Corners at 6.3 sqrt(2) m, middles of the sides at 6.3 m from the shoulder.
    for bend, radius in ((bends[0], 6.3 * math.sqrt(2.0)), (bends[-1], 6.3)):
        assert math.cos(bend) == pytest.approx(radius**2 / 40.5 - 1.0, abs=1e-12)
    for pose in poses:
        x, y, _, _ = rigid_point(4.5, 4.5, pose.theta1, pose.theta2, 0.0, 0.0)
        assert max(abs(x), abs(y)) == pytest.approx(6.3)
    hold = RunConfig(trajectory=TrajectoryParameters(kind='hold', hold_position=(3.0, 4.0)))
    assert len(poses_along(hold)) == 1


# What the code does at rest, kicked, against the largest eigenvalue: feedback, latency,
# measurand, location, velocity source, law, model.
FLOWN: dict[str, dict[str, object]] = {
    'pd, crossing less 4 %': {'law': 'pd', 'part': 0.96},
    'pd, crossing plus 4 %': {'law': 'pd', 'part': 1.04},
    'fls, crossing less 4 %': {'law': 'fls', 'part': 0.96},
    'fls, crossing plus 4 %': {'law': 'fls', 'part': 1.04},
    'pd at 7 m, plus': {'law': 'pd', 'part': 1.04, 'location': 7.0},
    'pd, elastic, no delay': {'law': 'pd', 'latency': 0.0, 'measurand': 'elastic'},
    'fls, elastic, encoder rates': {
        'law': 'fls', 'latency': 0.0312, 'measurand': 'elastic', 'velocity_source': 'encoder',
    },
    'full, two modes': {'law': 'pd', 'latency': 0.0312, 'model': 'full'},
    'a slow law that takes its time, plus': {
        'law': 'pd', 'part': 1.04, 'rate': 250.0, 'compute_delay': 0.0015,
    },
    'a slow law, less': {'law': 'pd', 'part': 0.96, 'rate': 250.0},
    'late commands, plus': {
        'law': 'pd', 'part': 1.04, 'way': ActuatorParameters(latency=0.0013, rate=500.0),
    },
    'rates of all, less': {
        'law': 'pd', 'part': 0.96, 'rate': 250.0, 'sensor_rate': 500.0,
        'way': ActuatorParameters(latency=0.0005, bandwidth=(200.0, 200.0)),
    },
}  # fmt: skip


def flown(
    law: str,
    part: float = 1.0,
    latency: float | None = None,
    location: float = 9.0,
    measurand: str = 'rigid',
    velocity_source: str = 'feedback',
    model: str = 'eq14',
    rate: float = 0.0,
    compute_delay: float = 0.0,
    sensor_rate: float = 0.0,
    way: ActuatorParameters | None = None,
) -> tuple[RunConfig, SampledLoop]:
    plant = PlantParameters(
        model=model, modes=2 if model == 'full' else 1, initial_position=(0.0, BEND)
    )
    x, y, _, _ = rigid_point(4.5, 4.5, 0.0, BEND, 0.0, 0.0)
    config = RunConfig(
        run=RunParameters(duration=30.0),
        plant=plant,
        encoder=EncoderParameters(rate=sensor_rate),
        tip_sensor=TipSensorParameters(location=location, measurand=measurand, rate=sensor_rate),
        trajectory=TrajectoryParameters(kind='hold', hold_position=(x, y)),
        controller=ControllerParameters(
            law=law, velocity_source=velocity_source, rate=rate, compute_delay=compute_delay
        ),
        further=() if way is None else (('actuator', way),),
    )
    if latency is None:
        crossing = analyse(config, Pose(0.0, 0.0, BEND)).crossing_s
        assert crossing is not None
        latency = round(crossing * part, 9)
    config = replace(config, tip_sensor=replace(config.tip_sensor, latency=latency))
    return config, SampledLoop(config, BEND, 'plant')


@pytest.mark.parametrize('name', FLOWN)
def test_the_flown_loop_grows_or_fades_as_its_largest_eigenvalue(name: str) -> None:
    config, linear = flown(**FLOWN[name])  # type: ignore[arg-type]
    value = linear.eigenvalues()[0]
    rate, period = (
        math.log(abs(value)) / linear.period,
        2.0 * math.pi * 0.001 / abs(np.angle(value)),
    )
    assert is_stable(linear) == (rate < 0.0)
    loop = ClosedLoop(config)
    n = len(loop.plant.q)
    kick = np.zeros(2 * n)
    kick[n:][:2] = 1e-10
    rest = np.zeros(2 * n)
    rest[1] = BEND
    loop.tick()
    loop.plant.set_state((rest + kick)[:n], (rest + kick)[n:])
    # What else was excited needs time to fall behind; e^16 times the kick is still small.
    wait, span = (8.0 / rate, 3.0 / rate) if rate > 0.0 else (6.0, 20.0)
    span = math.ceil(span / period) * period
    first, last = (envelope(loop, start, period) for start in (wait, wait + span))
    assert (last > first) == (rate > 0.0)
    assert math.log(last / first) / span == pytest.approx(rate, rel=0.05)


def envelope(loop: ClosedLoop, start: float, width: float) -> float:
    """Largest rate of a coordinate within ``width`` s after ``start``, s."""
    largest, end = 0.0, start + width
    while loop.k * 0.001 < end:
        record = loop.tick()
        assert record is not None
        if record.k * 0.001 >= start:
            largest = max(largest, float(np.abs(record.qd).max()))
    return largest
