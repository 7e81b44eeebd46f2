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

"""The shipped numbers of a real arm against a recording that they were not fitted on."""

from __future__ import annotations

import math
from pathlib import Path

from flexarm_ros.identification.prediction.predict import predict, ringing_of
from flexarm_ros.identification.recording import read, Recording
from flexarm_ros.identification.setting import load_setting
import numpy as np
import pytest

PARTIAL = [
    f'controller.StateFeedback.{key}=[0.0, 0.0]' for key in ('deflection', 'deflection_rate')
]
"""Overrides: the second recording was made without feedback of the strains."""


def test_the_shipped_rig_can_be_read() -> None:
    setting = load_setting('quanser_2dsfl', PARTIAL)
    assert setting.actuator.torque_per_ampere == pytest.approx((8.2, 1.26))
    assert setting.gauge.filter_cutoff == (2.0, 2.0)
    assert setting.config.controller.own().deflection == (0.0, 0.0)


@pytest.mark.parametrize(('window', 'least'), [(1.0, 93.0), (2.0, 91.0), (5.0, 86.0)])
def test_driven(real: Path, window: float, least: float) -> None:
    numbers = predict(
        read(real / 'psf.csv'), load_setting('quanser_2dsfl'), 'driven', window, 1.0
    ).numbers
    assert numbers['strain1']['fit'] > least
    assert numbers['strain2']['fit'] > least


def test_from_currents(real: Path) -> None:
    numbers = predict(
        read(real / 'psf.csv'), load_setting('quanser_2dsfl'), 'torque', 2.0, 1.0
    ).numbers
    assert numbers['strain1']['fit'] > 85.0
    assert numbers['strain2']['fit'] > 85.0
    assert numbers['theta1_rate']['fit'] > 91.0


def test_in_closed_loop(real: Path) -> None:
    setting = load_setting('quanser_2dsfl', PARTIAL)
    numbers = predict(read(real / 'psf.csv'), setting, 'closed_loop', None, 1.0).numbers
    assert numbers['strain1']['fit'] > 75.0
    assert numbers['strain2']['fit'] > 75.0
    assert numbers['theta1']['rms'] < math.radians(0.15)
    assert numbers['theta2']['rms'] < math.radians(0.4)


@pytest.mark.parametrize('name', ['fsf.csv', 'psf.csv'])
def test_ringing(real: Path, name: str) -> None:
    measured, predicted = ringing_of(read(real / name), load_setting('quanser_2dsfl'), 1.0)
    assert len(measured) == len(predicted) == 2
    for one, other in zip(measured, predicted, strict=True):
        assert other.frequency == pytest.approx(one.frequency, rel=0.03)


@pytest.mark.parametrize('rate', [100.0, 1000.0])
@pytest.mark.parametrize(
    ('mode', 'window'), [('driven', 2.0), ('torque', 2.0), ('closed_loop', None)]
)
def test_another_sampling_rate(real: Path, rate: float, mode: str, window: float | None) -> None:
    """The numbers are those of the arm, not of its 500 Hz."""
    known, setting = read(real / 'psf.csv'), load_setting('quanser_2dsfl', PARTIAL)
    times = np.arange(0.0, known.times[-1], 1.0 / rate)
    channels = {
        name: np.interp(times, known.times, values) for name, values in known.channels.items()
    }
    other = Recording('x', 1.0 / rate, channels, known.strain_units)
    plain = predict(known, setting, mode, window, 1.0).numbers
    for name, row in predict(other, setting, mode, window, 1.0).numbers.items():
        if not name.endswith('_rate'):  # derived over another time
            assert row['fit'] == pytest.approx(plain[name]['fit'], abs=1.0)
