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

"""The linear forms of the laws that plan the motion, against the laws' own code."""

from __future__ import annotations

from flexarm_ros.core.arm.kinematics import elastic_point, make_point, rigid_point
from flexarm_ros.core.control import Law, make_law, Sample
from flexarm_ros.core.control.lqg import LqgLaw, UNKNOWNS
from flexarm_ros.core.control.planned import PassiveLaw
from flexarm_ros.core.parameters.sections import (
    ControllerParameters,
    PlantParameters,
    RunConfig,
    RunParameters,
    TipSensorParameters,
    TrajectoryParameters,
)
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.stability.form import LinearLaw, NoLinearFormError
from flexarm_ros.stability.law import linear_law
from flexarm_ros.stability.modes import linearise
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np
import pytest

BEND, TURN = 0.9, 0.4
TICK = 300
LATENCY = 0.0044
MODES = 3
"""As in the shipped scenarios of these laws: compiled once for both."""


def holding(law: str, turn: float = TURN, **tip: float) -> RunConfig:
    """Return a scenario in which ``law`` holds the arm at rest."""
    plant = PlantParameters(model='full', modes=MODES, initial_position=(turn, BEND))
    x, y, _, _ = rigid_point(*plant.length, turn, BEND, 0.0, 0.0)
    sensor = {'latency': LATENCY, 'location': 8.0, **tip}
    return RunConfig(
        run=RunParameters(duration=1.0),
        plant=plant,
        tip_sensor=TipSensorParameters(measurand='elastic', **sensor),  # type: ignore[arg-type]
        trajectory=TrajectoryParameters(kind='hold', hold_position=(x, y)),
        controller=ControllerParameters(law=law, feedback='tip_sensor'),
    )


def at_rest(config: RunConfig) -> Sample:
    """Return what the controller is given at rest."""
    pose = (TURN, BEND, *([0.0] * (2 * config.plant.modes)))
    zero = (0.0,) * len(pose)
    at = make_point(config.plant, config.tip_sensor.location, True)
    x, y, _, _ = elastic_point(np.array(pose), np.array(zero), at.shapes, at.shortening)
    reference = (*config.trajectory.hold_position, 0.0, 0.0)  # type: ignore[misc]
    encoder, tip = (TURN, BEND, 0.0, 0.0), (x, y, 0.0, 0.0)
    return Sample(pose, zero, (0.0, 0.0), encoder, tip, reference)


def memory_of(law: Law, config: RunConfig) -> list[tuple[np.ndarray, object]]:
    """Return the arrays and places that hold the law's state, in the analysis's order."""
    if isinstance(law, LqgLaw):
        z, v, integral = law._memory
        size = 4 + 4 * config.plant.modes
        kept = np.delete(np.arange(len(z)), size + np.arange(UNKNOWNS))
        return [(z, kept), (v, np.arange(2)), (integral, np.arange(2))]
    assert isinstance(law, PassiveLaw)
    ring = law._ring
    ages = [(TICK - 1 - age) % len(ring) for age in range(len(ring) - 2)]
    return [(ring, age) for age in ages] + [(law._correction, np.arange(2))]


def after(law: Law, config: RunConfig, ends: bool) -> np.ndarray:
    """Return the law's state; ``ends``: after the tick, when the newest is a tick older."""
    if isinstance(law, PassiveLaw) and ends:
        ring = law._ring
        newest = [ring[(TICK - age) % len(ring)] for age in range(len(ring) - 2)]
        return np.concatenate([*newest, law._correction])
    parts = [array[place] for array, place in memory_of(law, config)]  # type: ignore[index]
    return np.concatenate(parts)


def differentiated(config: RunConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return how (state after a tick, torques) of the code change with (state, readings)."""
    law, sample = make_law(config), at_rest(config)
    for k in range(TICK):
        law.torque(k, sample)
    rest = np.array(after(law, config, ends=False))
    arrays = {id(array): array for array, _ in memory_of(law, config)}.values()
    kept = [(array, array.copy()) for array in arrays]
    unknowns = law.unknowns if isinstance(law, LqgLaw) else np.zeros(0)
    assert np.abs(unknowns).sum() < 1e-15

    def tick(change: np.ndarray) -> np.ndarray:
        for array, value in kept:
            array[:] = value
        moved, start = change[: len(rest)], 0
        for array, place in memory_of(law, config):
            width = array[place].size  # type: ignore[index]
            array[place] += moved[start:][:width]  # type: ignore[index]
            start += width
        readings = np.concatenate([sample.encoder, sample.tip]) + change[-8:]
        given = sample._replace(encoder=tuple(readings[:4]), tip=tuple(readings[4:]))
        torque = law.torque(TICK, given)
        return np.concatenate([after(law, config, ends=True), torque])

    size, step = len(rest) + 8, 1e-6
    columns = [(tick(step * unit) - tick(-step * unit)) / (2.0 * step) for unit in np.eye(size)]
    found = np.array(columns).T
    return np.vsplit(found, [len(rest)])


@pytest.mark.parametrize('law', ['passive', 'lqg', 'adaptive'])
def test_the_matrices_are_the_code_s_own_derivative(law: str) -> None:
    config = holding(law)
    # What adaptive learns from one tick is not in the linear form: its estimates are held.
    form = linear_law(config, linearise(config, BEND, TURN), TICK * 0.001)
    state, torque = differentiated(config)
    inputs = 2 * (2 + 2 * config.plant.modes)
    assert not form.b[:, :inputs].any()
    expected = np.block([[form.a, form.b[:, inputs:]], [form.c, form.d[:, inputs:]]])
    found = np.vstack([state, torque])
    scale = np.abs(expected).max(axis=1, keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=1e-6)


@pytest.mark.parametrize('law', ['passive', 'lqg'])
def test_the_direction_in_which_the_arm_stands_does_not_matter(law: str) -> None:
    # Filter and integral are in frame base: the plan's direction is turned to the analysis's.
    config = holding(law)
    other = holding(law, TURN + 1.0)
    here, there = (SampledLoop(c, BEND, time=0.3).eigenvalues() for c in (config, other))
    clear = here[np.abs(here) > 0.7]
    assert len(clear) > 12
    for value in clear:
        assert np.abs(there - value).min() < 1e-6


def test_gains_are_those_of_the_pose_s_time() -> None:
    config = holding('lqg')
    arm = linearise(config, BEND, TURN)
    early, late = (linear_law(config, arm, time) for time in (0.02, 0.9))
    assert np.abs(early.b - late.b).max() > 1e-3
    # Without a time it is the last that has the pose, and here the arm has it all the time.
    last = linear_law(config, arm, 100.0)
    np.testing.assert_array_equal(linear_law(config, arm).b, last.b)


@pytest.mark.parametrize('law', ['inverse', 'passive'])
def test_a_kicked_arm_follows_the_matrix(law: str) -> None:
    size, count, config = 1e-6, 2 + 2 * MODES, holding(law)
    kick = np.zeros(2 * count)
    kick[:6] = 0.3, -0.2, 0.01, 0.004, 0.005, 0.002
    kick[count:][:2] = 1.0, 2.0
    linear = SampledLoop(config, BEND, 'plant')
    loop, state = ClosedLoop(config), np.zeros(len(linear.matrix()))
    rest = np.concatenate([[TURN, BEND], np.zeros(2 * count - 2)])
    for _ in range(20):
        assert loop.tick() is not None
    loop.torque = None
    loop.plant.set_state(*np.split(rest + size * kick, 2))
    state[: 2 * count] = kick
    matrix = linear.matrix()
    for _ in range(300):
        record = loop.tick()
        assert record is not None
        found = (np.concatenate([record.q, record.qd]) - rest) / size
        reference = np.abs(state[: 2 * count]).max()
        np.testing.assert_allclose(found, state[: 2 * count], atol=5e-4 * reference)
        state = matrix @ state


def test_the_sensor_that_a_law_does_not_read_is_not_the_one_that_is_delayed() -> None:
    loop = SampledLoop(holding('inverse'), BEND)
    assert loop.sensor == 'encoder'
    assert loop.latency_ns == 0
    assert loop.modulus(1.0, 2_000_000) < 1.0 < loop.modulus(1.0, 30_000_000)


@pytest.mark.parametrize('law', ['passive', 'lqg', 'adaptive'])
def test_a_slow_tip_sensor_is_refused(law: str) -> None:
    with pytest.raises(NoLinearFormError, match='^tip_sensor.rate: 100 Hz, law'):
        SampledLoop(holding(law, rate=100.0), BEND)


def test_inverse_takes_a_slow_tip_sensor() -> None:
    assert isinstance(SampledLoop(holding('inverse', rate=100.0), BEND).law, LinearLaw)
