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

"""Joint state feedback over strain gauges: the linear loop against flights of small amplitude."""

from __future__ import annotations

import math

from flexarm_ros import scenario
from flexarm_ros.cli import main
from flexarm_ros.core.control.state_feedback import highest_cutoff, LowPass
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.stability.sampled_loop import left_out, SampledLoop
from flexarm_ros.stability.state_feedback import lowpass_form
import numpy as np
import pytest

BEND = 0.6
SMOOTH = (
    'encoder.resolution=0.0', 'plant.coulomb_friction=[0.0, 0.0]',
    'plant.coulomb_friction_negative=[0.0, 0.0]', 'controller.StateFeedback.limit=[0.0, 0.0]',
    f'plant.initial_position=[0.3, {BEND}]',
    # The offsets at the angles of the pose are subtracted, so that it is at rest.
    'strain_gauge.offset=[0.001176, -0.00165]',
)  # fmt: skip
"""Nothing that is not linear at rest."""

GAUGES = ('controller.deflection_source=strain_gauge',)
CASES = {
    'exact deflections': ('controller.deflection_source=plant',),
    'gauges with their low-pass': GAUGES,
    'gauges without, late': (
        *GAUGES, 'strain_gauge.filter_cutoff=[0.0, 0.0]', 'strain_gauge.latency=0.0073',
        'controller.StateFeedback.deflection_cutoff=2.0',
    ),
    'one gauge filtered, rates, drives': (
        *GAUGES, 'strain_gauge.filter_cutoff=[0.0, 3.0]', 'strain_gauge.rate=250.0',
        'controller.rate=250.0', 'controller.compute_delay=0.002',
        'actuator.bandwidth=[60.0, 90.0]', 'strain_gauge.output=deflection',
        'controller.StateFeedback.deflection_cutoff=9.0', 'encoder.latency=0.002',
        'controller.StateFeedback.angle=[4.0, 4.0]', 'controller.StateFeedback.rate=[0.5, 0.1]',
        'controller.StateFeedback.deflection=[-20.0, -20.0]',
    ),
}  # fmt: skip


def loaded(*settings: str) -> RunConfig:
    return scenario.load('quanser_2dsfl', [*SMOOTH, *settings])


def flown(config: RunConfig, kick: np.ndarray, start: int, ticks: int) -> np.ndarray:
    """Return states ``(ticks, 2 n)`` of a flight, from a kick at tick ``start`` on."""
    loop, rows = ClosedLoop(config), []
    for _ in range(start):
        assert loop.tick() is not None
    n = len(loop.plant.q)
    for k in range(ticks):
        if k == 0:
            # The step to the kicked state, and none before the tick that measures it.
            loop.plant.step(*loop.answers.messages[loop.answers.places['actuator/torque']])
            loop.torque = None
            moved = np.concatenate([loop.plant.q, loop.plant.qd]) + kick
            loop.plant.set_state(moved[:n], moved[n:])
        record = loop.tick()
        assert record is not None
        rows.append(np.concatenate([record.q, record.qd]))
    return np.array(rows)


def response(config: RunConfig, ticks: int, size: float = 1e-6) -> tuple[np.ndarray, np.ndarray]:
    """Return what a kick of ``size`` adds to a flight, and the same of the linear loop."""
    linear = SampledLoop(config, BEND)
    every = linear.ticks_per_sample
    kick = np.array([0.3, -0.2, 0.005, 0.004, 1.0, 2.0, -0.03, 0.05])
    still, kicked = (flown(config, factor * kick, 40, ticks) for factor in (0.0, size))
    matrix, state, rows = linear.matrix(), np.zeros(len(linear.matrix())), []
    state[: len(kick)] = kick
    for _ in range(0, ticks, every):
        rows.append(state[: len(kick)])
        state = matrix @ state
    return (kicked - still)[::every] / size, np.array(rows)


@pytest.mark.parametrize('case', CASES)
def test_the_loop_follows_the_flight_tick_by_tick(case: str) -> None:
    """
    A second of the loop, ten of its low-passes' time constants.

    The plant's steps, which the exact hold of the analysis leaves out, are the difference.
    """
    found, expected = response(loaded(*CASES[case]), 500)
    scale = np.abs(expected).max(axis=0)
    np.testing.assert_allclose(found / scale, expected / scale, atol=1e-4)
    # The case can tell: what the gauges do is large.
    other = response(loaded(*CASES['exact deflections']), 500)[1][: len(expected)]
    if case != 'exact deflections':
        assert np.abs((other[: len(expected)] - expected) / scale).max() > 1e-2


def test_an_unstable_flight_grows_as_the_eigenvalue_says() -> None:
    config = loaded(*GAUGES, 'strain_gauge.latency=0.05')
    linear = SampledLoop(config, BEND)
    value = linear.eigenvalues()[0]
    assert abs(value) > 1.0005
    found, _ = response(config, 6000, 1e-8)
    late = found[4500:, 1]
    # Two samples a tick apart obey the pair's own recursion once the others have decayed.
    rows = np.column_stack([late[1:-1], late[:-2]])
    (trace, minus), *_ = np.linalg.lstsq(rows, late[2:], rcond=None)
    roots = np.roots([1.0, -trace, -minus])
    assert abs(roots[0]) == pytest.approx(abs(value), abs=2e-6)
    assert abs(np.angle(roots[0])) == pytest.approx(abs(np.angle(value)), rel=1e-3)


def test_the_shipped_arm_is_analysed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['stability', 'quanser_2dsfl', '--elbow', '0']) == 0
    told = capsys.readouterr().out
    assert 'gain 1: stable' in told
    assert told.splitlines()[-1] == (
        'not in the analysis: controller.StateFeedback.limit, encoder.resolution, '
        'plant.coulomb_friction, plant.coulomb_friction_negative'
    )
    noisy = loaded(*GAUGES, 'strain_gauge.noise_std=1e-3', 'strain_gauge.dropout=0.1')
    assert left_out(noisy) == ['strain_gauge.dropout', 'strain_gauge.noise_std']


@pytest.mark.parametrize(('cutoff', 'damping'), [(2.0, 0.9), (40.0, 0.9), (300.0, 0.2)])
def test_the_low_pass_s_form_is_its_step(cutoff: float, damping: float) -> None:
    a, b = lowpass_form(cutoff, damping, 0.001)
    for value, rate, signal in np.eye(3):
        lowpass = LowPass(cutoff, damping, 0.001)
        lowpass.value, lowpass.rate = value, rate
        lowpass.step(signal)
        expected = a @ (value, rate) + signal * b
        assert (lowpass.value, lowpass.rate) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize('damping', [0.1, 0.9, 5.0])
def test_the_low_pass_is_stable_up_to_its_highest_cutoff(damping: float) -> None:
    highest = highest_cutoff(damping, 0.002)
    for factor, stable in ((0.999, True), (1.001, False)):
        a, _ = lowpass_form(factor * highest, damping, 0.002)
        assert (np.abs(np.linalg.eigvals(a)).max() < 1.0) == stable


@pytest.mark.parametrize(
    ('setting', 'text'),
    [
        (
            'controller.StateFeedback.rate_cutoff=358.0',
            r'controller\.StateFeedback\.rate_cutoff: 358\.0 Hz, allowed with a torque every '
            r'0\.002 s and filter_damping 0\.9: below 357\.',
        ),
        (
            'controller.StateFeedback.deflection_cutoff=1e5',
            r'controller\.StateFeedback\.deflection_cutoff: 100000\.0 Hz',
        ),
    ],
)
def test_a_low_pass_that_would_be_unstable_is_refused(setting: str, text: str) -> None:
    scenario.load('quanser_2dsfl', ['controller.StateFeedback.rate_cutoff=357.0'])
    with pytest.raises(ScenarioError, match=text):
        scenario.load('quanser_2dsfl', [setting])
    # At half the period it is stable up to twice the frequency.
    scenario.load(
        'quanser_2dsfl', ['control_period=0.001', 'controller.StateFeedback.rate_cutoff=358.0']
    )


def test_the_tip_correction_s_low_pass_is_checked_too() -> None:
    fast = ['controller.passive.bandwidth=100.0', 'control_period=0.02']
    text = (
        r'controller\.passive\.bandwidth: 100\.0 1/s, allowed with a tick of 0\.02 s: below 100$'
    )
    with pytest.raises(ScenarioError, match=text):
        scenario.load('passive_smooth', fast)


@pytest.mark.parametrize(
    'settings',
    [
        ['strain_gauge.filter_cutoff=[1e6, 1e3]', 'strain_gauge.filter_damping=[0.01, 50.0]'],
        ['actuator.bandwidth=[1e6, 1e4]'],
    ],
)
def test_other_low_passes_are_stable_at_any_cutoff(settings: list[str]) -> None:
    """Exact for their input: they only become immediate."""
    loop = ClosedLoop(scenario.load('lab_arm', [*settings, 'duration=0.05']))
    while (record := loop.tick()) is not None:
        assert all(map(math.isfinite, record.torque)) and max(map(abs, record.torque)) < 100.0
    assert loop.k == 50
