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
The optimal flexible trajectory: torques and states that move the true tip along the reference.

Of all motions of the model from its start, straight and at rest, this one minimises

    sum over knots of H (w_p |tip - ref|^2 + w_u |u|^2 + w_r |u'|^2 + w_x |beyond|^2)

with torques u that are linear between knots, H seconds apart, and ``beyond`` their excess over a
limit.  The arm's tip is a nonminimum phase output: exact inversion would need torques before the
start of the motion (Devasia, Chen and Paden, IEEE TAC 41, 1996).  The minimum over the complete,
known path is the causal solution: bounded, with preview of every corner, and as close as a start
from rest allows.

Method: Gauss-Newton differential dynamic programming (Li and Todorov, ICINCO 2004): linearise
along the motion, solve the linear-quadratic problem by a Riccati recursion, simulate the
nonlinear model with its feedback, repeat.  The result is a motion of the plant's own integrator,
tick by tick, so that the law's model and the plant agree to rounding if their parameters do.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.arm.full.dynamics import step
from flexarm_ros.core.control.design.model import (
    Arm,
    interval_matrices,
    linearise,
    point_jacobian,
)
from flexarm_ros.core.numerics.compiled import allocating, FloatArray, internal
from flexarm_ros.core.numerics.linalg import (
    add_outer,
    gains_of_two,
    multiply,
    symmetrise,
    transpose_multiply,
    transpose_times,
)
import numpy as np

_ENOUGH = 1e-4
"""The plan has converged when an iteration lowers its cost by less than this fraction."""

_LEAST_SHARE = 1e-2
_FIRMER = 100.0


class Weights(NamedTuple):
    """Weights per m^2, (N m)^2, (N m/s)^2; ``limit`` (N m, 0: none), per (N m)^2 of excess."""

    tip: float
    torque: float
    rate: float
    limit: float
    excess: float


class Grid(NamedTuple):
    """An interval is ``ticks`` ticks, each of ``substeps`` steps of ``step`` s, of ``order``."""

    ticks: int
    substeps: int
    step: float
    order: int


class Motion(NamedTuple):
    """A motion at K + 1 knots: ``state`` (K + 1, 2n), ``torque`` (K + 1, 2), ``rate`` (K, 2)."""

    state: FloatArray
    torque: FloatArray
    rate: FloatArray


class Policy(NamedTuple):
    """Torque rates at a knot: ``feedback`` (K, 2, 2n + 2) on (x, u) and ``change`` (K, 2)."""

    feedback: FloatArray
    change: FloatArray


@allocating
def advance(
    arm: Arm, state: FloatArray, torque: FloatArray, rate: FloatArray, grid: Grid,
    dense: FloatArray,
) -> None:  # fmt: skip
    """
    Integrate ``state`` (2n,) over one interval; ``dense`` (ticks, 2n + 2): each tick's start.

    The last two columns of ``dense`` are the tick's torque, that of its middle.
    """
    n = state.shape[0] // 2
    for i in range(grid.ticks):
        time = (i + 0.5) * grid.substeps * grid.step
        tau1, tau2 = torque[0] + rate[0] * time, torque[1] + rate[1] * time
        if dense.shape[0] > 0:
            dense[i, : 2 * n] = state
            dense[i, 2 * n], dense[i, 2 * n + 1] = tau1, tau2
        step(
            arm.con, state[:n], state[n:], tau1, tau2, grid.step, grid.substeps, grid.order,
            arm.work,
        )  # fmt: skip


@internal
def knot_cost(
    arm: Arm, state: FloatArray, torque: FloatArray, at: FloatArray, weights: Weights,
    jacobian: FloatArray,
) -> float:  # fmt: skip
    """Return the cost rate at a knot without that of its torque rate."""
    n = state.shape[0] // 2
    x, y = point_jacobian(arm.tip, state[:n], jacobian)
    dx, dy = x - at[0], y - at[1]
    cost: float = weights.tip * (dx * dx + dy * dy)
    for c in range(2):
        cost += weights.torque * torque[c] * torque[c]
        if weights.limit > 0.0:
            over = max(abs(torque[c]) - weights.limit, 0.0)
            cost += weights.excess * over * over
    return cost


@allocating
def roll_out(
    arm: Arm, path: FloatArray, weights: Weights, grid: Grid, old: Motion, policy: Policy,
    share: float, new: Motion,
) -> float:  # fmt: skip
    """Simulate ``old`` with ``share`` of the policy's change and feedback; return the cost."""
    count, size = old.rate.shape[0], old.state.shape[1]
    jacobian, none = np.zeros((2, size // 2)), np.zeros((0, size))
    spacing = grid.ticks * grid.substeps * grid.step
    at, tau = old.state[0].copy(), old.torque[0].copy()
    total = 0.0
    for j in range(count + 1):
        new.state[j], new.torque[j] = at, tau
        total += spacing * knot_cost(arm, at, tau, path[j], weights, jacobian)
        if not total < 1e12:
            return np.inf
        if j == count:
            break
        for c in range(2):
            value = old.rate[j, c] + share * policy.change[j, c]
            for i in range(size):
                value += policy.feedback[j, c, i] * (at[i] - old.state[j, i])
            for i in range(2):
                value += policy.feedback[j, c, size + i] * (tau[i] - old.torque[j, i])
            new.rate[j, c] = value
            total += spacing * weights.rate * value * value
        advance(arm, at, tau, new.rate[j], grid, none)
        for c in range(2):
            tau[c] += spacing * new.rate[j, c]
    return total


@internal
def add_knot_cost(
    arm: Arm, state: FloatArray, torque: FloatArray, at: FloatArray, weights: Weights,
    spacing: float, jacobian: FloatArray, value: FloatArray, slope: FloatArray,
) -> None:  # fmt: skip
    """Add a knot's second-order cost to ``value`` (2n + 2, 2n + 2) and ``slope`` (2n + 2,)."""
    size = state.shape[0]
    n = size // 2
    x, y = point_jacobian(arm.tip, state[:n], jacobian)
    factor = 2.0 * spacing * weights.tip
    for i in range(n):
        slope[i] += factor * (jacobian[0, i] * (x - at[0]) + jacobian[1, i] * (y - at[1]))
    add_outer(jacobian, factor, value)
    for c in range(2):
        tau = torque[c]
        slope[size + c] += 2.0 * spacing * weights.torque * tau
        value[size + c, size + c] += 2.0 * spacing * weights.torque
        over = abs(tau) - weights.limit
        if weights.limit > 0.0 and over > 0.0:
            sign = 1.0 if tau > 0.0 else -1.0
            slope[size + c] += 2.0 * spacing * weights.excess * over * sign
            value[size + c, size + c] += 2.0 * spacing * weights.excess


@allocating
def improve(
    arm: Arm, path: FloatArray, weights: Weights, grid: Grid, motion: Motion, policy: Policy
) -> None:
    """Fill ``policy`` with the solution of the linear-quadratic problem about ``motion``."""
    count, size = motion.rate.shape[0], motion.state.shape[1]
    both, period = size + 2, grid.substeps * grid.step
    spacing = grid.ticks * period
    jacobian, rows = np.zeros((2, size // 2)), np.zeros((size // 2, both))
    value, slope, moved = np.zeros((both, both)), np.zeros(both), np.zeros(both)
    transition, drive = np.zeros((both, both)), np.zeros((both, 2))
    ahead, ahead_drive = np.zeros((both, both)), np.zeros((both, 2))
    cross, inner, lead = np.zeros((2, both)), np.zeros((2, 2)), np.zeros(2)
    for j in range(count, -1, -1):
        tau = motion.torque[j]
        if j < count:
            linearise(arm, motion.state[j], tau[0], tau[1], rows)
            interval_matrices(rows, grid.ticks, period, transition, drive)
            multiply(value, transition, ahead)
            multiply(value, drive, ahead_drive)
            transpose_multiply(drive, ahead, cross)
            transpose_multiply(drive, ahead_drive, inner)
            transpose_times(drive, slope, lead)
            for c in range(2):
                lead[c] += 2.0 * spacing * weights.rate * motion.rate[j, c]
                inner[c, c] += 2.0 * spacing * weights.rate
            gains_of_two(inner, cross, lead, policy.feedback[j], policy.change[j])
            transpose_multiply(transition, ahead, value)
            transpose_times(transition, slope, moved)
            for i in range(both):
                slope[i] = moved[i]
                for c in range(2):
                    slope[i] += cross[c, i] * policy.change[j, c]
                    for k in range(both):
                        value[i, k] += cross[c, i] * policy.feedback[j, c, k]
            symmetrise(value)
        add_knot_cost(
            arm, motion.state[j], tau, path[j], weights, spacing, jacobian, value, slope
        )  # fmt: skip


def make_plan(
    arm: Arm, path: FloatArray, weights: Weights, grid: Grid, guess: FloatArray, rounds: int
) -> Motion:
    """
    Return the optimal motion along ``path`` (K + 1, 2) from the first row of ``guess``.

    ``guess`` (K + 1, 2n): states for the first linearisation, not necessarily a motion of the
    model.  A limit is enforced in two stages; the second starts from the first one's motion
    with a weight ``_FIRMER`` times as large.
    """
    motion = Motion(guess.copy(), np.zeros((len(guess), 2)), np.zeros((len(guess) - 1, 2)))
    motion = _converge(arm, path, weights, grid, motion, rounds, feasible=False)
    if weights.limit > 0.0 and np.max(np.abs(motion.torque)) > weights.limit:
        firm = weights._replace(excess=_FIRMER * weights.excess)
        motion = _converge(arm, path, firm, grid, motion, rounds, feasible=True)
    return motion


def _converge(
    arm: Arm,
    path: FloatArray,
    weights: Weights,
    grid: Grid,
    motion: Motion,
    rounds: int,
    feasible: bool,
) -> Motion:
    """Improve ``motion`` until it converges; it need not be ``feasible``."""
    new = Motion(*(part.copy() for part in motion))
    count, size = len(motion.rate), motion.state.shape[1]
    policy = Policy(np.zeros((count, 2, size + 2)), np.zeros((count, 2)))
    cost = np.inf
    if feasible:
        cost = roll_out(arm, path, weights, grid, motion, policy, 0.0, new)
    for _ in range(rounds):
        improve(arm, path, weights, grid, motion, policy)
        share = 1.0
        found = roll_out(arm, path, weights, grid, motion, policy, share, new)
        while not found < cost and share > _LEAST_SHARE:
            share *= 0.5
            found = roll_out(arm, path, weights, grid, motion, policy, share, new)
        if not found < cost:
            break
        fall, cost = cost - found, found
        motion, new = new, motion
        if fall < _ENOUGH * cost:
            break
    return motion


@allocating
def fill_ticks(arm: Arm, grid: Grid, motion: Motion, dense: FloatArray) -> None:
    """Fill ``dense`` (K ticks + 1, 2n + 2): state and torque of the plan at each tick."""
    at = motion.state[0].copy()
    size, count = at.shape[0], motion.rate.shape[0]
    for j in range(count):
        first = j * grid.ticks
        end = first + grid.ticks
        advance(arm, at, motion.torque[j], motion.rate[j], grid, dense[first:end])
    dense[count * grid.ticks, :size] = at
    dense[count * grid.ticks, size:] = motion.torque[count]
