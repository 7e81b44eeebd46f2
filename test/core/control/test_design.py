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

"""What the planning laws are computed from, against SciPy and against the plant itself."""

from __future__ import annotations

from dataclasses import replace

from flexarm_ros import scenario
from flexarm_ros.core.arm.full.dynamics import acceleration, step
from flexarm_ros.core.arm.full.model import floats, link_bases, make_constants_on
from flexarm_ros.core.control.design import model
from flexarm_ros.core.control.design.filter import fill_filter, FilterModel, UNKNOWNS
from flexarm_ros.core.control.design.motion import APART, around, make_arm, model_of
from flexarm_ros.core.control.design.plan import Grid, Motion
from flexarm_ros.core.control.design.regulator import fill_regulator, RegulatorWeights
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

N = 8
PERIOD = 0.001
PLANT = model_of(scenario.load('lqg_smooth'))
ARM = make_arm(PLANT, 9.0)


def state_at(seed: int) -> np.ndarray:
    """Return a bent, moving arm."""
    draw = np.random.default_rng(seed)
    state = np.concatenate([draw.uniform(-0.05, 0.05, N), draw.uniform(-0.3, 0.3, N)])
    state[:2] = draw.uniform(0.3, 2.0, 2)
    return state


def carried(state: np.ndarray, period: float) -> np.ndarray:
    """``period`` s of the plant, in steps so small that the integrator's error does not show."""
    after = state.copy()
    step(ARM.con, after[:N], after[N:], 20.0, -10.0, period / 20, 20, 4, ARM.work)
    return after


def linear_error(state: np.ndarray, period: float) -> float:
    """How far the tick linearised about its middle is from differences of the plant's tick."""
    rows, ad, bd = np.zeros((N, 2 * N + 2)), np.zeros((2 * N, 2 * N)), np.zeros((2 * N, 2))
    model.linearise(ARM, carried(state, 0.5 * period), 20.0, -10.0, rows)
    model.discretise(rows, period, ad, bd)
    nudges = 1e-5 * np.eye(2 * N)
    plant = [(carried(state + d, period) - carried(state - d, period)) / 2e-5 for d in nudges]
    return float(np.abs(ad - np.stack(plant, axis=1)).max())


def at_rest(count: int, ticks: int) -> tuple[Grid, Motion]:
    state = np.zeros((count + 1, 2 * N))
    state[:, 1] = 1.2
    motion = Motion(state, np.zeros((count + 1, 2)), np.zeros((count, 2)))
    return Grid(ticks, 2, PERIOD / 2, 4), motion


@pytest.mark.parametrize('seed', range(3))
def test_a_linearised_tick_is_the_plants(seed: int) -> None:
    """To third order in the tick: a quarter of it leaves a sixty-fourth of the error."""
    state = state_at(seed)
    assert linear_error(state, PERIOD / 4) < linear_error(state, PERIOD) / 50


def test_discretising_is_the_matrix_exponential() -> None:
    rows, ad, bd = np.zeros((N, 2 * N + 2)), np.zeros((2 * N, 2 * N)), np.zeros((2 * N, 2))
    model.linearise(ARM, state_at(1), 0.0, 0.0, rows)
    model.discretise(rows, PERIOD, ad, bd)
    whole = np.zeros((2 * N + 2, 2 * N + 2))
    whole[:N, N:-2] = np.eye(N)
    whole[N:-2, :] = rows
    exact = expm(PERIOD * whole)
    assert ad == pytest.approx(exact[:-2, :-2], rel=1e-9, abs=1e-9)
    assert bd == pytest.approx(exact[:-2, -2:], rel=1e-9, abs=1e-12)


def test_parameters_act_as_a_plant_with_them_does() -> None:
    """EI and density scaled in the packed constants, on one basis, move the arm alike."""
    own = ARM.con.copy()
    model.adjust(floats(ARM.con), ARM.rigidity, ARM.density, 0.2, 0.1, floats(own))
    changed = replace(
        PLANT, flexural_rigidity=(2011.2, 2011.2), mass_density=(0.3685, 0.3685)
    )  # fmt: skip
    wanted = make_constants_on(changed, link_bases(PLANT))
    assert floats(own) == pytest.approx(floats(wanted), rel=1e-12, abs=1e-12)
    state, one, other = state_at(2), np.zeros(N), np.zeros(N)
    model.adjust(floats(ARM.con), ARM.rigidity, ARM.density, 0.0, 0.1, floats(own))
    softer, stiffer, lighter, heavier = around(ARM)
    rows = np.zeros((N, 2 * N + 4))
    model.sensitivity(ARM, (softer, stiffer, lighter, heavier), APART, state, 5.0, 2.0, rows)
    acceleration(ARM.con, state[:N], state[N:], 5.0, 2.0, ARM.work, one)
    acceleration(own, state[:N], state[N:], 5.0, 2.0, ARM.work, other)
    assert other - one == pytest.approx(0.1 * rows[:, 2 * N + 3], rel=0.15, abs=0.05)


def test_the_regulator_at_rest_is_the_riccati_recursion() -> None:
    """Over the same number of steps: a mode that 20 ms hardly reach converges slowly."""
    grid, motion = at_rest(4, 20)
    weights = RegulatorWeights(1e3, 3e3, 1e-4, 1e-5)
    gains = np.zeros((4, 2, 2 * N + 6))
    fill_regulator(ARM, around(ARM), APART, weights, grid, motion, 996, gains)
    rows, small = np.zeros((N, 2 * N + 2)), np.zeros((2 * N + 2, 2 * N + 2))
    drive, jacobian = np.zeros((2 * N + 2, 2)), np.zeros((2, N))
    model.linearise(ARM, motion.state[0], 0.0, 0.0, rows)
    model.interval_matrices(rows, 20, PERIOD, small, drive)
    model.point_jacobian(ARM.tip, motion.state[0, :N], jacobian)
    spacing, size = 0.02, 2 * N + 4
    a, b, q = np.zeros((size, size)), np.zeros((size, 2)), np.zeros((size, size))
    a[:-2, :-2], b[:-2] = small, drive
    a[-2:, :N], a[-2:, -2:] = spacing * jacobian, np.eye(2)
    q[:N, :N] = 1e3 * jacobian.T @ jacobian
    q[-4:-2, -4:-2] = 1e-4 * np.eye(2)
    q[-2:, -2:] = 3e3 * np.eye(2)
    r = spacing * 1e-5 * np.eye(2)
    p = np.zeros((size, size))
    for _ in range(1000):
        wanted = -np.linalg.solve(r + b.T @ p @ b, b.T @ p @ a)
        p = spacing * q + a.T @ p @ (a + b @ wanted)
    assert gains[0, :, :size] == pytest.approx(wanted, rel=1e-4, abs=1e-4 * np.abs(wanted).max())


def test_the_filter_at_rest_solves_the_riccati_equation() -> None:
    """Without latency and unknowns the gains become the steady ones of the textbook."""
    grid, motion = at_rest(250, 20)
    setup = FilterModel(
        0, 0.0, 1, np.array([1e-8, 1e-6, 4e-6]), np.array([1e-2, 1e-3, 1e-3]),
        np.concatenate([np.full(2 * N, 1e-4), np.zeros(UNKNOWNS)]), np.zeros(UNKNOWNS),
        np.zeros(UNKNOWNS),
    )  # fmt: skip
    gains = np.zeros((250, 2 * N + UNKNOWNS + 4, 6))
    fill_filter(ARM, around(ARM), APART, setup, grid, motion, gains)
    rows, ad, bd = np.zeros((N, 2 * N + 2)), np.zeros((2 * N, 2 * N)), np.zeros((2 * N, 2))
    model.linearise(ARM, motion.state[0], 0.0, 0.0, rows)
    model.discretise(rows, PERIOD, ad, bd)
    c = np.zeros((6, 2 * N))
    c[0, 0] = c[1, 1] = c[2, N] = c[3, N + 1] = 1.0
    model.point_jacobian(ARM.tip, motion.state[0, :N], c[4:, :N])
    r = np.diag([1e-8, 1e-8, 1e-6, 1e-6, 4e-6, 4e-6])
    q = 1e-2 * bd @ bd.T / PERIOD
    q[N:, N:] += 1e-3 * PERIOD * np.eye(N)
    p = solve_discrete_are(ad.T, c.T, q, r)
    wanted = p @ c.T @ np.linalg.inv(c @ p @ c.T + r)
    assert gains[-1, : 2 * N] == pytest.approx(wanted, rel=1e-3, abs=1e-3 * np.abs(wanted).max())
