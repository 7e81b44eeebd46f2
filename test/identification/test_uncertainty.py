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

from flexarm_ros.identification.estimate.statistics import (
    estimate,
    independent_samples,
    score_covariance,
)
import numpy as np
import pytest
from scipy.linalg import eigh
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
    assert (inside.mean(axis=0) > 0.85).all()
    told = np.mean(stds, axis=0) / np.std(errors, axis=0)
    assert ((told > 0.85) & (told < 1.3)).all()


def test_a_channel_that_repeats_another_adds_no_samples() -> None:
    random = np.random.default_rng(0)
    first, second = random.standard_normal((2, 2000))
    one = independent_samples(first[None])
    assert independent_samples(np.stack([first, 3.0 * first])) < 1.01 * one
    assert independent_samples(np.stack([first, second])) > 1.8 * one


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
    """Against the double sum over all pairs of samples, for residuals that are all but white."""
    rows, lags = 60, 3
    random = np.random.default_rng(2)
    jacobian = random.standard_normal((2, rows, 3))
    residual = random.standard_normal((2, rows))
    residual[1] += np.roll(residual[0], 1)
    distance = np.abs(np.subtract.outer(np.arange(rows), np.arange(rows)))
    window = np.maximum(1.0 - distance / (4 * lags + 1.0), 0.0)
    scores = np.einsum('cnp,cn->np', jacobian, residual)
    products = scores.T @ window @ scores
    spectral = np.zeros((3, 3))
    for a in (0, 1):
        for b in (0, 1):
            lagged = [
                np.sum(
                    residual[a, max(0, -k) : rows - max(0, k)]
                    * residual[b, max(0, k) : rows - max(0, -k)]
                )
                / rows
                for k in range(-rows + 1, rows)
            ]
            place = np.subtract.outer(np.arange(rows), np.arange(rows)).T + rows - 1
            spectral += jacobian[a].T @ (np.array(lagged)[place] * window) @ jacobian[b]
    found = score_covariance(jacobian, residual, lags)
    for direction in random.standard_normal((20, 3)):
        least = max(direction @ products @ direction, direction @ spectral @ direction)
        assert direction @ found @ direction >= least * (1.0 - 1e-9)
    values = eigh(spectral, products, eigvals_only=True)
    assert eigh(found, products, eigvals_only=True) == pytest.approx(np.maximum(values, 1.0))
