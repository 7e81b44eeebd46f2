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
Compiled motion of an arm with Coulomb friction, drives with backlash and a force at the tip.

Events are located, not smoothed.  Between events every joint has one *mode* and the equations are
smooth, so that the classical Runge-Kutta method keeps its fourth order; a step that ends outside
its modes is cut at the event by a bracketed secant (Illinois) search, the state is set exactly
onto the event, the modes are chosen anew and the rest of the step is integrated.  Scheme:
Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I (1993), II.6; Piiroinen and
Kuznetsov, ACM TOMS 34 (2008), for dry friction.

*Coulomb friction.*  A sliding joint has the friction torque against its rate.  A joint at rest
sticks: its acceleration is a constraint, theta'' = 0, and the friction torque is the constraint's,
as long as it stays within the breakaway torques of both directions (Karnopp's stick state, J.
Dyn. Sys. Meas. Control 107, 1985, but with the exact constraint instead of a velocity band).  A
sticking joint does not move at all.  The modes of joints at rest are those that satisfy all
conditions together; there is exactly one such motion, since friction with given normal force
derives from a convex potential and M is positive definite (Moreau; Glocker, Set-Valued Force Laws,
2001).

*Backlash.*  The drive, with its share of the hub inertia, is free within a gap; at its ends it
pushes the joint (one-sided contact) until the contact torque would pull.  Closing the gap is a
plastic impact, which conserves momentum and loses energy.

*Bandwidth.*  The drive's torque follows its set point as a first-order lag, exactly.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from flexarm_ros.core.arm.driven.terms import terms
from flexarm_ros.core.arm.kinematics import elastic_point
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
from flexarm_ros.core.numerics.elementary import exp
from flexarm_ros.core.numerics.linalg import solve_symmetric
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]

STICK, SMOOTH = 0, 2
"""Friction modes beside +1 and -1, sliding in that direction; SMOOTH: no Coulomb friction."""

FREE, BOUND = 0, 2
"""Contact modes beside +1 and -1, drive at that end of its gap; BOUND: no backlash."""

MOST_EVENTS = 10
"""Events that are located per integration step.

A drive may bounce off its joint ever faster, as a ball does that comes to rest; the rest of such a
sequence is replaced by one plastic impact at the end of the step.
"""

_SEARCHES = 100
_TIME_TOLERANCE = 2.0**-42  # of a step
_FORCE_TOLERANCE = 1e-9  # of the torques at a joint
_GAP_TOLERANCE = 1e-9  # of half the gap
# Rate, rad/s, below which a drive does not leave its contact by an impact: else two drives whose
# impacts loosen one another would take turns in the gap's tolerance, without end.
_RESTING = 1e-5


class Rig(NamedTuple):
    """
    Constants of joints and drives; first axis: the joint.

    ``friction`` ``(2, 2)``: Coulomb friction (N m) of positive and of negative rates.  ``hub``
    ``(2,)``: inertia (kg m^2) of drives with backlash, 0 otherwise; ``gap`` ``(2,)``: half their
    backlash, rad.  ``rate`` ``(2,)``: 1/s, of the drive's lag; 0: none.  ``shapes`` and
    ``shortening``: of the tip, see `flexarm_ros.core.arm.kinematics.elastic_point`.
    """

    friction: FloatArray
    hub: FloatArray
    gap: FloatArray
    rate: FloatArray
    shapes: FloatArray
    shortening: FloatArray


class Scratch(NamedTuple):
    """
    Arrays for n coordinates and two drives; see `make_scratch`.

    ``modes`` (5,): friction, then contact, of both joints; the number of events in the last tick.
    """

    mass: FloatArray
    rows: FloatArray
    force: FloatArray
    stages: FloatArray
    torque: FloatArray
    reaction: FloatArray
    push: FloatArray
    modes: IntArray
    tried: IntArray


def make_scratch(n: int) -> Scratch:
    """Return scratch arrays."""
    return Scratch(
        np.zeros((n, n)), np.zeros((2, n)), np.zeros((2, n)), np.zeros((12, n + 2)), np.zeros(2),
        np.zeros(4), np.zeros(2), np.zeros(5, np.int64), np.zeros(4, np.int64),
    )  # fmt: skip


def end_acceleration(s: Scratch) -> FloatArray:
    """Return where `step_driven` leaves the accelerations at its end, (n + 2,)."""
    found: FloatArray = s.stages[6]
    return found


@internal
def drive_torque(
    rig: Rig, start: FloatArray, target: FloatArray, time: float, out: FloatArray
) -> None:
    """Fill ``out`` (2,) with the drives' torques ``time`` s after they were ``start``."""
    for j in range(2):
        fall = exp(-rig.rate[j] * time) if rig.rate[j] > 0.0 else 0.0
        out[j] = target[j] + (start[j] - target[j]) * fall


@internal
def _assemble(model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, s: Scratch) -> None:
    """Fill ``s.mass`` and ``s.force[1]`` without drives and Coulomb friction."""
    n = pos.shape[0] - 2
    q, force = pos[:n], s.force[1]
    terms(model, q, vel[:n], s.mass, force)
    if s.push[0] != 0.0 or s.push[1] != 0.0:
        # Virtual work: the tip's velocity per unit of each rate.
        unit = s.stages[11, :n]
        for i in range(n):
            unit[i] = 0.0
        for i in range(n):
            unit[i] = 1.0
            _, _, vx, vy = elastic_point(q, unit, rig.shapes, rig.shortening)
            unit[i] = 0.0
            force[i] += vx * s.push[0] + vy * s.push[1]


@internal
def accelerate(
    model: Any, rig: Rig, modes: IntArray, pos: FloatArray, vel: FloatArray, torque: FloatArray,
    acc: FloatArray, s: Scratch,
) -> None:  # fmt: skip
    """
    Fill ``acc`` (n + 2,) of coordinates and drives in these ``modes``.

    ``s.reaction`` (4,): the friction torque that a sticking joint needs, then the torque that a
    drive in contact passes on; N m, of both joints.
    """
    _assemble(model, rig, pos, vel, s)
    _solve(rig, modes, torque, acc, s)


@internal
def _solve(rig: Rig, modes: IntArray, torque: FloatArray, acc: FloatArray, s: Scratch) -> None:
    """Solve for the accelerations and reactions; changes ``s.mass`` and ``s.force``."""
    n = acc.shape[0] - 2
    _load_joints(rig, modes, torque, acc, s)
    for i in range(n):
        acc[i] = s.force[1, i]
    for j in range(2):
        if modes[j] == STICK:
            _fix_joint(j, s.mass, acc[:n])
    solve_symmetric(s.mass, acc[:n])
    for j in range(2):
        s.reaction[j] = -s.force[1, j]
        if modes[j] == STICK:
            acc[j] = 0.0
            for k in range(n):
                s.reaction[j] += s.rows[j, k] * acc[k]
        s.reaction[2 + j] = torque[j]
        if modes[2 + j] != FREE:
            acc[n + j] = acc[j]
            s.reaction[2 + j] = torque[j] - rig.hub[j] * acc[j]


@internal
def _load_joints(
    rig: Rig, modes: IntArray, torque: FloatArray, acc: FloatArray, s: Scratch
) -> None:
    """Add drives and friction of sliding joints; fill ``s.rows``, the joints' rows of M."""
    n = acc.shape[0] - 2
    mass, force = s.mass, s.force[1]
    for j in range(2):
        if modes[2 + j] == FREE:
            mass[j, j] -= rig.hub[j]
            acc[n + j] = torque[j] / rig.hub[j]
        else:
            force[j] += torque[j]
        if modes[j] == 1:
            force[j] -= rig.friction[j, 0]
        elif modes[j] == -1:
            force[j] += rig.friction[j, 1]
        for k in range(n):
            s.rows[j, k] = mass[k, j] if k >= j else mass[j, k]


@internal
def _fix_joint(j: int, mass: FloatArray, force: FloatArray) -> None:
    """Make the equation of joint ``j`` theta'' = 0."""
    for k in range(j):
        mass[j, k] = 0.0
    for k in range(j + 1, force.shape[0]):
        mass[k, j] = 0.0
    mass[j, j] = 1.0
    force[j] = 0.0


@internal
def _margin(
    rig: Rig, modes: IntArray, pos: FloatArray, vel: FloatArray, torque: FloatArray, s: Scratch
) -> float:
    """Return by how much the state is within its modes; negative: an event has happened."""
    n = pos.shape[0] - 2
    least = math.inf
    for j in range(2):
        if modes[j] == STICK:
            slack = _FORCE_TOLERANCE * (rig.friction[j, 0] + rig.friction[j, 1])
            least = min(least, s.reaction[j] + rig.friction[j, 0] + slack)
            least = min(least, rig.friction[j, 1] - s.reaction[j] + slack)
        elif modes[j] != SMOOTH:
            least = min(least, modes[j] * vel[j])
        if modes[2 + j] == FREE:
            # Written as in `_side`: at an end of the gap a rounding error must be no event.
            slack = _GAP_TOLERANCE * rig.gap[j]
            least = min(least, pos[j] + rig.gap[j] - pos[n + j] + slack)
            least = min(least, pos[n + j] - (pos[j] - rig.gap[j]) + slack)
        elif modes[2 + j] != BOUND:
            slack = _FORCE_TOLERANCE * abs(torque[j])
            least = min(least, modes[2 + j] * s.reaction[2 + j] + slack)
    return least


@internal
def _runge_kutta(
    model: Any, rig: Rig, start: FloatArray, target: FloatArray, time: float, h: float,
    pos: FloatArray, vel: FloatArray, acc: FloatArray, s: Scratch,
) -> float:  # fmt: skip
    """
    Take one step of ``h`` s in the modes ``s.modes`` from ``time`` s after the tick's start.

    ``acc`` is the acceleration there.  The new state and its acceleration are ``s.stages[0:3]``.
    Returns its margin.
    """
    size = pos.shape[0]
    x, v, a, sum_x, sum_v = s.stages[0], s.stages[1], s.stages[2], s.stages[3], s.stages[4]
    for i in range(size):
        sum_x[i] = vel[i]
        sum_v[i] = acc[i]
        x[i] = pos[i] + 0.5 * h * vel[i]
        v[i] = vel[i] + 0.5 * h * acc[i]
    drive_torque(rig, start, target, time + 0.5 * h, s.torque)
    for k in range(2):
        accelerate(model, rig, s.modes, x, v, s.torque, a, s)
        ahead = h if k == 1 else 0.5 * h
        for i in range(size):
            sum_x[i] += 2.0 * v[i]
            sum_v[i] += 2.0 * a[i]
            x[i] = pos[i] + ahead * v[i]
            v[i] = vel[i] + ahead * a[i]
    drive_torque(rig, start, target, time + h, s.torque)
    accelerate(model, rig, s.modes, x, v, s.torque, a, s)
    for i in range(size):
        x[i] = pos[i] + h / 6.0 * (sum_x[i] + v[i])
        v[i] = vel[i] + h / 6.0 * (sum_v[i] + a[i])
    _hold(rig, s.modes, x, v)
    accelerate(model, rig, s.modes, x, v, s.torque, a, s)
    return _margin(rig, s.modes, x, v, s.torque, s)


@internal
def _hold(rig: Rig, modes: IntArray, pos: FloatArray, vel: FloatArray) -> None:
    """Set drives in contact exactly to their end of the gap."""
    n = pos.shape[0] - 2
    for j in range(2):
        if modes[2 + j] != FREE:
            side = 0 if modes[2 + j] == BOUND else modes[2 + j]
            pos[n + j] = pos[j] + side * rig.gap[j]
            vel[n + j] = vel[j]


@internal
def _side(rig: Rig, pos: FloatArray, j: int) -> int:
    """Return at which end of its gap a drive is; 0: between them."""
    n = pos.shape[0] - 2
    if pos[n + j] >= pos[j] + rig.gap[j]:
        return 1
    return -1 if pos[n + j] <= pos[j] - rig.gap[j] else 0


@internal
def _impacts(model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, s: Scratch) -> None:
    """
    Let drives that run into the end of their gap take their joints along.

    ``s.tried[2:]``: 1 for a drive that moves with its joint afterwards.  A drive that was already
    in contact stays so if the impulse presses it, and is left behind otherwise; one that is nearly
    as fast as its joint counts as in contact.
    """
    n = pos.shape[0] - 2
    hit = False
    for j in range(2):
        side = _side(rig, pos, j) if rig.hub[j] > 0.0 else 0
        closing = side * (vel[n + j] - vel[j])
        s.tried[2 + j] = 1 if side != 0 and closing > -_RESTING else 0
        hit = hit or (s.tried[2 + j] == 1 and closing != 0.0)
    if not hit:
        return
    joined = s.stages[5, :n]
    _join(model, rig, pos, vel, joined, s)
    for j in range(2):
        resting = s.tried[2 + j] == 1 and abs(vel[n + j] - vel[j]) <= _RESTING
        if resting and _side(rig, pos, j) * (vel[n + j] - joined[j]) < -_RESTING:
            s.tried[2 + j] = 0
            _join(model, rig, pos, vel, joined, s)
    for i in range(n):
        vel[i] = joined[i]
    for j in range(2):
        if s.tried[2 + j] == 1:
            pos[n + j] = pos[j] + _side(rig, pos, j) * rig.gap[j]
            vel[n + j] = vel[j]


@internal
def _join(
    model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, joined: FloatArray, s: Scratch
) -> None:
    """Fill ``joined`` (n,) with the rates after drives ``s.tried[2:]`` took joints along."""
    n = pos.shape[0] - 2
    _momentum(model, rig, pos, vel, joined, s)
    for j in range(2):
        if s.tried[2 + j] == 1:
            joined[j] += rig.hub[j] * vel[n + j]
        else:
            s.mass[j, j] -= rig.hub[j]
    solve_symmetric(s.mass, joined)


@allocating
def settle(
    model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, torque: FloatArray, acc: FloatArray,
    s: Scratch,
) -> None:  # fmt: skip
    """
    Choose the modes ``s.modes`` of this state and fill ``acc``, after impacts where gaps close.

    Moving joints slide and drives within their gaps are free; of the others every combination is
    tried, first that all stick and stay in contact, until one satisfies all conditions.
    """
    n = pos.shape[0] - 2
    _impacts(model, rig, pos, vel, s)
    _impacts(model, rig, pos, vel, s)
    counts = np.ones(4, np.int64)
    for j in range(2):
        s.modes[j] = SMOOTH
        if rig.friction[j, 0] > 0.0 or rig.friction[j, 1] > 0.0:
            s.modes[j] = 1 if vel[j] > 0.0 else -1
            counts[j] = 3 if vel[j] == 0.0 else 1
        s.modes[2 + j] = BOUND
        if rig.hub[j] > 0.0:
            side = _side(rig, pos, j)
            s.modes[2 + j] = side
            if side != 0:
                together = vel[n + j] == vel[j]
                counts[2 + j] = 2 if together else 1
                s.modes[2 + j] = side if together else FREE
    best, least = -1, -math.inf
    total = counts[0] * counts[1] * counts[2] * counts[3]
    for trial in range(total):
        found = _try(model, rig, pos, vel, torque, acc, counts, trial, s)
        if found >= 0.0:
            best = trial
            break
        if found > least:
            best, least = trial, found
    if total > 1 and best != trial:
        _try(model, rig, pos, vel, torque, acc, counts, best, s)
    for m in range(4):
        s.modes[m] = s.tried[m]
    _hold(rig, s.modes, pos, vel)


@internal
def _try(
    model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, torque: FloatArray, acc: FloatArray,
    counts: IntArray, trial: int, s: Scratch,
) -> float:  # fmt: skip
    """
    Accelerate in combination number ``trial`` of the modes that are open.

    Returns a number below 0, N m, for conditions that are not met.
    """
    n = pos.shape[0] - 2
    rest = trial
    for m in range(4):
        option = rest % counts[m]
        rest //= counts[m]
        s.tried[m] = s.modes[m]
        if m < 2 and counts[m] == 3:
            s.tried[m] = STICK if option == 0 else 3 - 2 * option
        elif m >= 2 and option == 1:
            s.tried[m] = FREE
    accelerate(model, rig, s.tried, pos, vel, torque, acc, s)
    least = 0.0
    for j in range(2):
        if counts[j] == 3 and s.tried[j] == STICK:
            slack = _FORCE_TOLERANCE * (rig.friction[j, 0] + rig.friction[j, 1])
            least = min(least, s.reaction[j] + rig.friction[j, 0] + slack)
            least = min(least, rig.friction[j, 1] - s.reaction[j] + slack)
        elif counts[j] == 3:
            least = min(least, s.tried[j] * acc[j] * s.rows[j, j])
        if counts[2 + j] == 2:
            side = s.modes[2 + j]
            if s.tried[2 + j] == FREE:
                least = min(least, side * (acc[j] - acc[n + j]) * rig.hub[j])
            else:
                slack = _FORCE_TOLERANCE * abs(torque[j])
                least = min(least, side * s.reaction[2 + j] + slack)
    return least


@compiled
def impulse(
    before: Any, after: Any, rig: Rig, pos: FloatArray, vel: FloatArray, s: Scratch
) -> None:
    """
    Change the rates as masses at rest are caught: M of ``after`` times them is that of before.

    Drives with backlash keep their rates; where they then press, they follow by impacts.
    """
    n = pos.shape[0] - 2
    momentum = s.stages[5, :n]
    _momentum(before, rig, pos, vel, momentum, s)
    _assemble(after, rig, pos, vel, s)
    for j in range(2):
        s.mass[j, j] -= rig.hub[j]
    solve_symmetric(s.mass, momentum)
    for i in range(n):
        vel[i] = momentum[i]
    for j in range(2):
        if rig.hub[j] == 0.0:
            vel[n + j] = vel[j]


@internal
def _momentum(
    model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, out: FloatArray, s: Scratch
) -> None:
    """Fill ``s.mass`` and ``out`` (n,), M times the rates, without drives that have backlash."""
    n = pos.shape[0] - 2
    _assemble(model, rig, pos, vel, s)
    for i in range(n):
        out[i] = 0.0
        for k in range(n):
            out[i] += (s.mass[i, k] if i >= k else s.mass[k, i]) * vel[k]
    for j in range(2):
        out[j] -= rig.hub[j] * vel[j]


@compiled
def step_driven(
    model: Any, rig: Rig, pos: FloatArray, vel: FloatArray, start: FloatArray, target: FloatArray,
    step: float, substeps: int, s: Scratch,
) -> None:  # fmt: skip
    """
    Advance ``pos`` and ``vel`` ``(n + 2,)`` by ``substeps`` steps of ``step`` s.

    The last two entries are the drives', rad.  ``start`` (2,): torques of the drives, N m, which
    become those at the end; ``target`` (2,): their set point.  ``s.push``: force at the tip, N.
    """
    size = pos.shape[0]
    acc = s.stages[6]
    s.modes[4] = 0
    drive_torque(rig, start, target, 0.0, s.torque)
    settle(model, rig, pos, vel, s.torque, acc, s)
    for k in range(substeps):
        left = step
        for event in range(MOST_EVENTS):
            time = k * step + (step - left)
            margin = _runge_kutta(model, rig, start, target, time, left, pos, vel, acc, s)
            cut = left
            if margin < 0.0 and event < MOST_EVENTS - 1:
                cut = _locate(model, rig, start, target, time, left, margin, pos, vel, acc, s)
            left -= cut
            for i in range(size):
                pos[i], vel[i], acc[i] = s.stages[0, i], s.stages[1, i], s.stages[2, i]
            if margin >= 0.0:
                break
            s.modes[4] += 1
            _onto_event(rig, pos, vel, s)
            settle(model, rig, pos, vel, s.torque, acc, s)
            if left <= 0.0:
                break
    drive_torque(rig, start, target, substeps * step, s.torque)
    start[0], start[1] = s.torque[0], s.torque[1]


@internal
def _locate(
    model: Any, rig: Rig, start: FloatArray, target: FloatArray, time: float, h: float,
    margin: float, pos: FloatArray, vel: FloatArray, acc: FloatArray, s: Scratch,
) -> float:  # fmt: skip
    """
    Take the shortest step, up to ``h`` s, whose margin is negative; return its length.

    The Illinois method: the secant through both ends of the bracket, with the value of an end
    that has stayed twice halved.
    """
    low, high, at_low, at_high, last = 0.0, h, 0.0, margin, 0
    for _ in range(_SEARCHES):
        if high - low <= _TIME_TOLERANCE * h:
            break
        width = high - low
        middle = low + 0.5 * width
        if at_low > 0.0:
            middle = low + width * (at_low / (at_low - at_high))
        middle = min(max(middle, low + 0.01 * width), high - 0.01 * width)
        found = _runge_kutta(model, rig, start, target, time, middle, pos, vel, acc, s)
        if found < 0.0:
            high, at_high = middle, found
            if last == -1:
                at_low *= 0.5
            last = -1
        else:
            low, at_low = middle, found
            if last == 1:
                at_high *= 0.5
            last = 1
    _runge_kutta(model, rig, start, target, time, high, pos, vel, acc, s)
    return high


@internal
def _onto_event(rig: Rig, pos: FloatArray, vel: FloatArray, s: Scratch) -> None:
    """Stop joints that have come to rest, and set drives to the end of the gap they are beyond."""
    n = pos.shape[0] - 2
    for j in range(2):
        if s.modes[j] == 1 and vel[j] < 0.0 or s.modes[j] == -1 and vel[j] > 0.0:
            vel[j] = 0.0
            if s.modes[2 + j] != FREE:
                vel[n + j] = 0.0
        if s.modes[2 + j] == FREE:
            side = _side(rig, pos, j)
            if side != 0:
                pos[n + j] = pos[j] + side * rig.gap[j]
