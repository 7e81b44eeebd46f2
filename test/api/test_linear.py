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

"""The loop's two halves as StateSpace, held against the stability analysis and against flight."""

from __future__ import annotations

from collections.abc import Callable
import importlib.util
from types import ModuleType

import flexarm_ros as fa
from flexarm_ros.stability.form import NoLinearFormError
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np
import pytest

POSE = 1.1
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec('control') is None, reason="pip install 'flexarm_ros[control]'"
)


@pytest.fixture(scope='module')
def control() -> ModuleType:
    """Import the library, which takes a second, where it is needed."""
    return importlib.import_module('control')


@pytest.mark.parametrize('theta1', [0.0, -2.0])
@pytest.mark.parametrize(
    'scenario',
    ['pd_collocated', 'fls_tip', 'pd_mid', 'fls_tip_elastic', 'pd_tip_physical_encoder_rates'],
)
def test_arm_and_law_close_to_the_loop_of_the_stability_analysis(
    scenario: str, theta1: float, control: ModuleType
) -> None:
    arm = fa.linearize(scenario, POSE, theta1, outputs='law')
    law = fa.linear_law(scenario, POSE, theta1)
    assert arm.output_labels == law.input_labels and arm.dt == law.dt == 0.001
    poles = control.poles(control.feedback(arm, law, sign=1))
    expected = SampledLoop(fa.configure(scenario), POSE).eigenvalues()
    inside = expected[np.abs(expected) > 0.5]
    found = poles[np.abs(poles) > 0.5]
    assert len(found) == len(inside)
    for value in inside:
        assert np.min(np.abs(found - value)) < 1e-6


@pytest.mark.parametrize('function', [fa.linearize, fa.linear_law])
@pytest.mark.parametrize('angle', ['theta1', 'theta2'])
@pytest.mark.parametrize('value', [float('nan'), float('inf'), -1e5, 'a', True])
def test_a_pose_is_in_range(function: Callable[..., object], angle: str, value: object) -> None:
    allowed = 'allowed: a number, at least -10000 and at most 10000 rad'
    with pytest.raises(ValueError, match=f'^{angle}: {value!r}, {allowed}$'):
        function('fls_tip', **{angle: value})


@pytest.mark.parametrize('model', ['buffer', 'pade2'])
def test_small_motions_are_those_of_the_flown_arm(model: str, control: ModuleType) -> None:
    """A small torque, flown open loop from rest, against the linear system's answer."""
    changes = {
        'plant': {'initial_position': [0.3, POSE], 'model': 'full', 'modes': 2},
        'tip_sensor': {'latency': 0.0123, 'latency_model': model, 'measurand': 'elastic'},
    }
    torque, ticks = 1e-3, 400
    run = fa.simulate(
        'fls_tip', torques=[(0.0, torque, -torque)], duration=ticks / 1000.0, **changes
    )
    arm = fa.linearize('fls_tip', outputs='all', **changes)
    held = np.tile([[torque], [-torque]], ticks)
    answer = control.forced_response(arm, U=held).outputs
    for output, column in (
        ('sensor_x', 'meas_x'), ('sensor_y', 'meas_y'), ('shoulder', 'theta1'),
        ('elbow_rate', 'dtheta2'), ('delta1', 'delta1'), ('delta2', 'delta2'),
    ):  # fmt: skip
        flown = run.trajectory[column] - run.trajectory[column][0]
        linear = answer[arm.output_labels.index(output)]
        assert np.max(np.abs(flown - linear)) < 2e-4 * np.max(np.abs(flown)), output


def test_continuous_time_is_the_same_arm_with_the_paper_s_delay(control: ModuleType) -> None:
    latency = 0.0312
    sensor = {'latency': latency}
    whole = fa.linearize('fls_tip', POSE, continuous=True, tip_sensor=sensor)
    direct = fa.linearize('fls_tip', POSE, continuous=True, tip_sensor={'latency': 0.0})
    assert whole.dt == 0 and whole.nstates == direct.nstates + 8
    for omega in (0.5, 7.0, 40.0):
        s = 1j * omega * latency
        pade = (1 - s / 2 + s**2 / 12) / (1 + s / 2 + s**2 / 12)
        assert whole(1j * omega) == pytest.approx(pade * direct(1j * omega), rel=1e-9)
    held = fa.linearize('fls_tip', POSE, outputs='state', tip_sensor={'latency': 0.0})
    exact = np.exp(control.poles(direct) * 0.001)
    assert np.sort(np.abs(control.poles(held))) == pytest.approx(np.sort(np.abs(exact)), abs=1e-6)


def test_names_and_choices_of_outputs() -> None:
    assert fa.linearize('pd_collocated').output_labels[0] == 'encoder_theta1'
    assert fa.linearize('pd_tip').output_labels == [
        'sensor_x', 'sensor_y', 'sensor_vx', 'sensor_vy'
    ]  # fmt: skip
    assert fa.linearize('pd_tip', outputs='deflection').output_labels == ['delta1', 'delta2']
    arm = fa.linearize('pd_tip', outputs='state', plant={'modes': 2, 'model': 'full'})
    assert arm.input_labels == ['tau1', 'tau2'] and arm.noutputs == 12
    with pytest.raises(ValueError, match="outputs: 'tip', allowed: feedback, encoder"):
        fa.linearize('pd_tip', outputs='tip')


def test_what_has_no_linear_form_is_refused() -> None:
    with pytest.raises(NoLinearFormError):
        fa.linear_law('fls_tip', torques=[(0.0, 1.0, 1.0)])
    with pytest.raises(ValueError, match='tip_sensor.rate: a sample lasts 10 ticks'):
        fa.linearize('fls_tip', tip_sensor={'rate': 100.0})
    with pytest.raises(ValueError, match=r'encoder.latency: 0.9 s is 900 ticks, too many'):
        fa.linearize('fls_tip', encoder={'latency': 0.9})
    with pytest.raises(fa.ScenarioError, match='plant.modes'):
        fa.linearize('fls_tip', plant={'modes': 9})
