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
Shape functions of a flexible link.

Everything here is dimensionless: a link is 0 <= xi <= 1, its deflection is
w = sum_i phi_i(xi) a_i.  All shapes satisfy phi(0) = phi'(0) = 0, since the joint angle
turns the tangent at the start of the link.

Three families of functions, from which ``plant.basis`` is built:

``clamped_free``
    The modes of a cantilever, (6) to (9) of the paper.  Each has
    phi''(1) = phi'''(1) = 0, so that no sum of them represents the moment or the
    force of a further link: convergence is only of order 1/N.
``craig_bampton``
    The static deflections under an end force and an end moment (the cubics),
    then the modes of the link with both ends clamped: Craig and Bampton (AIAA
    Journal 6, 1968) with the link's two ends as the interface.  With one
    function a link it is the end force's deflection alone.
``polynomial``
    Curvatures are the Legendre polynomials, orthonormal: a complete set that
    converges exponentially, from which :mod:`flexarm_ros.core.arm.basis_arm` derives
    the few functions of ``arm_modes``.

The chosen functions are then combined so that they are orthogonal in mass and
stiffness over the bare link, which makes the matrices well conditioned and
gives modal damping a meaning: coordinate i is the link's i-th (approximate)
cantilever mode.  Scale: the integral of phi_i^2 over xi is 1/4 and
phi_i(1) > 0, so that an exact cantilever mode has phi_i(1) = 1 and its
coordinate is its share of the end deflection in metres.

The arithmetic is that of :mod:`flexarm_ros.core.numerics.elementary` and
:mod:`flexarm_ros.core.numerics.linalg`, so that all processes get the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
import math

from flexarm_ros.core.arm.beam import beam_mode, beam_shape, clamped_free_mode
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.linalg import (
    inverse_factor,
    product,
    symmetric_eigen,
    weighted_gram,
)
import numpy as np

PANELS = 32
"""Panels of the composite five-point Gauss rule: exact to rounding for all shapes used."""


@cache
def clamped_clamped_mode(index: int) -> tuple[float, float]:
    """
    Return root number ``index`` (from 0) of cos(z) cosh(z) = 1, and its mode's ratio.

    The roots are 4.7300, 7.8532, ...; `beam_shape` takes both numbers.
    """
    return beam_mode((index + 1.5) * math.pi, -1.0)


def _clamped_free(index: int, xi: FloatArray, order: int) -> FloatArray:
    return beam_shape(*clamped_free_mode(index), xi, order)


def _craig_bampton(index: int, xi: FloatArray, order: int) -> FloatArray:
    if index == 0:  # end force
        return (0.5 * xi * xi * (3.0 - xi), 0.5 * xi * (6.0 - 3.0 * xi), 3.0 - 3.0 * xi)[order]
    if index == 1:  # end moment
        return (xi * xi, 2.0 * xi, 2.0 + 0.0 * xi)[order]
    return beam_shape(*clamped_clamped_mode(index - 2), xi, order)


def _polynomial(index: int, xi: FloatArray, order: int) -> FloatArray:
    """
    Return the function with the curvature sqrt(2 i + 1) P_i(t), t = 2 xi - 1.

    Its integrals from t = -1 on follow from (2 i + 1) P_i = P_i+1' - P_i-1'
    (Abramowitz and Stegun, 8.5.3 and 22.7.10).
    """
    t = 2.0 * xi - 1.0
    values = [1.0 + 0.0 * t, t]
    for n in range(1, index + 2):
        values.append(((2.0 * n + 1.0) * t * values[n] - n * values[n - 1]) / (n + 1.0))
    for integral in range(2 - order):
        # The first integral of P_0 is t + 1, the second (t + 1)^2 / 2; d xi = d t / 2.
        first = (t + 1.0) * (0.125 * (t + 1.0) if integral else 0.5)
        rest = [
            0.5 * (values[i + 1] - values[i - 1]) / (2.0 * i + 1.0)
            for i in range(1, index + 2 - integral)
        ]
        values = [first, *rest]
    return math.sqrt(2.0 * index + 1.0) * values[index]


_FAMILIES = {
    'clamped_free': _clamped_free,
    'craig_bampton': _craig_bampton,
    'polynomial': _polynomial,
}


def family(name: str, count: int, xi: FloatArray, order: int) -> FloatArray:
    """Return the first ``count`` functions of a family at ``xi``, shape ``(count, points)``."""
    return np.array([_FAMILIES[name](i, xi, order) for i in range(count)])


@dataclass(frozen=True)
class Basis:
    """
    N orthogonal shape functions on 0 <= xi <= 1, combined from those of ``family``.

    ``mixing`` has shape ``(N, R)``: shape i = sum_j mixing[i, j] function_j.
    ``stiffness`` has shape ``(N,)``: the integrals of phi_i''^2; the
    dimensionless frequency of coordinate i alone is sqrt(4 stiffness_i).
    """

    family: str
    mixing: FloatArray
    stiffness: FloatArray

    def shape(self, xi: FloatArray | float, order: int = 0) -> FloatArray:
        """Return d^order phi / d xi^order, shape ``(N, points)``; order 0, 1 or 2."""
        points = np.atleast_1d(np.asarray(xi, dtype=float))
        raw = family(self.family, self.mixing.shape[1], points, order)
        return product(self.mixing, raw)

    def shortening(self, xi: float) -> FloatArray:
        """Return the integral from 0 to xi of phi_i' phi_j', shape ``(N, N)``."""
        nodes, weights = composite_rule()
        return xi * weighted_gram(weights, self.shape(xi * nodes, 1))


def gauss5() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the five-point Gauss rule on (0, 1), in closed form."""
    inner = math.sqrt(5.0 - 2.0 * math.sqrt(10.0 / 7.0)) / 3.0
    outer = math.sqrt(5.0 + 2.0 * math.sqrt(10.0 / 7.0)) / 3.0
    w_inner = (322.0 + 13.0 * math.sqrt(70.0)) / 900.0
    w_outer = (322.0 - 13.0 * math.sqrt(70.0)) / 900.0
    nodes = np.array([-outer, -inner, 0.0, inner, outer])
    weights = np.array([w_outer, w_inner, 128.0 / 225.0, w_inner, w_outer])
    return 0.5 * (nodes + 1.0), 0.5 * weights


@lru_cache
def composite_rule() -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights of the composite rule on (0, 1)."""
    nodes, weights = gauss5()
    starts = np.arange(PANELS)[:, None]
    return ((starts + nodes) / PANELS).ravel(), np.tile(weights / PANELS, PANELS)


def identity(size: int) -> FloatArray:
    """Return the unit matrix."""
    return np.array([[float(i == j) for j in range(size)] for i in range(size)])


def orthogonal_basis(name: str, combinations: FloatArray) -> Basis:
    """Return the basis that spans the given combinations ``(N, R)`` of a family's functions."""
    nodes, weights = composite_rule()
    shapes = family(name, combinations.shape[1], nodes, 0)
    curvatures = family(name, combinations.shape[1], nodes, 2)
    mixing = combinations
    values: FloatArray = np.zeros(len(combinations))
    for _ in range(2):  # the second pass removes the rounding errors of the first
        inverse = inverse_factor(weighted_gram(weights, product(mixing, shapes)))
        stiffness = weighted_gram(weights, product(mixing, curvatures))
        reduced = product(product(inverse, stiffness), np.ascontiguousarray(inverse.T))
        values, vectors = symmetric_eigen(0.5 * (reduced + reduced.T))
        turned = product(np.ascontiguousarray(vectors.T), inverse)
        mixing = 0.5 * product(turned, mixing)
    ends = product(mixing, family(name, mixing.shape[1], np.ones(1), 0))[:, 0]
    mixing = mixing * np.where(ends < 0.0, -1.0, 1.0)[:, None]
    return Basis(name, mixing, 0.25 * values)
