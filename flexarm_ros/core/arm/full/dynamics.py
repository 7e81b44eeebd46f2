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
Compiled equations of motion of the full model.

Kane's method, link by link.  A link's velocities are u = (v, w, da/dt): v the
velocity of its start in its own axes, w the angular velocity of its frame.
Its inertia in these is ``(m, J S, I; ., D, h; ., ., F)`` and its remaining
acceleration terms are ``(f_v, f_w, f_a)``; those of link 2 are transformed to the joint
rates through the motion of link 1's end.  Because every term follows from one
map r(s; a), the equations are exactly Lagrange's of the kinetic energy 1/2 q'^T M q',
and energy and the momentum conjugate to theta1 are conserved.

Order of q: theta1, theta2, a (link 1, N coordinates), b (link 2, N).
"""

from __future__ import annotations

import math
from typing import TypeAlias

from flexarm_ros.core.arm.full.link import FW, FX, FY, link_terms, SPIN_INERTIA, SX, SY
from flexarm_ros.core.arm.full.model import (
    BEND,
    Constants,
    DAMPING,
    END,
    END_SHORT,
    END_SLOPE,
    LENGTH,
    MASS,
    MEAN,
    STIFFNESS,
)
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.numerics.elementary import sincos
import numpy as np

Work: TypeAlias = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


def make_work(modes: int) -> Work:
    """
    Return the scratch arrays of ``mass_and_bias`` and ``step``.

    (2, 6): scalars per link; (2, N, N): F; (8, N): vectors;
    (8, 2 + 2N): the integrator's stages.
    """
    return (
        np.zeros((2, 6)),
        np.zeros((2, modes, modes)),
        np.zeros((9, modes)),
        np.zeros((8, 2 + 2 * modes)),
    )


@compiled
def mass_and_bias(
    con: Constants,
    q: FloatArray,
    qd: FloatArray,
    mass: FloatArray,
    force: FloatArray,
    work: Work,
) -> None:
    """
    Fill the lower triangle of M(q) and the Coriolis and centrifugal terms.

    ``mass``: (2 + 2N, 2 + 2N); ``force``: (2 + 2N,), so that
    M q'' + force + D q' + K q = (tau1, tau2, 0, ...).
    """
    single, flexible, vec, _ = work
    n = con.vectors.shape[2]
    second = 2 + n  # start of link 2's coordinates
    a, b = q[2:second], q[second:]
    da, db = qd[2:second], qd[second:]
    vectors, matrices = con.vectors, con.matrices
    # Motion of link 1's end, in link 1's axes.
    end_x, end_y, end_dx, end_dy, shorten2 = con.scalars[0, LENGTH], 0.0, 0.0, 0.0, 0.0
    turn, turn_rate = 0.0, 0.0
    reach_x, reach_y = vec[0], vec[1]
    for i in range(n):
        s, ds = 0.0, 0.0
        for j in range(n):
            s += matrices[0, END_SHORT, i, j] * a[j]
            ds += matrices[0, END_SHORT, i, j] * da[j]
        reach_x[i] = -s
        end_x -= 0.5 * s * a[i]
        end_dx -= s * da[i]
        shorten2 += ds * da[i]
        end_y += vectors[0, END, i] * a[i]
        end_dy += vectors[0, END, i] * da[i]
        turn += vectors[0, END_SLOPE, i] * a[i]
        turn_rate += vectors[0, END_SLOPE, i] * da[i]
    w1 = qd[0]
    w2 = w1 + qd[1] + turn_rate
    for link in range(2):
        link_terms(
            con.scalars[link], vectors[link], matrices[link], con.cross[link], con.quartic[link],
            a if link == 0 else b, da if link == 0 else db, w1 if link == 0 else w2,
            single[link], flexible[link], vec[2 + link], vec[4 + link], vec[6 + link], vec[8],
        )  # fmt: skip
    # Into link 2's axes: link 1's end velocity per unit of each rate, and the remainder.
    s, c = sincos(q[1] + turn)
    for i in range(n):
        x, y = reach_x[i], vectors[0, END, i]
        reach_x[i] = c * x + s * y
        reach_y[i] = c * y - s * x
    base_x, base_y = s * end_x - c * end_y, c * end_x + s * end_y
    ax = -2.0 * w1 * end_dy - w1 * w1 * end_x - shorten2
    ay = 2.0 * w1 * end_dx - w1 * w1 * end_y
    rest_x, rest_y = c * ax + s * ay, c * ay - s * ax
    total = con.scalars[1, MASS]
    # J S, the first moment turned by a right angle, and link 2's forces.
    jx, jy = -single[1, SY], single[1, SX]
    inertia = single[1, SPIN_INERTIA]
    fx = single[1, FX] + total * rest_x
    fy = single[1, FY] + total * rest_y
    fw = single[1, FW] + jx * rest_x + jy * rest_y
    lever = jx * base_x + jy * base_y
    mass[0, 0] = con.hub[0] + single[0, SPIN_INERTIA] + inertia + 2.0 * lever
    mass[0, 0] += total * (base_x * base_x + base_y * base_y)
    mass[1, 0] = inertia + lever
    mass[1, 1] = con.hub[1] + inertia
    force[0] = single[0, FW] + base_x * fx + base_y * fy + fw
    force[1] = fw
    for i in range(n):
        slope = vectors[0, END_SLOPE, i]
        arm = jx * reach_x[i] + jy * reach_y[i]
        mass[2 + i, 0] = (
            vec[4, i]
            + total * (base_x * reach_x[i] + base_y * reach_y[i])
            + arm
            + slope * (lever + inertia)
        )
        mass[2 + i, 1] = arm + slope * inertia
        force[2 + i] = vec[6, i] + reach_x[i] * fx + reach_y[i] * fy + slope * fw
        for j in range(i + 1):
            other = vectors[0, END_SLOPE, j]
            mass[2 + i, 2 + j] = (
                flexible[0, i, j]
                + total * (reach_x[i] * reach_x[j] + reach_y[i] * reach_y[j])
                + arm * other
                + slope * (jx * reach_x[j] + jy * reach_y[j] + inertia * other)
            )
    for k in range(n):
        dx, dy, hk, row = vec[3, k], vectors[1, MEAN, k], vec[5, k], 2 + n + k
        mass[row, 0] = base_x * dx + base_y * dy + hk
        mass[row, 1] = hk
        force[row] = vec[7, k] + dx * rest_x + dy * rest_y
        for i in range(n):
            slope = vectors[0, END_SLOPE, i]
            mass[row, 2 + i] = reach_x[i] * dx + reach_y[i] * dy + slope * hk
        for j in range(k + 1):
            mass[row, 2 + n + j] = flexible[1, k, j]


@compiled
def solve_spd(matrix: FloatArray, rhs: FloatArray) -> None:
    """Solve by Cholesky: ``matrix`` (lower triangle) is overwritten, ``rhs`` the solution."""
    n = rhs.shape[0]
    for i in range(n):
        for j in range(i):
            s = matrix[i, j]
            for k in range(j):
                s -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = s * matrix[j, j]
        s = matrix[i, i]
        for k in range(i):
            s -= matrix[i, k] * matrix[i, k]
        matrix[i, i] = 1.0 / math.sqrt(s)
        t = rhs[i]
        for k in range(i):
            t -= matrix[i, k] * rhs[k]
        rhs[i] = t * matrix[i, i]
    for i in range(n - 1, -1, -1):
        t = rhs[i]
        for k in range(i + 1, n):
            t -= matrix[k, i] * rhs[k]
        rhs[i] = t * matrix[i, i]


@compiled
def acceleration(
    con: Constants,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    mass: FloatArray,
    out: FloatArray,
    work: Work,
) -> None:
    """Fill ``out`` (2 + 2N,) with q''; ``mass`` is scratch."""
    n = con.vectors.shape[2]
    mass_and_bias(con, q, qd, mass, out, work)
    out[0] = tau1 - out[0]
    out[1] = tau2 - out[1]
    for link in range(2):
        for i in range(n):
            k = 2 + link * n + i
            elastic = con.vectors[link, STIFFNESS, i] * q[k]
            out[k] = -out[k] - elastic - con.vectors[link, DAMPING, i] * qd[k]
    solve_spd(mass, out)


@compiled
def step(
    con: Constants,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    h: float,
    substeps: int,
    mass: FloatArray,
    work: Work,
) -> tuple[float, float, float, float]:
    """
    Advance ``q`` and ``qd`` in place by ``substeps`` Runge-Kutta steps of h seconds.

    The classical fourth-order method: error of order h^4, and for an
    undamped mode of frequency w stable while w h < 2.83.  Returns
    :func:`end_deflections` of the new state.
    """
    stage = work[3]
    size = q.shape[0]
    x, v, acc, sum_x, sum_v = stage[0], stage[1], stage[2], stage[3], stage[4]
    for _ in range(substeps):
        for i in range(size):
            x[i] = q[i]
            v[i] = qd[i]
            sum_x[i] = 0.0
            sum_v[i] = 0.0
        for k in range(4):
            acceleration(con, x, v, tau1, tau2, mass, acc, work)
            weight = h / 6.0 if k == 0 or k == 3 else h / 3.0
            ahead = h if k == 2 else 0.5 * h
            for i in range(size):
                sum_x[i] += weight * v[i]
                sum_v[i] += weight * acc[i]
                x[i] = q[i] + ahead * v[i]
                v[i] = qd[i] + ahead * acc[i]
        for i in range(size):
            q[i] += sum_x[i]
            qd[i] += sum_v[i]
    return end_deflections(con.vectors, q, qd)


@compiled
def end_deflections(
    vectors: FloatArray, q: FloatArray, qd: FloatArray
) -> tuple[float, float, float, float]:
    """Return delta1, delta2 (m) and their rates (m/s)."""
    n = vectors.shape[2]
    first, second, first_rate, second_rate = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        first += vectors[0, BEND, i] * q[2 + i]
        second += vectors[1, BEND, i] * q[2 + n + i]
        first_rate += vectors[0, BEND, i] * qd[2 + i]
        second_rate += vectors[1, BEND, i] * qd[2 + n + i]
    return first, second, first_rate, second_rate


@compiled
def energy(
    con: Constants, q: FloatArray, qd: FloatArray, mass: FloatArray, work: Work
) -> tuple[float, float]:
    """Return kinetic plus elastic energy, J, and the momentum conjugate to theta1, N m s."""
    size = q.shape[0]
    n = con.vectors.shape[2]
    mass_and_bias(con, q, qd, mass, work[3][0], work)
    kinetic, momentum = 0.0, 0.0
    for i in range(size):
        momentum += mass[i, 0] * qd[i]
        kinetic += 0.5 * mass[i, i] * qd[i] * qd[i]
        for j in range(i):
            kinetic += mass[i, j] * qd[i] * qd[j]
    elastic = 0.0
    for link in range(2):
        for i in range(n):
            at = q[2 + link * n + i]
            elastic += 0.5 * con.vectors[link, STIFFNESS, i] * at * at
    return kinetic + elastic, momentum
