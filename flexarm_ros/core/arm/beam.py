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
Clamped-free Euler-Bernoulli beam modes: equations (6) to (9) of the paper.

The roots are those of the characteristic equation,
cos(z) cosh(z) + 1 = 0 (1.8751, 4.6941, ...), not the paper's approximation
(i - 0.5) pi, which would give 8.62 instead of its omega_c1 = 12.28.

Normalisation: shapes are as printed in (8) with A = 0.1.  So, for mode i from
0, the end deflects by phi_i(L) = 2 A (-1)^i = +-0.2 per unit of its coordinate,
and the integral of phi_i^2 over the link is A^2 L.  A is arbitrary: it scales
the modal coordinates but nothing observable.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
import math

from flexarm_ros.core.numerics.compiled import allocating, FloatArray, interpreted
from flexarm_ros.core.numerics.elementary import exp, sincos
import numpy as np

_sincos, _exp = interpreted(sincos), interpreted(exp)

AMPLITUDE = 0.1
"""The constant A of (8)."""


def clamped_free_root(index: int) -> float:
    """
    Return root number ``index`` (from 0) of cos(z) cosh(z) + 1 = 0, z = lambda L.

    From the paper's approximation (0.597 pi for the first).
    """
    return clamped_free_mode(index)[0]


@cache
def clamped_free_mode(index: int) -> tuple[float, float]:
    """Return root number ``index`` and 1 - k there, k as in (8)."""
    return beam_mode((index + 0.5) * math.pi if index else 1.875, 1.0)


def beam_mode(z: float, sign: float) -> tuple[float, float]:
    """
    Return the root of cos(z) cosh(z) + ``sign`` = 0 near ``z``, and 1 - k there.

    ``sign`` is 1 for a free end, -1 for a clamped one.  Newton's method on
    cos(z) + sign / cosh(z), which has the same roots and does not grow with z.
    """
    for _ in range(50):
        sine, cosine = _sincos(z)
        fall = _exp(-z)
        square = fall * fall
        sech = sign * 2.0 * fall / (1.0 + square)
        tanh = (1.0 - square) / (1.0 + square)
        step = (cosine + sech) / (sine + sech * tanh)
        z += step
        if abs(step) <= 1e-15 * z:
            break
    sine, cosine = _sincos(z)
    fall = _exp(-z)
    sinh = 0.5 * (1.0 / fall - fall)
    return z, (sign * (sine - cosine) - fall) / (sinh + sign * sine)


@allocating
def beam_shape(root: float, rest: float, xi: FloatArray, order: int) -> FloatArray:
    """
    Return d^order of cosh z - cos z - (1 - rest) (sinh z - sin z), z = root xi.

    At ``xi`` ``(points,)``, order 0, 1 or 2.  cosh - k sinh is written as
    exp(-z) + (1 - k) sinh(z), with 1 - k in the closed form of `beam_mode`: as
    printed, (8) cancels to noise near the end of a link.
    """
    k = 1.0 - rest
    out = np.zeros(xi.shape[0])
    for i in range(xi.shape[0]):
        z = root * xi[i]
        sine, cosine = sincos(z)
        fall = exp(-z)
        rise = 1.0 / fall
        if order == 0:
            out[i] = fall + rest * 0.5 * (rise - fall) - cosine + k * sine
        elif order == 1:
            out[i] = root * (-fall + rest * 0.5 * (rise + fall) + sine + k * cosine)
        else:
            out[i] = root * root * (fall + rest * 0.5 * (rise - fall) + cosine - k * sine)
    return out


_beam_shape = interpreted(beam_shape)


@dataclass(frozen=True)
class ClampedFreeModes:
    """
    The first ``count`` modes of a uniform link clamped at x = 0.

    ``length`` in m, ``mass_density`` in kg/m, ``flexural_rigidity`` in N m^2.
    All results are arrays of shape ``(count,)``, lowest mode first.
    """

    length: float
    mass_density: float
    flexural_rigidity: float
    count: int

    @property
    def roots(self) -> FloatArray:
        """lambda_i L, the roots of the characteristic equation."""
        return np.array([clamped_free_root(i) for i in range(self.count)])

    @property
    def frequencies(self) -> FloatArray:
        """omega_ci in rad/s, equation (9)."""
        square = self.length * self.length
        scale = math.sqrt(self.flexural_rigidity / (self.mass_density * square * square))
        return self.roots * self.roots * scale

    @property
    def ratios(self) -> FloatArray:
        """k_ci of (8)."""
        return np.array([1.0 - clamped_free_mode(i)[1] for i in range(self.count)])

    def shape(self, x: float) -> FloatArray:
        """phi_i(x) of (8), m per unit of the modal coordinate; x in m from the clamp."""
        return self._derivative(x, 0)

    def slope(self, x: float) -> FloatArray:
        """phi_i'(x), rad per unit of the modal coordinate."""
        return self._derivative(x, 1)

    def curvature(self, x: float) -> FloatArray:
        """phi_i''(x), 1/m per unit of the modal coordinate."""
        return self._derivative(x, 2)

    def _derivative(self, x: float, order: int) -> FloatArray:
        at = np.array([x / self.length])
        scale = AMPLITUDE
        for _ in range(order):
            scale /= self.length
        shapes = [_beam_shape(*clamped_free_mode(i), at, order)[0] for i in range(self.count)]
        return scale * np.array(shapes)

    @property
    def modal_mass(self) -> FloatArray:
        """Integral of rho phi_i^2, kg: the modes are orthogonal, (12)."""
        return np.full(self.count, self.mass_density * (AMPLITUDE * AMPLITUDE) * self.length)

    @property
    def modal_stiffness(self) -> FloatArray:
        """Integral of EI phi_i''^2, N m: (13), with q instead of the printed rate."""
        return self.modal_mass * (self.frequencies * self.frequencies)

    @property
    def first_moment(self) -> FloatArray:
        """Integral of rho x phi_i, kg m.  From (6): rho phi_i''(0) / lambda_i^4."""
        part = self.length / self.roots
        return 2.0 * AMPLITUDE * self.mass_density * (part * part)

    @property
    def mean(self) -> FloatArray:
        """Integral of rho phi_i, kg.  From (6): -rho phi_i'''(0) / lambda_i^4."""
        return 2.0 * AMPLITUDE * self.mass_density * self.ratios * self.length / self.roots
