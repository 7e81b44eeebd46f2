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

from functools import lru_cache
from typing import Any, Protocol

from flexarm_ros.core.arm.full.link import link_terms, terms_type
from flexarm_ros.core.arm.full.model import Constants
from flexarm_ros.core.numerics.compiled import compiled, FloatArray, internal
from flexarm_ros.core.numerics.elementary import sincos
from flexarm_ros.core.numerics.linalg import solve_upper
from flexarm_ros.core.numerics.records import record_type, Records
from flexarm_ros.core.numerics.runge_kutta import DOP853, RK4
import numpy as np

_FOURTH, _EIGHTH = (np.concatenate([method.a, [method.b]]) for method in (RK4, DOP853))


class Work(Protocol):
    """
    Scratch as a record; n = 2 + 2N.

    ``links`` (2,): the links' terms; ``reach_x``, ``reach_y`` (N,): velocity of link 1's end in
    link 2's axes per unit of each rate; ``mass`` (n, n), of which the upper triangle is used, and
    ``force`` (n,): see :func:`mass_and_bias`; ``q``, ``qd`` (n,) and ``slopes`` (stages, 2, n):
    the integrator's.
    """

    links: Any
    reach_x: FloatArray
    reach_y: FloatArray
    mass: FloatArray
    force: FloatArray
    q: FloatArray
    qd: FloatArray
    slopes: FloatArray


@lru_cache
def _work_type(modes: int) -> Any:
    size = 2 + 2 * modes
    return record_type(
        [
            ('links', terms_type(modes), (2,)),
            *((name, float, (modes,)) for name in ('reach_x', 'reach_y')),
            ('mass', float, (size, size)),
            *((name, float, (size,)) for name in ('force', 'q', 'qd')),
            ('slopes', float, (len(DOP853.b), 2, size)),
        ]
    )


def make_work(modes: int) -> Records:
    """Return the scratch of the functions of this module, ``(1,)`` record of :class:`Work`."""
    work: Records = np.zeros(1, _work_type(modes))
    return work


@compiled
def mass_and_bias(constants: Records, q: FloatArray, qd: FloatArray, work: Records) -> None:
    """
    Fill ``mass`` (upper triangle) and ``force`` of ``work``.

    M(q) and the Coriolis and centrifugal terms: M q'' + force + D q' + K q = (tau1, tau2, 0, ...).
    """
    _mass_and_bias(constants[0], q, qd, work[0])


@internal
def _mass_and_bias(con: Constants, q: FloatArray, qd: FloatArray, work: Work) -> None:
    link1, link2 = con.links[0], con.links[1]
    one, two = work.links[0], work.links[1]
    n = len(link1.mass_shape)
    second = 2 + n  # start of link 2's coordinates
    a, b = q[2:second], q[second:]
    da, db = qd[2:second], qd[second:]
    reach_x, reach_y = work.reach_x, work.reach_y
    mass, force = work.mass, work.force
    # Motion of link 1's end, in link 1's axes.
    end_x, end_y, end_dx, end_dy, shorten2 = link1.length, 0.0, 0.0, 0.0, 0.0
    turn, turn_rate = 0.0, 0.0
    for i in range(n):
        s, ds = 0.0, 0.0
        for j in range(n):
            s += link1.end_short[i, j] * a[j]
            ds += link1.end_short[i, j] * da[j]
        reach_x[i] = -s
        end_x -= 0.5 * s * a[i]
        end_dx -= s * da[i]
        shorten2 += ds * da[i]
        end_y += link1.end[i] * a[i]
        end_dy += link1.end[i] * da[i]
        turn += link1.end_slope[i] * a[i]
        turn_rate += link1.end_slope[i] * da[i]
    w1 = qd[0]
    w2 = w1 + qd[1] + turn_rate
    link_terms(link1, a, da, w1, one)
    link_terms(link2, b, db, w2, two)
    # Into link 2's axes: link 1's end velocity per unit of each rate, and the remainder.
    s, c = sincos(q[1] + turn)
    for i in range(n):
        x, y = reach_x[i], link1.end[i]
        reach_x[i] = c * x + s * y
        reach_y[i] = c * y - s * x
    base_x, base_y = s * end_x - c * end_y, c * end_x + s * end_y
    ax = -2.0 * w1 * end_dy - w1 * w1 * end_x - shorten2
    ay = 2.0 * w1 * end_dx - w1 * w1 * end_y
    rest_x, rest_y = c * ax + s * ay, c * ay - s * ax
    total = link2.mass
    # J S, the first moment turned by a right angle, and link 2's forces.
    jx, jy = -two.sy, two.sx
    inertia = two.spin_inertia
    fx = two.fx + total * rest_x
    fy = two.fy + total * rest_y
    fw = two.fw + jx * rest_x + jy * rest_y
    lever = jx * base_x + jy * base_y
    around = lever + inertia
    mass[0, 0] = con.hub[0] + one.spin_inertia + inertia + 2.0 * lever
    mass[0, 0] += total * (base_x * base_x + base_y * base_y)
    mass[0, 1] = around
    mass[1, 1] = con.hub[1] + inertia
    force[0] = one.fw + base_x * fx + base_y * fy + fw
    force[1] = fw
    for i in range(n):
        slope = link1.end_slope[i]
        carried_x, carried_y = total * reach_x[i], total * reach_y[i]
        arm = jx * reach_x[i] + jy * reach_y[i]
        turned = arm + slope * inertia
        mass[0, 2 + i] = one.h[i] + base_x * carried_x + base_y * carried_y + arm + slope * around
        mass[1, 2 + i] = turned
        force[2 + i] = one.bias[i] + reach_x[i] * fx + reach_y[i] * fy + slope * fw
        carried_x += slope * jx
        carried_y += slope * jy
        for j in range(i, n):
            mass[2 + i, 2 + j] = (
                one.flexible[j, i]
                + carried_x * reach_x[j]
                + carried_y * reach_y[j]
                + turned * link1.end_slope[j]
            )
        for k in range(n):
            mass[2 + i, second + k] = (
                reach_x[i] * two.axial[k] + reach_y[i] * link2.mass_shape[k] + slope * two.h[k]
            )
    for k in range(n):
        dx, dy, row = two.axial[k], link2.mass_shape[k], second + k
        mass[0, row] = base_x * dx + base_y * dy + two.h[k]
        mass[1, row] = two.h[k]
        force[row] = two.bias[k] + dx * rest_x + dy * rest_y
        for j in range(k, n):
            mass[row, second + j] = two.flexible[j, k]


@compiled
def acceleration(
    constants: Records,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    work: Records,
    out: FloatArray,
) -> None:
    """Fill ``out`` (2 + 2N,) with q''."""
    _acceleration(constants[0], q, qd, tau1, tau2, work[0], out)


@internal
def _acceleration(
    con: Constants,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    work: Work,
    out: FloatArray,
) -> None:
    _mass_and_bias(con, q, qd, work)
    n = len(work.reach_x)
    out[0] = tau1 - work.force[0]
    out[1] = tau2 - work.force[1]
    for link in range(2):
        own = con.links[link]
        for i in range(n):
            k = 2 + link * n + i
            out[k] = -work.force[k] - own.stiffness[i] * q[k] - own.damping[i] * qd[k]
    solve_upper(work.mass, out)


@compiled
def step(
    constants: Records,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    h: float,
    substeps: int,
    order: int,
    work: Records,
) -> tuple[float, float, float, float]:
    """
    Advance ``q`` and ``qd`` (2 + 2N,) in place by ``substeps`` Runge-Kutta steps of h seconds.

    The interface of a tick for compiled callers: the state, the torques (N m, held), the arm's
    parameters as a record ``(1,)`` of :class:`Constants`, the steps (``order`` 4 or 8, see
    :mod:`flexarm_ros.core.numerics.runge_kutta`), and scratch of :func:`make_work`.  Returns
    :func:`end_deflections` of the new state.
    """
    stages = _EIGHTH if order == DOP853.order else _FOURTH
    for _ in range(substeps):
        _advance(constants[0], q, qd, tau1, tau2, h, stages, work[0])
    return end_deflections(constants, q, qd)


@internal
def _advance(
    con: Constants,
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    h: float,
    stages: FloatArray,
    work: Work,
) -> None:
    """Take one explicit Runge-Kutta step; ``stages`` (s + 1, s): the rows of a, then b."""
    count, x, v, slopes = stages.shape[1], work.q[:], work.qd[:], work.slopes
    for stage in range(count):
        _combine(q, qd, h, stages[stage], stage, work)
        for i in range(len(v)):
            slopes[stage, 0, i] = v[i]
        _acceleration(con, x, v, tau1, tau2, work, slopes[stage, 1])
    _combine(q, qd, h, stages[count], count, work)
    for i in range(len(v)):
        q[i], qd[i] = x[i], v[i]


@internal
def _combine(
    q: FloatArray, qd: FloatArray, h: float, weights: FloatArray, count: int, work: Work
) -> None:
    """Set ``q`` and ``qd`` of ``work`` to the state plus h times the weighted slopes."""
    size = len(work.force)
    for i in range(size):
        work.q[i], work.qd[i] = 0.0, 0.0
    for r in range(count):
        weight = h * weights[r]
        if weight != 0.0:
            for i in range(size):
                work.q[i] += weight * work.slopes[r, 0, i]
                work.qd[i] += weight * work.slopes[r, 1, i]
    for i in range(size):
        work.q[i] += q[i]
        work.qd[i] += qd[i]


@compiled
def end_deflections(
    constants: Records, q: FloatArray, qd: FloatArray
) -> tuple[float, float, float, float]:
    """Return delta1, delta2 (m) and their rates (m/s)."""
    link1, link2 = constants[0].links[0], constants[0].links[1]
    n = len(link1.end)
    first, second, first_rate, second_rate = 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        first += link1.flexible_end[i] * q[2 + i]
        second += link2.flexible_end[i] * q[2 + n + i]
        first_rate += link1.flexible_end[i] * qd[2 + i]
        second_rate += link2.flexible_end[i] * qd[2 + n + i]
    return first, second, first_rate, second_rate


@compiled
def energy(
    constants: Records, q: FloatArray, qd: FloatArray, work: Records
) -> tuple[float, float]:
    """Return kinetic plus elastic energy, J, and the momentum conjugate to theta1, N m s."""
    con, mass = constants[0], work[0].mass
    _mass_and_bias(con, q, qd, work[0])
    kinetic, momentum = 0.0, 0.0
    for i in range(len(mass)):
        momentum += mass[0, i] * qd[i]
        kinetic += 0.5 * mass[i, i] * qd[i] * qd[i]
        for j in range(i):
            kinetic += mass[j, i] * qd[i] * qd[j]
    elastic = 0.0
    n = len(con.links[0].stiffness)
    for link in range(2):
        for i in range(n):
            at = q[2 + link * n + i]
            elastic += 0.5 * con.links[link].stiffness[i] * at * at
    return kinetic + elastic, momentum
