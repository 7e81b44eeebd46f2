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
from flexarm_ros.identification.estimate.scores import Block, NO_INFORMATION, score_covariance
import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
TAKES_PART = 1e-2
"""Share of a parameter in a direction without information from which it is undetermined."""

_ROUNDING = 1e-12

TELLS = 0.5
"""Largest std, per value or per prior std, of a parameter that the data identify."""

FREE_SCALE = 1e-5
"""Least information about a common scale, per that about each parameter, that counts."""


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
    for jacobian, _ in blocks:
        information += np.einsum('cnp,cnq->pq', jacobian, jacobian)
    scores = score_covariance(blocks)
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
        noise = scores[part] / np.outer(unit, unit)
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
