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

G is symmetric, so that the terms of third and fourth order are sums over pairs of
coordinates instead of N^3 and N^4 terms; a pair i >= j is number i (i + 1) / 2 + j.
"""

from __future__ import annotations

from typing import Any, Protocol

from flexarm_ros.core.arm.full.model import Link
from flexarm_ros.core.numerics.compiled import FloatArray, internal
from flexarm_ros.core.numerics.records import record_type


class LinkTerms(Protocol):
    """
    Result of :func:`link_terms`, and its scratch.

    ``sx``, ``sy``: S (kg m); ``spin_inertia``: I (kg m^2); ``fx``, ``fy``: f_v (N); ``fw``: f_w
    (N m).  (N,) ``axial``: the x row of D (its y row is the constant ``mass_shape``); ``h``;
    ``bias``: f_a.  ``flexible`` (N, N): F, of which the lower triangle is set.

    Scratch: ``cross`` (N, N); ``squares``, ``rates``, ``stretch``, ``bend`` (P,): products of
    coordinates and of rates, sums over pairs; ``chord``, ``rate_chord``, ``change``, ``across``,
    ``gradient`` (N,).
    """

    sx: float
    sy: float
    spin_inertia: float
    fx: float
    fy: float
    fw: float
    axial: FloatArray
    h: FloatArray
    bias: FloatArray
    flexible: FloatArray
    cross: FloatArray
    squares: FloatArray
    rates: FloatArray
    stretch: FloatArray
    bend: FloatArray
    chord: FloatArray
    rate_chord: FloatArray
    change: FloatArray
    across: FloatArray
    gradient: FloatArray


def terms_type(modes: int) -> Any:
    """Return the dtype of :class:`LinkTerms`."""
    pairs = modes * (modes + 1) // 2
    vectors = ('axial', 'h', 'bias', 'chord', 'rate_chord', 'change', 'across', 'gradient')
    return record_type(
        [
            *((name, float) for name in ('sx', 'sy', 'spin_inertia', 'fx', 'fy', 'fw')),
            *((name, float, (modes,)) for name in vectors),
            *((name, float, (modes, modes)) for name in ('flexible', 'cross')),
            *((name, float, (pairs,)) for name in ('squares', 'rates', 'stretch', 'bend')),
        ]
    )


@internal
def link_terms(link: Link, a: FloatArray, da: FloatArray, w: float, out: LinkTerms) -> None:
    """Fill ``out``; ``a``, ``da`` (N,): coordinates and rates; ``w``: rate of the frame, rad/s."""
    _pair_products(a, da, out)
    _quadratic_terms(link, a, da, w, out)
    _cross_terms(link, a, da, w, out)
    _quartic_terms(link, a, da, w, out)


@internal
def _pair_products(a: FloatArray, da: FloatArray, out: LinkTerms) -> None:
    """Set ``squares`` and ``rates``."""
    p = 0
    for i in range(len(out.h)):
        for j in range(i + 1):
            out.squares[p], out.rates[p] = a[i] * a[j], da[i] * da[j]
            p += 1


@internal
def _quadratic_terms(link: Link, a: FloatArray, da: FloatArray, w: float, out: LinkTerms) -> None:
    """Set the terms of the single integrals of phi and of G."""
    n = len(link.mass_shape)
    for i in range(n):
        out.chord[i], out.rate_chord[i], out.change[i] = 0.0, 0.0, 0.0
    for j in range(n):
        for i in range(n):
            out.chord[i] += link.short[j, i] * a[j]
            out.rate_chord[i] += link.short[j, i] * da[j]
            out.change[i] += link.spin[j, i] * a[j]
    along, along_rate, rate2, across, across_rate = 0.0, 0.0, 0.0, 0.0, 0.0
    spin, spin_rate = 0.0, 0.0
    for i in range(n):
        out.axial[i] = -out.chord[i]
        along += a[i] * out.chord[i]
        along_rate += da[i] * out.chord[i]
        rate2 += da[i] * out.rate_chord[i]
        across += link.mass_shape[i] * a[i]
        across_rate += link.mass_shape[i] * da[i]
        spin += a[i] * out.change[i]
        spin_rate += da[i] * out.change[i]
        out.h[i] = link.moment[i]
        out.bias[i] = -w * w * out.change[i]
    out.sx = link.first - 0.5 * along
    out.sy = across
    out.spin_inertia = link.inertia + spin
    out.fx = -2.0 * w * across_rate - w * w * out.sx - rate2
    out.fy = -2.0 * w * along_rate - w * w * across
    out.fw = 2.0 * w * spin_rate


@internal
def _cross_terms(link: Link, a: FloatArray, da: FloatArray, w: float, out: LinkTerms) -> None:
    """Add the terms of int rho phi_i G_jk: the foreshortening seen across the link."""
    n = len(link.mass_shape)
    for i in range(n):
        out.across[i] = 0.0
        for j in range(n):
            out.cross[i, j] = 0.0
    for k in range(n):
        for i in range(n):
            for j in range(n):
                out.cross[i, j] += link.cross[k, i, j] * a[k]
    for q in range(len(link.bend)):
        for i in range(n):
            out.across[i] += link.cross_pairs[q, i] * out.rates[q]
    total, twice = 0.0, 2.0 * w
    for i in range(n):
        turned, bent = 0.0, 0.0
        for j in range(n):
            y = out.cross[i, j]
            out.h[j] += y * a[i]
            out.bias[j] += twice * y * da[i]
            bent += y * a[j]
            turned += y * da[j]
        out.h[i] -= 0.5 * bent
        out.bias[i] -= twice * turned
        total += a[i] * out.across[i]
    out.fw += total


@internal
def _quartic_terms(link: Link, a: FloatArray, da: FloatArray, w: float, out: LinkTerms) -> None:
    """Set F and add the terms of int rho G_ik G_jl: the inertia of the axial motion."""
    n, pairs = len(link.mass_shape), len(link.bend)
    for p in range(pairs):
        out.stretch[p], out.bend[p] = 0.0, 0.0
    for q in range(pairs):
        for p in range(pairs):
            out.stretch[p] += link.stretch[q, p] * out.squares[q]
            out.bend[p] += link.bend[q, p] * out.rates[q]
    for i in range(n):
        out.gradient[i] = 0.0
    p = 0
    for i in range(n):
        for j in range(i + 1):
            value, rate = out.stretch[p], out.bend[p]
            p += 1
            out.flexible[i, j] = link.modal[i, j] + value
            out.gradient[i] += value * a[j]
            out.bias[i] += rate * a[j]
            if j < i:
                out.gradient[j] += value * a[i]
                out.bias[j] += rate * a[i]
    fourth, fourth_rate = 0.0, 0.0
    for i in range(n):
        fourth += out.gradient[i] * a[i]
        fourth_rate += out.gradient[i] * da[i]
        out.bias[i] -= 0.5 * w * w * out.gradient[i]
    out.spin_inertia += 0.25 * fourth
    out.fw += w * fourth_rate
