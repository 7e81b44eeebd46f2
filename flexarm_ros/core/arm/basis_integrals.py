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

"""Integrals of a link's shape functions for the full model."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.arm.basis import Basis, composite_rule, gauss5, PANELS
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.linalg import product, weighted_gram
import numpy as np


@dataclass(frozen=True)
class LinearIntegrals:
    """
    Integrals over xi for a link of unit length and mass; N shape functions.

    ``mean`` (N,): of phi_i; ``moment`` (N,): of xi phi_i; ``mass`` (N, N): of
    phi_i phi_j.  Values at the end, xi = 1: ``end``, ``end_slope`` (N,).
    """

    mean: FloatArray
    moment: FloatArray
    mass: FloatArray
    end: FloatArray
    end_slope: FloatArray


@dataclass(frozen=True)
class ShorteningIntegrals:
    """
    Integrals of g_ij(xi) = int_0^xi phi_i' phi_j', for the same link.

    The axial shortening of a link of length L is a^T g a / (2 L).

    ``short`` (N, N): of g; ``short_moment`` (N, N): of xi g; ``cross``
    (N, N, N): of phi_i g_jk; ``quartic`` (N, N, N, N): of g_ij g_kl;
    ``end_short`` (N, N): g at xi = 1.
    """

    short: FloatArray
    short_moment: FloatArray
    cross: FloatArray
    quartic: FloatArray
    end_short: FloatArray


def linear_integrals(basis: Basis) -> LinearIntegrals:
    """Return the integrals of the shape functions, by the composite Gauss rule."""
    nodes, weights = composite_rule()
    phi = basis.shape(nodes)
    first = product(phi, np.stack([weights, weights * nodes], axis=1))
    return LinearIntegrals(
        mean=np.ascontiguousarray(first[:, 0]),
        moment=np.ascontiguousarray(first[:, 1]),
        mass=weighted_gram(weights, phi),
        end=basis.shape(1.0)[:, 0],
        end_slope=basis.shape(1.0, 1)[:, 0],
    )


def shortening_integrals(basis: Basis) -> ShorteningIntegrals:
    """Return the integrals of the foreshortening, by the composite Gauss rule."""
    nodes, weights = composite_rule()
    phi = basis.shape(nodes)
    g = _running_shortening(basis)
    n = len(phi)
    flat = np.ascontiguousarray(g.reshape(len(nodes), n * n))
    first = product(np.stack([weights, weights * nodes]), flat)
    weighted = np.ascontiguousarray((weights[:, None] * flat).T)
    return ShorteningIntegrals(
        short=first[0].reshape(n, n),
        short_moment=first[1].reshape(n, n),
        cross=product(weights * phi, flat).reshape(n, n, n),
        quartic=product(weighted, flat).reshape(n, n, n, n),
        end_short=basis.shortening(1.0),
    )


def _running_shortening(basis: Basis) -> FloatArray:
    """
    Return g at every node of the composite rule, shape ``(nodes, N, N)``.

    Up to each node: the complete panels, then the rule again from the panel's
    start to the node.
    """
    nodes, weights = gauss5()
    points, all_weights = composite_rule()
    starts = np.repeat(np.arange(PANELS), len(nodes))
    inside = np.tile(nodes, PANELS)
    nested = (starts[:, None] + inside[:, None] * nodes) / PANELS
    slopes = basis.shape(nested.ravel(), 1).reshape(-1, len(points), len(nodes))
    part = _panel_grams(np.multiply.outer(inside / PANELS, weights), slopes)
    slopes = basis.shape(points, 1).reshape(-1, PANELS, len(nodes))
    whole = _panel_grams(all_weights.reshape(PANELS, len(nodes)), slopes)
    before = np.zeros_like(whole)
    for panel in range(1, PANELS):
        before[panel] = before[panel - 1] + whole[panel - 1]
    return np.asarray(part + np.repeat(before, len(nodes), axis=0))


def _panel_grams(weights: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return `weighted_gram` of each panel; ``weights`` (p, q), ``slopes`` (N, p, q)."""
    panels = np.ascontiguousarray(slopes.transpose(1, 0, 2))
    return np.array([weighted_gram(w, rows) for w, rows in zip(weights, panels, strict=True)])
