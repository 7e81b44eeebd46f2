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

"""Uncertainty of estimated parameters: covariance, identifiability, undetermined scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
Block = tuple[FloatArray, FloatArray]
"""Jacobian (c, n, p) and residual (c, n) of the c channels of a recording."""

NO_INFORMATION = 1e-8
"""Smallest eigenvalue of the scaled information, per largest, that counts as information."""

TAKES_PART = 1e-2
"""Share of a parameter in a direction without information from which it is undetermined."""

_ROUNDING = 1e-12

TELLS = 0.5
"""Largest std, per value or per prior std, of a parameter that the data identify."""

FREE_SCALE = 1e-5
"""Least information about a common scale, per that about each parameter, that counts."""


def correlation_length(residual: FloatArray) -> int:
    """
    Return the largest lag at which a residual is correlated by more than 0.2, at least 1.

    The last one, not the first zero: what a wrong start state leaves oscillates.
    """
    values = residual - residual.mean()
    power = float(values @ values)
    if power == 0.0 or len(values) < 8:
        return 1
    size = 1 << (2 * len(values) - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(values, size)) ** 2
    correlation = np.fft.irfft(spectrum, size)[: len(values) // 8] / power
    above = np.flatnonzero(np.abs(correlation) > 0.2)
    return max(1, int(above[-1])) if len(above) else 1


def _taper(count: int, lags: int) -> FloatArray:
    """Return Bartlett's window over four times ``lags`` for lags 0 to ``count`` - 1, (count,)."""
    width = 4 * lags if lags > 1 else 0
    return np.asarray(np.maximum(1.0 - np.arange(count) / (width + 1.0), 0.0))


def _spectra(residual: FloatArray, lags: int) -> NDArray[np.complex128]:
    """
    Return the cross spectra of residuals, (c, n), at the frequencies of an FFT of twice n.

    Shape (c, c, n + 1): positive semidefinite at each frequency.
    """
    count = residual.shape[1]
    waves = np.fft.rfft(residual, 2 * count, axis=1)
    products = np.fft.irfft(waves.conj()[:, None] * waves[None], 2 * count) / count
    return np.asarray(np.fft.rfft(products * _both_ways(_taper(count, lags))))


def _both_ways(half: FloatArray) -> FloatArray:
    """Return the values at lags 0 to n - 1 with those at negative lags behind, (2n,)."""
    return np.concatenate([half, [0.0], half[:0:-1]])


def score_covariance(jacobian: FloatArray, residual: FloatArray, lags: int) -> FloatArray:
    """
    Return the covariance of J^T r, (p, p), of one recording.

    ``jacobian`` (c, n, p) and ``residual`` (c, n) of its channels over the same n samples, which
    are correlated over ``lags`` samples.  Channels are correlated with each other: noise of the
    measured torque passes through the model into every angle, rate and strain, so that the sum
    of the covariances of the channels is too small (by half, in the linear case of the tests).

    The larger, in every direction, of two estimates with Bartlett's window: from the products
    J_t^T r_t (Newey and West 1987), which reflect that residuals are larger where the arm moves,
    and from the cross spectra of the residuals, which allow for what the fit removed from them at
    the frequencies of the parameters.  The first alone is too small by a fifth for 6 s of filtered
    noise.
    """
    channels, count, _ = jacobian.shape
    share = np.full(count + 1, 1.0 / count)
    share[[0, -1]] *= 0.5
    scores = np.fft.rfft(np.einsum('cnp,cn->np', jacobian, residual), 2 * count, axis=0)
    window = np.fft.rfft(_both_ways(_taper(count, lags))).real
    products = ((scores.conj() * (window * share)[:, None]).T @ scores).real
    waves = np.fft.rfft(jacobian, 2 * count, axis=1)
    power = _spectra(residual, lags).conj() * share
    spectral = np.zeros_like(products)
    for one in range(channels):
        for other in range(channels):
            seen = waves[one].conj() * power[one, other][:, None]
            spectral += (seen.T @ waves[other]).real
    return _larger(spectral, products)


def _larger(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the smallest matrix above two positive semidefinite ones in their common axes."""
    scale = np.sqrt(np.maximum(np.diag(first), np.diag(second)))
    scale = np.where(scale > 0.0, scale, 1.0)
    one, other = first / np.outer(scale, scale), second / np.outer(scale, scale)
    root = np.linalg.cholesky(one + 1e-12 * np.eye(len(one)))
    inverse = np.linalg.inv(root)
    values, vectors = np.linalg.eigh(inverse @ other @ inverse.T)
    axes = root @ vectors
    return np.asarray((axes * np.maximum(values, 1.0)) @ axes.T * np.outer(scale, scale))


def _lags(residual: FloatArray) -> int:
    """Return the largest correlation length of the channels of a recording, (c, n)."""
    return max(correlation_length(channel) for channel in residual)


def independent_samples(residual: FloatArray) -> float:
    """
    Return the equivalent number of independent samples of residuals, (c, n), at least 1.

    Each channel counts alike; channels that repeat one another count once.
    """
    centred = residual - residual.mean(axis=1, keepdims=True)
    level = centred.std(axis=1, keepdims=True)
    power = _spectra(centred / np.where(level > 0.0, level, 1.0), _lags(residual))
    squares = float(np.sum(np.abs(power) ** 2))
    total = float(np.einsum('ccf->', power).real)
    return max(1.0, total**2 / squares) if squares > 0.0 else 1.0


def _freedom(blocks: Sequence[Block], count: int) -> float:
    """Return the factor on a variance that allows for the fit of ``count`` parameters."""
    samples = sum(independent_samples(residual) for _, residual in blocks)
    return samples / max(samples - count, 0.25 * samples)


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    Uncertainty of p parameters.

    ``std`` (p,): inf where nothing is known; ``status``: ``identified``, ``prior`` or ``not
    identifiable``; ``correlation`` (p, p).
    """

    std: FloatArray
    status: tuple[str, ...]
    correlation: FloatArray


def estimate(
    values: FloatArray,
    blocks: Sequence[Block],
    prior_std: FloatArray,
) -> Estimate:
    """
    Return the uncertainty from each recording's Jacobian (c, n, p) and residual (c, n).

    Both are weighted alike, and 0 where a channel was not measured.  Residuals of different
    recordings count as independent.  ``prior_std`` (p,): inf without a prior.  A parameter
    is identified if the data alone, with all other parameters free within their priors, determine
    it to half of its value; otherwise its status is ``prior`` if its prior bounds it, else
    ``not identifiable``.
    """
    count = len(values)
    information = np.zeros((count, count))
    scores = np.zeros((count, count))
    for jacobian, residual in blocks:
        information += np.einsum('cnp,cnq->pq', jacobian, jacobian)
        scores += score_covariance(jacobian, residual, _lags(residual))
    precision = np.where(np.isfinite(prior_std), 1.0 / prior_std**2, 0.0)
    # The information in the correlated residuals, J^T J S^-1 J^T J, is compared
    # with that of the priors; computed in units in which each parameter has information 1.
    scale = np.sqrt(np.diag(information))
    seen = scale > 0.0
    std = np.full(count, np.inf)
    alone = np.full(count, np.inf)
    covariance = np.full((count, count), np.nan)
    if seen.any():
        part = np.ix_(seen, seen)
        unit = scale[seen]
        shaped = information[part] / np.outer(unit, unit)
        noise = _freedom(blocks, int(seen.sum())) * scores[part] / np.outer(unit, unit)
        told = _information(shaped, noise)
        own = told + np.diag(precision[seen] / unit**2)
        inverse, open_ = _inverse(own)
        covariance[part] = inverse / np.outer(unit, unit)
        std[seen] = np.where(open_, np.inf, np.sqrt(np.diag(inverse)) / unit)
        for place, index in enumerate(np.flatnonzero(seen)):
            without = own.copy()
            without[place, place] -= precision[index] / unit[place] ** 2
            inverse, open_ = _inverse(without)
            told_by_data = np.sqrt(inverse[place, place]) / unit[place]
            alone[index] = np.inf if open_[place] else told_by_data
    std = np.minimum(std, prior_std)
    status = tuple(_status(values[i], alone[i], prior_std[i]) for i in range(count))
    std = np.where([text == 'not identifiable' for text in status], np.maximum(std, alone), std)
    return Estimate(std, status, _correlation(covariance))


def _status(value: float, alone: float, prior: float) -> str:
    if np.isfinite(prior):
        return 'identified' if alone < TELLS * prior else 'prior'
    reference = abs(value)
    return 'identified' if alone <= TELLS * reference else 'not identifiable'


def _information(shaped: FloatArray, noise: FloatArray) -> FloatArray:
    """Return J^T J S^-1 J^T J, S the covariance of the score, in the observable subspace."""
    values, vectors = np.linalg.eigh(shaped)
    kept = values > NO_INFORMATION * values[-1]
    basis = vectors[:, kept]
    inner = basis.T @ noise @ basis
    gain = np.diag(values[kept])
    floor = 1e-14 * max(float(np.trace(inner)), 1e-300) * np.eye(len(inner))
    reduced = gain @ np.linalg.solve(inner + floor, gain)
    return np.asarray(basis @ (0.5 * (reduced + reduced.T)) @ basis.T)


def _inverse(matrix: FloatArray) -> tuple[FloatArray, BoolArray]:
    """
    Return the inverse of an information matrix, and which parameters it leaves open.

    Directions without information are left out of the inverse; open are the parameters that
    take part in one.
    """
    scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
    known = values > _ROUNDING * values[-1]
    inverse = vectors[:, known] @ np.diag(1.0 / values[known]) @ vectors[:, known].T
    taking_part = np.sqrt(np.sum(vectors[:, ~known] ** 2, axis=1)) > TAKES_PART
    return np.asarray(inverse / np.outer(scale, scale)), np.asarray(taking_part)


def _correlation(covariance: FloatArray) -> FloatArray:
    std = np.sqrt(np.diag(covariance))
    with np.errstate(invalid='ignore', divide='ignore'):
        return np.asarray(np.clip(covariance / np.outer(std, std), -1.0, 1.0))


def free_scale(
    jacobians: Sequence[FloatArray], values: FloatArray, scaling: Sequence[bool]
) -> bool:
    """Whether a common factor on the ``scaling`` parameters leaves the residuals as they are."""
    chosen = np.array(scaling)
    if chosen.sum() < 2:
        return False
    together, single = 0.0, 0.0
    for jacobian in jacobians:
        columns = jacobian[..., chosen] * values[chosen]
        together += float(np.sum(columns.sum(axis=-1) ** 2))
        single += float(np.sum(columns**2))
    return together < FREE_SCALE * single
