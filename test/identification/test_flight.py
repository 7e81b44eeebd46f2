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

"""Predictions from torques and currents and in closed loop, against the plant and its laws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from armtools import ARM, PERIOD
from flexarm_ros.core.control import make_law, Sample
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.identification.prediction import whole_arm as flying
from flexarm_ros.identification.prediction.predict import predict
from flexarm_ros.identification.recording import Recording
from flexarm_ros.identification.setting import load_setting
from flexarm_ros.scenario import ScenarioError
import numpy as np
import pytest

LAW = f"""law: {flying.STATE_FEEDBACK}
    feedback: encoder
    StateFeedback:
      angle: [15.81, 15.81]
      rate: [2.183, 0.424]
      limit: [0.94, 1.2]
      torque_constant: [7.8, 1.19]
"""
JOINTS = """
actuator:
  ros__parameters: {torque_constant: [0.078, 0.0238], gear_ratio: [100.0, 50.0]}
"""
FRICTION = {
    'plant.viscous_friction': '[1.6, 0.3]',
    'plant.coulomb_friction': '[0.7, 0.4]',
    'plant.coulomb_friction_negative': '[0.9, 0.45]',
}


@pytest.fixture(scope='module')
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return an arm with friction, true gauges, and the law of a rig."""
    text = ARM[: ARM.index('strain_gauge:')]
    text = text.replace('ros__parameters: {law: pd, feedback: encoder}', 'ros__parameters:\n    ')
    text = text.replace('ros__parameters:\n    \n', f'ros__parameters:\n    {LAW}')
    path = tmp_path_factory.mktemp('arm') / 'arm.yaml'
    path.write_text(text + JOINTS)
    return path


def overrides() -> list[str]:
    return [f'{key}={value}' for key, value in FRICTION.items()]


def reference(t: float) -> tuple[float, float]:
    return (0.4 if t % 4.0 < 2.0 else -0.4), (0.2 if (t + 1.0) % 3.0 < 1.5 else -0.1)


@pytest.fixture(scope='module')
def flight(arm: Path) -> dict[str, np.ndarray]:
    """Fly the scenario's own plant with joint state feedback of unfiltered rates."""
    plant = make_plant(load_setting(arm, overrides()).config)
    rows: list[list[float]] = []
    for k in range(round(6.0 / PERIOD)):
        goal, ends = reference(k * PERIOD), plant.deflections()
        currents = [
            float(np.clip(15.81 * (goal[j] - plant.q[j]) - rate * plant.qd[j], -limit, limit))
            for j, rate, limit in ((0, 2.183, 0.94), (1, 0.424, 1.2))
        ]
        rows.append([*plant.q[:2], ends[0] / 0.202, ends[1] / 0.20185, *currents, *goal])
        plant.step(7.8 * currents[0], 1.19 * currents[1])
    names = [f'{form}{j}' for form in ('theta', 'strain', 'i') for j in (1, 2)]
    names += ['theta1_reference', 'theta2_reference']
    return dict(zip(names, np.array(rows).T, strict=True))


def recording(flight: dict[str, np.ndarray], **changes: np.ndarray) -> Recording:
    return Recording(
        'x', PERIOD, {**flight, **changes}, dict.fromkeys(('strain1', 'strain2'), 'angle')
    )


def fits(found: Any) -> dict[str, float]:
    return {name: row['fit'] for name, row in found.numbers.items()}


def test_from_currents_the_arm_is_the_plant(arm: Path, flight: dict[str, np.ndarray]) -> None:
    """Torque constant, gear and friction with stick: the whole flight from rest."""
    found = fits(predict(recording(flight), load_setting(arm, overrides()), 'torque'))
    assert all(value > 99.9 for value in found.values())
    torques = {'tau1': 7.8 * flight['i1'], 'tau2': 1.19 * flight['i2']}
    plain = {key: flight[key] for key in flight if key not in ('i1', 'i2')}
    assert fits(
        predict(recording(plain, **torques), load_setting(arm, overrides()), 'torque')
    ) == (pytest.approx(found, abs=0.01))
    smooth = fits(predict(recording(flight), load_setting(arm), 'torque'))
    assert smooth['theta1'] < 80.0


@pytest.mark.parametrize('window', [None, 0.5])
def test_derived_rates_are_compared_with_rates_derived_alike(
    arm: Path, flight: dict[str, np.ndarray], window: float | None
) -> None:
    """Also where a recording or a window ends in motion: no difference reaches beyond it."""
    cut = {name: values[:1030] for name, values in flight.items()}
    found = predict(recording(cut), load_setting(arm, overrides()), 'torque', window)
    for name in ('theta1_rate', 'theta2_rate'):
        residual = found.channels[name].residual
        assert len(residual) == 1030 - 8 * (1 if window is None else 5)
        assert np.abs(residual).max() < 0.01 * np.abs(found.channels[name].measured).max()


def test_windows_start_from_the_measured_state(arm: Path, flight: dict[str, np.ndarray]) -> None:
    """Too little torque: each window starts anew, so that short ones stay near."""
    less = {'i1': 0.9 * flight['i1'], 'i2': 0.9 * flight['i2']}
    setting = load_setting(arm, overrides())
    short = fits(predict(recording(flight, **less), setting, 'torque', 0.5))
    long = fits(predict(recording(flight, **less), setting, 'torque'))
    assert short['theta1'] > long['theta1'] + 4.0


def test_the_rigs_law_closes_the_loop(arm: Path, flight: dict[str, np.ndarray]) -> None:
    """The law's rates are filtered at 40 Hz, those of the flight are not: some points of fit."""
    setting = load_setting(arm, [*overrides(), 'controller.StateFeedback.rate_cutoff=200.0'])
    found = predict(recording(flight), setting, 'closed_loop')
    assert fits(found)['theta1'] > 98.0
    assert fits(found)['theta2'] > 95.0
    assert fits(found)['strain1'] > 85.0


def test_closed_loop_needs_law_and_reference(arm: Path, flight: dict[str, np.ndarray]) -> None:
    setting = load_setting(arm, ['controller.law=pd'])
    with pytest.raises(ScenarioError, match='controller.law: pd is not allowed'):
        predict(recording(flight), setting, 'closed_loop')
    plain = {key: values for key, values in flight.items() if 'reference' not in key}
    with pytest.raises(ScenarioError, match='theta1_reference'):
        predict(recording(plain), load_setting(arm), 'closed_loop')
    plain = {key: values for key, values in flight.items() if not key.startswith('i')}
    with pytest.raises(ScenarioError, match='neither torques'):
        predict(recording(plain), load_setting(arm), 'torque')


def test_the_law_flies_in_a_simulation(arm: Path) -> None:
    """By its module's name in a scenario: it holds the arm, within its friction."""
    config = load_setting(arm, overrides()).config
    law, plant = make_law(config), make_plant(config)
    x, y = 0.28 * np.cos(0.2) + 0.28 * np.cos(0.5), 0.28 * np.sin(0.2) + 0.28 * np.sin(0.5)
    for k in range(2000):
        encoder = (float(plant.q[0]), float(plant.q[1]), 0.0, 0.0)
        point = (float(x), float(y), 0.0, 0.0)
        sample = Sample(plant.q, plant.qd, plant.deflections()[:2], encoder, point, point)
        plant.step(*law.torque(k, sample))
    assert plant.q[0] == pytest.approx(0.2, abs=0.02)
    assert plant.q[1] == pytest.approx(0.3, abs=0.06)
    assert max(abs(law.torque(2000, sample)[j]) for j in (0, 1)) < 1.0
