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

"""
Covariance of the score J^T r of a fit whose residuals are correlated in time and across channels.

Noise of a measured torque passes through the model into every angle, rate and strain, where it
stays for as long as the arm takes to come to rest: the channels of a recording are correlated with
each other, and over seconds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.special import ndtr
from scipy.stats import t as student

ComplexArray = NDArray[np.complex128]
Block = tuple[FloatArray, FloatArray]
"""Jacobian (c, n, p) and residual (c, n) of the c channels of a recording."""

NO_INFORMATION = 1e-8
"""Smallest eigenvalue of the scaled information, per largest, that counts as information."""

MOST_TAKEN = 0.75
"""Largest share of a variance that the fit counts as having taken out of the residuals."""


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


def score_covariance(blocks: Sequence[Block]) -> FloatArray:
    """
    Return the covariance of J^T r, (p, p), such that two std hold 95 of 100 errors.

    Residuals of different recordings count as independent.  The larger, in each common axis, of
    two estimates with Bartlett's window: from the products J_t^T r_t (Newey and West 1987), which
    see that residuals are larger where the arm moves, and from the cross spectra of the residuals.
    Each is corrected for its bias, as a fit takes out a part of the power of residuals that stay
    correlated for a good part of the recording, and the window another: it is divided by what it
    would be in the mean of fits with residuals of the spectra found, per the true variance.  The
    variances are widened last by the square of Student's t at two std, per that of a normal
    distribution, with the degrees of freedom of the cross spectra (Satterthwaite 1946).
    """
    information = _symmetric(
        sum(np.einsum('cnp,cnq->pq', jacobian, jacobian) for jacobian, _ in blocks)
    )
    basis = _orthonormal(information)
    parts = [Recorded(jacobian @ basis, residual) for jacobian, residual in blocks]
    spectral = np.asarray(sum(part.spectral for part in parts))
    products = np.asarray(sum(part.products for part in parts))
    total = float(np.trace(spectral))
    if total == 0.0:
        return np.zeros_like(information)
    # The cross spectra give the variance 1 in each axis, the products ``ratios``.
    ratios, axes = eigh(products, spectral + 1e-12 * total * np.eye(len(spectral)))
    seen, seen_products, freedom = _moments(parts, axes, spectral)
    levels = np.maximum(1.0 / seen, ratios / seen_products)
    levels *= (student.ppf(ndtr(2.0), freedom) / 2.0) ** 2
    root = information @ basis @ np.linalg.inv(axes).T
    return np.asarray((root * levels) @ root.T)


@dataclass(frozen=True, eq=False)
class Recorded:
    """Jacobian (c, n, p) and residual (c, n) of a recording."""

    jacobian: FloatArray
    residual: FloatArray

    @cached_property
    def window(self) -> FloatArray:
        """Return Bartlett's window over four correlation lengths, at lags 0 to n, -n to -1."""
        lags = max(correlation_length(channel) for channel in self.residual)
        return _both_ways(self.samples, 4 * lags + 1.0 if lags > 1 else 1.0)

    @property
    def samples(self) -> int:
        """Return the number n of samples."""
        return int(self.residual.shape[1])

    @cached_property
    def lagged(self) -> FloatArray:
        """Return the covariances of the residuals, (c, c, 2n), in the order of `window`."""
        return _lagged(self.residual[..., None], self.residual[..., None]) / self.samples

    @cached_property
    def kernel(self) -> ComplexArray:
        """Return the cross spectra of the residuals, (c, c, n + 1), positive semidefinite."""
        return np.fft.rfft(self.lagged * self.window)

    @cached_property
    def spectral(self) -> FloatArray:
        """Return J^T S J, (p, p), S the covariance of the residuals by their cross spectra."""
        return _symmetric(np.einsum('cnp,cnq->pq', self.jacobian, self.spread(self.jacobian)))

    @cached_property
    def products(self) -> FloatArray:
        """Return the covariance of the sum of J_t^T r_t, (p, p)."""
        scores = np.einsum('cnp,cn->np', self.jacobian, self.residual)
        return _symmetric(_lagged(scores.T[..., None], scores.T[..., None]) @ self.window)

    def spread(self, signals: FloatArray) -> FloatArray:
        """Return S times signals, (c, n, p)."""
        waves = np.einsum('abf,bfp->afp', self.kernel.conj(), _waves(signals))
        return np.asarray(np.fft.irfft(waves, 2 * self.samples, axis=1)[:, : self.samples])

    def away(self, covariance: FloatArray) -> FloatArray:
        """
        Return A (c, n, m), for which (1 - Z Z^T) S (1 - Z Z^T) is S - Z A^T - A Z^T.

        Z is the Jacobian, whose columns are orthonormal over all recordings; ``covariance``:
        Z^T S Z (m, m), over all recordings.
        """
        return np.asarray(self.spread(self.jacobian) - 0.5 * self.jacobian @ covariance)

    def expected(self, away: FloatArray) -> FloatArray:
        """Return the mean of `lagged`, (c, c, 2n), where a fit takes Z out of residuals with S."""
        taken = _lagged(self.jacobian, away) + _lagged(away, self.jacobian)
        shares = _both_ways(self.samples, float(self.samples))
        return np.asarray(self.lagged * self.window * shares - taken / self.samples)


def _moments(
    parts: Sequence[Recorded], axes: FloatArray, spectral: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return what the estimates of a variance 1 along each axis are in the mean, and their freedom.

    By the cross spectra and by the products, (m,) each, and the degrees of freedom of the first.
    ``parts`` have orthonormal Jacobians, with m columns, and ``spectral`` (m, m).
    """
    mean, products, before, squares = np.zeros((4, len(spectral)))
    for part in parts:
        away = part.away(spectral)
        expected = part.expected(away)
        for k, axis in enumerate(axes.T):
            one = part.jacobian @ axis
            weights = _lagged(one[..., None], one[..., None]) * part.window
            whole = np.sum(weights * part.lagged * part.window)
            taken, rest = (np.einsum('cn,cnm->nm', one, x)[None] for x in (part.jacobian, away))
            before[k] += whole
            mean[k] += np.sum(weights * expected)
            products[k] += whole - 2.0 * np.sum(_lagged(taken, rest) * part.window)
            product = np.einsum('abf,bcf->acf', np.fft.rfft(weights), part.kernel)
            power = np.einsum('abf,baf->f', product, product).real
            squares[k] += (power.sum() - 0.5 * (power[0] + power[-1])) / part.samples**2
    least = 1.0 - MOST_TAKEN
    freedom = np.maximum(before**2 / squares, 1.0)
    return np.maximum(mean, least), np.maximum(products, least), freedom


def _orthonormal(information: FloatArray) -> FloatArray:
    """Return a basis B, (p, m), of the observable directions with B^T information B = 1."""
    scale = np.sqrt(np.diag(information))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    kept = values > NO_INFORMATION * values[-1]
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]) / scale[:, None])


def _symmetric(matrix: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (matrix + matrix.T))


def _both_ways(count: int, width: float) -> FloatArray:
    """Return Bartlett's window of a width at lags 0 to n and -n + 1 to -1, (2n,)."""
    half = np.maximum(1.0 - np.arange(count + 1) / width, 0.0)
    return np.concatenate([half, half[-2:0:-1]])


def _waves(signals: FloatArray) -> ComplexArray:
    """Return the Fourier transform over the second axis, of n samples and as many zeros."""
    return np.fft.rfft(signals, 2 * signals.shape[1], axis=1)


def _lagged(first: FloatArray, second: FloatArray) -> FloatArray:
    """
    Return the sums over t and p of a(t, p) b(t + lag, p) for each pair of channels, (c, c, 2n).

    ``first`` and ``second`` (c, n, p); lags 0 to n, then -n + 1 to -1.
    """
    products = np.einsum('afp,bfp->abf', _waves(first).conj(), _waves(second))
    return np.asarray(np.fft.irfft(products, 2 * first.shape[1]))
