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
Compiled inertia and acceleration terms of one flexible link in its own frame.

Notation as in :mod:`flexarm_ros.core.arm.full.dynamics`.  With r = (x, y) the
map of :mod:`flexarm_ros.core.arm.full.model`, x_a = -G a and y_a = phi:

    S = int rho r,  D = int rho r_a,  I = int rho |r|^2,
    h = int rho (x y_a - y x_a),  F = int rho (x_a x_a^T + y_a y_a^T)

and the accelerations that remain for v' = w' = 0 and a'' = 0,
2 w J r_a a' - w^2 r + (-a'^T G a', 0), weighted with 1, J r and r_a, are f_v, f_w
and f_a.  The resulting terms go up to fourth order in (a, a'); all are kept.
"""

from __future__ import annotations

from flexarm_ros.core.arm.full.model import (
    FIRST,
    INERTIA,
    MEAN,
    MODAL,
    MOMENT,
    SHORT,
    SPIN,
)
from flexarm_ros.core.numerics.compiled import compiled, FloatArray

# Scalar parts of a link's result: rows of ``out``.
SX, SY, SPIN_INERTIA, FX, FY, FW = range(6)


@compiled
def link_terms(
    scalars: FloatArray,
    vectors: FloatArray,
    matrices: FloatArray,
    cross: FloatArray,
    quartic: FloatArray,
    a: FloatArray,
    da: FloatArray,
    w: float,
    out: FloatArray,
    flexible: FloatArray,
    axial: FloatArray,
    h: FloatArray,
    bias: FloatArray,
    scratch: FloatArray,
) -> None:
    """
    Fill one link's terms; the first five arguments are its ``Constants``.

    ``a``, ``da`` (N,): coordinates and rates; ``w``: rate of the frame, rad/s.
    ``out`` (6,): S_x, S_y (kg m), I (kg m^2), f_v (N), f_w (N m).
    ``flexible`` (N, N): F.  ``axial`` (N,): the x row of D (its y row is the
    constant MEAN).  ``h`` (N,).  ``bias`` (N,): f_a.  ``scratch``: (N,).
    """
    out[SX], out[SY], out[SPIN_INERTIA], out[FW] = scalars[FIRST], 0.0, scalars[INERTIA], 0.0
    _quadratic_terms(vectors, matrices, a, da, w, out, axial, h, bias)
    _cross_terms(cross, a, da, w, out, h, bias)
    _quartic_terms(matrices[MODAL], quartic, a, da, w, out, flexible, bias, scratch)


@compiled
def _quadratic_terms(
    vectors: FloatArray,
    matrices: FloatArray,
    a: FloatArray,
    da: FloatArray,
    w: float,
    out: FloatArray,
    axial: FloatArray,
    h: FloatArray,
    bias: FloatArray,
) -> None:
    """Set or add the terms of the single integrals of phi and of G."""
    along, along_rate, rate2, across, across_rate = 0.0, 0.0, 0.0, 0.0, 0.0
    spin, spin_rate = 0.0, 0.0
    for i in range(a.shape[0]):
        shorten, shorten_rate, change = 0.0, 0.0, 0.0
        for j in range(a.shape[0]):
            shorten += matrices[SHORT, i, j] * a[j]
            shorten_rate += matrices[SHORT, i, j] * da[j]
            change += matrices[SPIN, i, j] * a[j]
        axial[i] = -shorten
        along += a[i] * shorten
        along_rate += da[i] * shorten
        rate2 += da[i] * shorten_rate
        across += vectors[MEAN, i] * a[i]
        across_rate += vectors[MEAN, i] * da[i]
        spin += a[i] * change
        spin_rate += da[i] * change
        h[i] = vectors[MOMENT, i]
        bias[i] = -w * w * change
    out[SX] -= 0.5 * along
    out[SY] += across
    out[SPIN_INERTIA] += spin
    out[FX] = -2.0 * w * across_rate - w * w * out[SX] - rate2
    out[FY] = -2.0 * w * along_rate - w * w * across
    out[FW] += 2.0 * w * spin_rate


@compiled
def _cross_terms(
    cross: FloatArray,
    a: FloatArray,
    da: FloatArray,
    w: float,
    out: FloatArray,
    h: FloatArray,
    bias: FloatArray,
) -> None:
    """Add the terms of int rho phi_i G_jk: the foreshortening seen across the link."""
    n = a.shape[0]
    total = 0.0
    for i in range(n):
        for j in range(n):
            y, rate = 0.0, 0.0
            for k in range(n):
                y += cross[i, j, k] * a[k]
                rate += cross[i, j, k] * da[k]
            h[j] += y * a[i]
            h[i] -= 0.5 * y * a[j]
            bias[j] += 2.0 * w * y * da[i]
            bias[i] -= 2.0 * w * y * da[j]
            total += a[i] * rate * da[j]
    out[FW] += total


@compiled
def _quartic_terms(
    modal: FloatArray,
    quartic: FloatArray,
    a: FloatArray,
    da: FloatArray,
    w: float,
    out: FloatArray,
    flexible: FloatArray,
    bias: FloatArray,
    scratch: FloatArray,
) -> None:
    """Set F and add the terms of int rho G_ik G_jl: the inertia of the axial motion."""
    n = a.shape[0]
    fourth, fourth_rate = 0.0, 0.0
    for i in range(n):
        gradient, bend = 0.0, 0.0
        for j in range(n):
            scratch[:] = 0.0
            for k in range(n):
                for m in range(n):
                    scratch[m] += quartic[i, j, k, m] * a[k]
            value, rate = 0.0, 0.0
            for k in range(n):
                value += scratch[k] * a[k]
                rate += scratch[k] * da[k]
            flexible[i, j] = modal[i, j] + value
            gradient += value * a[j]
            bend += rate * da[j]
        fourth += gradient * a[i]
        fourth_rate += gradient * da[i]
        bias[i] += bend - 0.5 * w * w * gradient
    out[SPIN_INERTIA] += 0.25 * fourth
    out[FW] += w * fourth_rate
