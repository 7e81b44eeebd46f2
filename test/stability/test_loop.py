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

"""The linearised loop against the loop itself, differentiated numerically, and against theory."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.kinematics import rigid_point
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
from flexarm_ros.core.run.state import State
from flexarm_ros.stability.form import LinearLaw, NoLinearFormError
from flexarm_ros.stability.hold import hold_matrices
from flexarm_ros.stability.law import linear_law
from flexarm_ros.stability.modes import linearise, natural_frequencies
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np
import pytest

BEND = 0.9
TURN = 0.4


def resting(
    plant: PlantParameters,
    tip: TipSensorParameters,
    control: ControllerParameters,
    encoder: EncoderParameters | None = None,
    period: float = 0.001,
) -> RunConfig:
    """Return a scenario that holds the tip where the straight-linked arm has it."""
    lengths = plant.length
    x, y, _, _ = rigid_point(*lengths, TURN, BEND, 0.0, 0.0)
    return RunConfig(
        run=RunParameters(control_period=period, duration=10.0),
        plant=replace(plant, initial_position=(TURN, BEND)),
        encoder=encoder or EncoderParameters(),
        tip_sensor=tip,
        trajectory=TrajectoryParameters(kind='hold', hold_position=(x, y)),
        controller=control,
    )


CASES = {
    'pd collocated': resting(
        PlantParameters(),
        TipSensorParameters(),
        ControllerParameters(law='pd', feedback='encoder'),
        EncoderParameters(latency=0.0023),
    ),
    'pd at the tip': resting(
        PlantParameters(),
        TipSensorParameters(latency=0.001238),
        ControllerParameters(law='pd'),
    ),
    'whole ticks': resting(
        PlantParameters(),
        TipSensorParameters(latency=0.003, location=8.0),
        ControllerParameters(law='pd'),
    ),
    'no latency': resting(
        PlantParameters(),
        TipSensorParameters(location=5.0, measurand='elastic'),
        ControllerParameters(law='pd'),
    ),
    'fls, elastic, joint rates': resting(
        PlantParameters(modes=2, damping_ratio=0.02),
        TipSensorParameters(latency=0.0047, measurand='elastic', location=7.3),
        ControllerParameters(velocity_source='encoder'),
    ),
    'fls, full': resting(
        PlantParameters(model='full', modes=2, hub_inertia=(3.0, 9.0), payload_mass=0.2),
        TipSensorParameters(latency=0.0009289, measurand='elastic', location=6.75),
        ControllerParameters(),
    ),
    'encoder, joint rates': resting(
        PlantParameters(length=(3.0, 5.0)),
        TipSensorParameters(location=8.0),
        ControllerParameters(law='pd', feedback='encoder', velocity_source='encoder'),
        EncoderParameters(latency=0.0011),
    ),
}


def past_depth(config: RunConfig) -> int:
    """How many earlier ticks the controller's inputs depend on."""
    latency = max(config.encoder.latency, config.tip_sensor.latency)
    return math.ceil(latency / config.run.control_period)


def one_tick(loop: ClosedLoop, states: np.ndarray) -> np.ndarray:
    """
    Return the plant's state after the tick that the code makes of states ``(depth + 1, 2 n)``.

    The last row is the state of this tick, those before it are what the
    sensors saw.
    """
    loop.torque = None
    n = len(loop.plant.q)
    for k, state in enumerate(states[:-1]):
        for role in ('encoder', 'tip_sensor'):
            loop.answers.parts[role].answer(k, State(state[:n], state[n:], (0.0,) * 4))
    loop.k = len(states) - 1
    loop.plant.set_state(states[-1, :n], states[-1, n:])
    assert loop.tick() is not None
    following = loop.tick()
    assert following is not None
    return np.concatenate([following.q, following.qd])


def differentiated(config: RunConfig, step: float) -> np.ndarray:
    """Central differences of :func:`one_tick`: ``(2 n, age of the state in ticks, 2 n)``."""
    depth, n = past_depth(config), 2 + 2 * config.plant.modes
    rest = np.zeros((depth + 1, 2 * n))
    rest[:, :2] = TURN, BEND
    result = np.zeros((2 * n, depth + 1, 2 * n))
    loop = ClosedLoop(config)
    for age in range(depth + 1):
        for j in range(2 * n):
            change = np.zeros_like(rest)
            change[depth - age, j] = step
            difference = one_tick(loop, rest + change) - one_tick(loop, rest - change)
            result[:, age, j] = difference / (2.0 * step)
    return result


def predicted(config: RunConfig, integrator: str) -> np.ndarray:
    """Return the same from the analysis: its matrix, and what each state is of past states."""
    loop = SampledLoop(config, BEND, integrator, compress=False)
    rotated = linearise(config, BEND, TURN)
    n, depth = len(rotated.mass), past_depth(config)
    result = np.zeros((2 * n, depth + 1, 2 * n))
    matrix = loop.matrix()
    result[:, 0] = matrix[: 2 * n, : 2 * n]
    # The analysis is at theta1 = 0: the sensor's channels there are those at TURN, turned back.
    if config.controller.feedback == 'encoder':
        seen = np.kron(np.eye(2), np.eye(2, n))
    else:
        tip = config.tip_sensor
        point = linearise(config, BEND).point(tip.location, tip.measurand == 'elastic')
        seen = np.kron(np.eye(2), point)
    for age in range(1, depth + 1):
        start = 2 * n + 4 * (age - 1)
        result[:, age] = matrix[: 2 * n, start:][:, :4] @ seen
    return result


@pytest.mark.parametrize('name', CASES)
def test_the_one_tick_matrix_is_the_code_s_own_derivative(name: str) -> None:
    config = CASES[name]
    expected = predicted(config, 'plant')
    # Two steps, extrapolated: what is of second order in the step (the kinematics) and, with
    # lambda's kink at the origin, of first order, goes.
    coarse, fine = differentiated(config, 2e-5), differentiated(config, 1e-5)
    found = 2.0 * fine - coarse
    # Differences of states of order 1 lose 1e-16 / 1e-5 = 1e-11; each row against its largest.
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(found / scale, expected / scale, rtol=0.0, atol=2e-9)


@pytest.mark.parametrize('name', CASES)
def test_the_plant_s_steps_differ_from_the_exact_hold_by_their_own_error_only(name: str) -> None:
    config = CASES[name]
    exact = hold_matrices(linearise(config, BEND), 0.001)
    loop = SampledLoop(config, BEND, 'plant')
    # RK4 at 0.2 rad a step (eq14) is 1.3e-5 rad a rad out of phase on the fastest mode, at
    # 0.5 rad (full) 5e-4.
    worst = 5e-4 if config.plant.model == 'full' else 1.4e-5
    w = np.abs(np.linalg.eigvals(exact[0]))
    assert np.abs(w - 1.0).max() < 1e-2
    for a, b in zip(loop.hold, exact, strict=True):
        scale = np.abs(b).max(axis=1, keepdims=True)
        assert np.abs((a - b) / scale).max() < worst


@pytest.mark.parametrize('name', CASES)
def test_compression_keeps_the_eigenvalues(name: str) -> None:
    # The histories' own eigenvalues are defective zeros, which rounding scatters.
    config = CASES[name]
    whole = SampledLoop(config, BEND, compress=False).eigenvalues()
    short = SampledLoop(config, BEND).eigenvalues()
    assert len(short) <= len(whole)
    clear = whole[np.abs(whole) > 0.7]
    assert len(clear) >= 2 + 2 * config.plant.modes
    for value in clear:
        assert np.abs(short - value).min() < 1e-7


def test_the_pose_s_direction_does_not_matter() -> None:
    config = CASES['fls, full']
    a, b = linearise(config, BEND, 0.0), linearise(config, BEND, 2.0)
    size = 2 * len(a.mass)
    here, there = (linear_law(config, arm).d for arm in (a, b))
    for arm, law in ((a, here), (b, there)):
        point = arm.point(config.tip_sensor.location, elastic=True)
        law[:, :size] += law[:, size:][:, 4:] @ np.kron(np.eye(2), point)
    np.testing.assert_allclose(here[:, :size], there[:, :size], atol=1e-9)


def test_exact_hold_is_the_closed_form() -> None:
    config = CASES['pd at the tip']
    arm = linearise(config, BEND)
    a, b = hold_matrices(arm, 0.01)
    n = len(arm.mass)
    # Undamped and free: eigenvalues exp(+-j w T) at the natural frequencies.
    angles = np.sort(np.abs(np.angle(np.linalg.eigvals(a))))
    expected = np.repeat(natural_frequencies(config, BEND, 'free'), 2) * 0.01
    np.testing.assert_allclose(angles[4:], expected, rtol=1e-9)
    assert angles[:4].max() < 1e-5
    # Nothing else acts on theta1: the momentum conjugate to it grows by torque times T exactly.
    momentum = arm.mass[:2] @ b[n:]
    forced = momentum[0] @ np.array([1.0, 0.0])
    assert forced == pytest.approx(0.01, rel=1e-6)


@pytest.mark.parametrize('model', ['buffer', 'pade2'])
@pytest.mark.parametrize('latency', [0.0, 0.0004, 0.001, 0.0066])
def test_the_torques_of_the_code_follow_the_matrix_tick_by_tick(
    model: str, latency: float
) -> None:
    """A kicked arm, flown by the code, against powers of the matrix: every latency model."""
    tip = TipSensorParameters(latency=latency, latency_model=model, location=7.0)
    config = resting(PlantParameters(), tip, ControllerParameters(law='pd'))
    follows(config)


@pytest.mark.parametrize('rate', [500.0, 100.0])
def test_a_slow_sensor_s_matrix_spans_its_sample(rate: float) -> None:
    tip = TipSensorParameters(latency=0.0012, rate=rate)
    follows(resting(PlantParameters(), tip, ControllerParameters(law='pd')))


def follows(config: RunConfig) -> None:
    size, kick = 1e-6, np.array([0.3, -0.2, 0.5, 0.4, 1.0, 2.0, -1.0, 0.5])
    linear = SampledLoop(config, BEND, 'plant')
    state = np.zeros(len(linear.matrix()))
    n = len(linear.arm.mass)
    loop = ClosedLoop(config)
    rest = np.concatenate([[TURN, BEND], np.zeros(2 * n - 2)])
    # At rest until the lines are full; then a kick at the start of a sample.
    start = 20 * linear.ticks_per_sample
    for _ in range(start):
        assert loop.tick() is not None
    loop.torque = None
    moved = rest + size * kick
    loop.plant.set_state(moved[:n], moved[n:])
    state[: 2 * n] = kick
    matrix = linear.matrix()
    for _ in range(300 // linear.ticks_per_sample):
        for sub in range(linear.ticks_per_sample):
            record = loop.tick()
            assert record is not None
            if sub == 0:
                found = (np.concatenate([record.q, record.qd]) - rest) / size
                reference = np.abs(state[: 2 * n]).max()
                np.testing.assert_allclose(found, state[: 2 * n], atol=2e-4 * reference)
        state = matrix @ state
    assert np.abs(state[:n]).max() > 0.01


def test_a_law_without_a_linear_form_is_refused() -> None:
    config = RunConfig(
        controller=ControllerParameters(law='open_loop'), torques=((0.0, 0.0, 0.0),)
    )
    with pytest.raises(NoLinearFormError, match='^controller.law: open_loop'):
        SampledLoop(config, 1.0)


def test_a_law_with_a_state_of_its_own_takes_part(monkeypatch: pytest.MonkeyPatch) -> None:
    """A first-order lag in front of (20): one state a torque, checked against its cascade."""
    from flexarm_ros.core.control import PdLaw
    from flexarm_ros.stability import law as stability_law

    keep = 0.8

    class Lagging(PdLaw):
        """(20) behind a lag."""

        @classmethod
        def linear_form(cls, config: RunConfig, arm: object) -> LinearLaw:
            as_pd = replace(config, controller=replace(config.controller, law='pd'))
            d = linear_law(as_pd, arm).d  # type: ignore[arg-type]
            return LinearLaw(keep * np.eye(2), (1 - keep) * d, np.eye(2), np.zeros_like(d))

    monkeypatch.setitem(stability_law.LAWS, 'pd2', Lagging)
    config = CASES['pd at the tip']
    lagged = replace(config, controller=replace(config.controller, law='pd2'))
    loop = SampledLoop(lagged, BEND)
    plain = SampledLoop(config, BEND)
    assert len(loop.matrix()) == len(plain.matrix()) + 2
    # At zero frequency the lag is 1: det(I - M) of the cascade is (1 - keep)^2 det of the plain.
    ratio = np.linalg.det(np.eye(len(loop.matrix())) - loop.matrix()) / np.linalg.det(
        np.eye(len(plain.matrix())) - plain.matrix()
    )
    assert ratio == pytest.approx((1.0 - keep) ** 2, rel=1e-6)


def test_too_long_a_history_is_refused_at_once() -> None:
    tip = TipSensorParameters(latency=0.9)
    config = resting(PlantParameters(), tip, ControllerParameters(law='pd'), period=0.00002)
    with pytest.raises(ValueError, match='^tip_sensor.latency: 0.9 s is 45000 ticks'):
        SampledLoop(config, BEND).matrix()
