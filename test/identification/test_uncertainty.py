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

"""The uncertainty of fitted numbers, in linear cases small enough for many noise draws."""

from __future__ import annotations

from flexarm_ros.identification.estimate.scores import Recorded, score_covariance
from flexarm_ros.identification.estimate.statistics import estimate
import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

ROWS, WINDOW, STEP = 2000, 500, 0.004


def moved(numbers: np.ndarray, torque: np.ndarray) -> np.ndarray:
    """Return angle and rate, (2, n), of a joint with gain and damping, windows from rest."""
    gain, damping = numbers
    parts = torque.reshape(-1, WINDOW)
    rate = lfilter([0.0, gain * STEP], [1.0, damping * STEP - 1.0], parts)
    angle = lfilter([0.0, STEP], [1.0, -1.0], rate)
    return np.stack([angle.ravel(), rate.ravel()])


def test_noise_of_the_torque_is_in_every_channel() -> None:
    """
    The std covers the errors of numbers that follow from a noisy input, with two channels.

    The noise passes through the model into angle and rate alike: each alone gives the right std,
    but what the two say of a number is correlated.
    """
    numbers = np.array([1.0, 1.5])
    random = np.random.default_rng(3)
    clean = np.sign(np.sin(np.arange(ROWS) * STEP * 2.1)) + 0.5 * np.sin(np.arange(ROWS) * 0.02)
    true = moved(numbers, clean)
    errors, stds = [], []
    for _ in range(60):
        torque = clean + 0.2 * random.standard_normal(ROWS)
        residual = true - moved(numbers, torque)
        columns = [
            (moved(numbers + step, torque) - moved(numbers - step, torque)) / 2e-6
            for step in 1e-6 * np.eye(2)
        ]
        weights = 1.0 / residual.std(axis=1)
        jacobian = np.stack(columns, axis=2) * weights[:, None, None]
        residual = residual * weights[:, None]
        errors.append(np.linalg.lstsq(jacobian.reshape(-1, 2), residual.ravel(), rcond=None)[0])
        left = residual - jacobian @ errors[-1]
        stds.append(estimate(numbers, [(jacobian, left)], np.full(2, np.inf)).std)
    inside = np.abs(errors) < 2.0 * np.array(stds)
    assert (inside.mean(axis=0) >= 0.9).all()
    # Stds that scatter by a third must be larger in the mean, to hold as many errors.
    told = np.mean(stds, axis=0) / np.std(errors, axis=0)
    assert ((told > 0.95) & (told < 1.45)).all()


def test_a_channel_that_repeats_another_leaves_the_std() -> None:
    """Channels taken as independent would make it smaller by the root of their number."""
    rows = 1500
    random = np.random.default_rng(1)
    jacobian = np.stack([np.sin(np.arange(rows) / 40.0), np.ones(rows)], axis=1)[None]
    residual = lfilter([1.0], [1.0, -0.9], random.standard_normal(rows))[None]
    numbers, none = np.ones(2), np.full(2, np.inf)
    one = estimate(numbers, [(jacobian, residual)], none).std
    same = [np.concatenate([values] * 3) for values in (jacobian, residual)]
    three = estimate(numbers, [(same[0], same[1])], none).std
    assert three == pytest.approx(one, rel=1e-6)


def test_the_spectra_of_two_channels_give_the_covariance_of_their_scores() -> None:
    """Against the double sum over all pairs of samples, for correlated residuals."""
    rows = 60
    random = np.random.default_rng(2)
    jacobian = random.standard_normal((2, rows, 3))
    residual = lfilter([1.0], [1.0, -0.6], random.standard_normal((2, rows)))
    residual[1] += np.roll(residual[0], 1)
    part = Recorded(jacobian, residual)
    window = toeplitz(part.window[:rows])
    assert window[0, 5] > 0.2
    scores = np.einsum('cnp,cn->np', jacobian, residual)
    assert part.products == pytest.approx(scores.T @ window @ scores)
    covariance = np.zeros((2, rows, 2, rows))
    for a in (0, 1):
        for b in (0, 1):
            lagged = np.correlate(residual[b], residual[a], 'full') / rows
            place = np.subtract.outer(np.arange(rows), np.arange(rows)).T + rows - 1
            covariance[a, :, b] = lagged[place] * window
    spectral = np.einsum('anp,anbm,bmq->pq', jacobian, covariance, jacobian)
    assert part.spectral == pytest.approx(spectral)
    # What a fit leaves of residuals with this covariance: the mean of their covariances.
    flat = np.linalg.qr(jacobian.reshape(-1, 3))[0]
    whole = covariance.reshape(2 * rows, 2 * rows)
    part = Recorded(flat.reshape(jacobian.shape), residual)
    gone = np.eye(2 * rows) - flat @ flat.T
    left = (gone @ whole @ gone).reshape(covariance.shape)
    found = part.expected(part.away(flat.T @ whole @ flat))
    for lag in (0, 1, 7):
        mean = sum(left[:, n, :, n + lag] for n in range(rows - lag)) / rows
        assert found[..., lag] == pytest.approx(mean)


@pytest.mark.parametrize(
    ('pole', 'least', 'most', 'inside'),
    [(0.0, 0.97, 1.05, 0.94), (0.9, 0.9, 1.1, 0.9), (0.98, 0.95, 1.3, 0.84)],
)
def test_residuals_that_are_correlated_for_long(
    pole: float, least: float, most: float, inside: float
) -> None:
    """
    Stds against those that follow from the known covariance of an autoregressive residual.

    The last one is correlated by more than 0.2 over 80 of 1000 samples, and the fit takes out much
    of its slow parts: without a correction of this bias stds are 0.6 to 0.8 of those known.
    """
    rows, draws = 1000, 120
    time = np.arange(rows) / rows
    jacobian = np.stack([np.sin(9.0 * time), np.sign(np.sin(14.0 * time)), time], axis=1)
    inverse = np.linalg.pinv(jacobian)
    covariance = toeplitz(pole ** np.arange(rows)) / (1.0 - pole**2)
    known = np.sqrt(np.diag(inverse @ covariance @ inverse.T))
    random = np.random.default_rng(1)
    errors, stds = [], []
    for _ in range(draws):
        noise = random.standard_normal(rows + 500)
        residual = lfilter([1.0], [1.0, -pole], noise)[500:]
        errors.append(inverse @ residual)
        block = jacobian[None], (residual - jacobian @ errors[-1])[None]
        stds.append(estimate(np.ones(3), [block], np.full(3, np.inf)).std)
    told = np.mean(stds, axis=0) / known
    assert ((told > least) & (told < most)).all(), told
    assert np.mean(np.abs(errors) < 2.0 * np.array(stds)) > inside


def test_recordings_count_as_independent() -> None:
    """Twice the same recording: the std is smaller by the root of two."""
    random = np.random.default_rng(5)
    jacobian = np.stack([np.sin(np.arange(800) / 30.0), np.ones(800)], axis=1)[None]
    residual = lfilter([1.0], [1.0, -0.8], random.standard_normal((1, 800)))
    once = score_covariance([(jacobian, residual)])
    twice = score_covariance([(jacobian, residual)] * 2)
    assert np.diag(twice) == pytest.approx(2.0 * np.diag(once), rel=0.1)
