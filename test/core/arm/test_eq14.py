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

"""The eq14 plant against matrices assembled another way, theory and convergence."""

from __future__ import annotations

from dataclasses import replace
import math
from typing import Any

from flexarm_ros.core.arm.beam import clamped_free_root
from flexarm_ros.core.arm.plant import instability, Plant, STABLE_PHASE
from flexarm_ros.core.arm.plant_eq14 import Eq14Matrices
from flexarm_ros.core.numerics.linalg import solve_symmetric
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import highest_frequency, make_plant
import numpy as np
import pytest
from scipy.linalg import eigh

LOADED = PlantParameters(
    modes=3,
    length=(4.0, 5.0),
    mass_density=(0.4, 0.3),
    flexural_rigidity=(1500.0, 2000.0),
    hub_inertia=(3.0, 2.0),
    payload_mass=0.7,
    payload_inertia=0.2,
    link_end_mass=0.5,
    link_end_inertia=0.1,
)
RIGID_PARTS = replace(LOADED, hub_radius=(0.6, 0.3), end_offset=(0.4, 0.7))


def shape(length: float, x: float, count: int, order: int) -> np.ndarray:
    """Equation (8) and derivatives in extended precision, written from the paper."""
    values = []
    for i in range(count):
        root = np.longdouble(clamped_free_root(i))
        k = (np.cos(root) + np.cosh(root)) / (np.sin(root) + np.sinh(root))
        b, z = root / length, root * np.longdouble(x) / length
        values.append(
            [
                np.cosh(z) - np.cos(z) - k * (np.sinh(z) - np.sin(z)),
                b * (np.sinh(z) + np.sin(z) - k * (np.cosh(z) - np.cos(z))),
                b * b * (np.cosh(z) + np.cos(z) - k * (np.sinh(z) + np.sin(z))),
            ][order]
        )
    return 0.1 * np.array(values, dtype=float)


def independent_matrices(plant: PlantParameters, theta2: float) -> tuple[np.ndarray, np.ndarray]:
    """M and K at zero deformation by Gauss quadrature of the point velocities."""
    n, size = plant.modes, 2 + 2 * plant.modes
    half = 2 + n
    (l1, l2), (rho1, rho2), (ei1, ei2) = plant.length, plant.mass_density, plant.flexural_rigidity
    (h1, h2), (e1, e2) = plant.hub_radius, plant.end_offset
    nodes, weights = np.polynomial.legendre.leggauss(40)
    mass, stiffness = np.zeros((size, size)), np.zeros((size, size))
    normal1 = np.array([0.0, 1.0])
    normal2 = np.array([-math.sin(theta2), math.cos(theta2)])

    def on_link1(x: float, beyond: float = 0.0) -> np.ndarray:
        row = np.zeros(size)
        row[0] = h1 + x + beyond
        row[2:half] = shape(l1, x, n, 0) + beyond * shape(l1, x, n, 1)
        return np.outer(normal1, row)

    turn1 = np.zeros(size)
    turn1[0], turn1[2:half] = 1.0, shape(l1, l1, n, 1)
    turn2 = turn1.copy()
    turn2[1] = 1.0

    def on_link2(x: float, beyond: float = 0.0) -> np.ndarray:
        row = (h2 + x + beyond) * turn2
        row[half:] += shape(l2, x, n, 0) + beyond * shape(l2, x, n, 1)
        return on_link1(l1, e1) + np.outer(normal2, row)

    for node, weight in zip(nodes, weights, strict=True):
        x1, x2 = 0.5 * l1 * (1 + node), 0.5 * l2 * (1 + node)
        j1, j2 = on_link1(x1), on_link2(x2)
        mass += 0.5 * weight * (l1 * rho1 * j1.T @ j1 + l2 * rho2 * j2.T @ j2)
        bend1, bend2 = np.zeros(size), np.zeros(size)
        bend1[2:half], bend2[half:] = shape(l1, x1, n, 2), shape(l2, x2, n, 2)
        stiffness += 0.5 * weight * l1 * ei1 * np.outer(bend1, bend1)
        stiffness += 0.5 * weight * l2 * ei2 * np.outer(bend2, bend2)
    end1, end2 = on_link1(l1, e1), on_link2(l2, e2)
    tip_turn = turn2.copy()
    tip_turn[half:] = shape(l2, l2, n, 1)
    mass += plant.link_end_mass * end1.T @ end1 + plant.payload_mass * end2.T @ end2
    mass += plant.link_end_inertia * np.outer(turn1, turn1)
    mass += plant.payload_inertia * np.outer(tip_turn, tip_turn)
    mass[0, 0] += plant.hub_inertia[0]
    mass[1, 1] += plant.hub_inertia[1]
    return mass, stiffness


@pytest.mark.parametrize(
    'plant', [PlantParameters(), PlantParameters(modes=6), LOADED, RIGID_PARTS]
)
@pytest.mark.parametrize('theta2', [0.0, 0.7, math.pi / 2, 2.9])
def test_matrices_and_frequencies_assembled_another_way(plant, theta2: float) -> None:
    mass, stiffness = independent_matrices(plant, theta2)
    ours = Eq14Matrices(plant)
    assert ours.mass_at(theta2) == pytest.approx(mass, rel=1e-9, abs=1e-9)
    assert np.diag(ours.stiffness) == pytest.approx(stiffness, rel=1e-8, abs=1e-6)
    theirs = eigh(stiffness, mass, eigvals_only=True)[2:]
    mine = eigh(np.diag(ours.stiffness), ours.mass_at(theta2), eigvals_only=True)[2:]
    assert np.sqrt(mine) == pytest.approx(np.sqrt(theirs), rel=1e-8)


def test_highest_rate_bounds_every_elbow_angle() -> None:
    highest = Eq14Matrices(LOADED).highest_rate()
    rates = []
    for theta2 in np.linspace(-math.pi, math.pi, 181):
        mass, stiffness = independent_matrices(LOADED, float(theta2))
        rates.append(math.sqrt(eigh(stiffness, mass, eigvals_only=True)[-1]))
    assert max(rates) == pytest.approx(highest, rel=1e-9)


def frequencies(plant: PlantParameters, locked: tuple[int, ...]) -> np.ndarray:
    matrices = Eq14Matrices(plant)
    keep = [i for i in range(2 + 2 * plant.modes) if i not in locked]
    mass = matrices.mass_at(0.0)[np.ix_(keep, keep)]
    squares = eigh(np.diag(matrices.stiffness[keep]), mass, eigvals_only=True)
    free = 2 - len(locked)
    return np.sqrt(np.maximum(squares[free:], 0.0))


# shared reference: the straight arm without hubs, exact
CHAIN = {(): [40.2176, 69.5835, 149.6460, 201.3070], (0,): [8.6184, 53.8547, 77.5661, 174.5240]}


@pytest.mark.parametrize('locked', [(), (0,)])
def test_two_links_converge_to_the_exact_frequencies_from_above(locked) -> None:
    """As Rayleigh and Ritz have it; a free elbow passes no moment on, so it is quick."""
    exact, before = np.array(CHAIN[locked]), np.full(4, np.inf)
    for modes in (2, 4, 6):
        found = frequencies(PlantParameters(modes=modes, hub_inertia=(0.0, 0.0)), locked)[:4]
        assert np.all(found >= exact * (1 - 1e-5))
        assert np.all(found <= before * (1 + 1e-12))
        before = found
    assert before == pytest.approx(exact, rel=2e-3)


def test_one_link_against_clamped_free_and_pinned_free_beams() -> None:
    # Link 2 next to nothing: what is left is link 1, on a huge hub or on none.
    plant = PlantParameters(
        modes=6, length=(4.5, 0.1), mass_density=(0.335, 1e-7), flexural_rigidity=(1676.0, 1e-6)
    )
    pinned = frequencies(replace(plant, hub_inertia=(0.0, 0.0)), (1,))[:3]
    assert pinned == pytest.approx([53.85468, 174.52364, 364.12965], rel=3e-4)
    clamped = frequencies(replace(plant, hub_inertia=(1e9, 0.0)), (1,))[:3]
    assert clamped == pytest.approx([12.28119, 76.96488, 215.50390], rel=1e-6)


def rigid_mass(plant: PlantParameters, theta2: float) -> np.ndarray:
    return Eq14Matrices(plant).mass_at(theta2)[:2, :2]


@pytest.mark.parametrize('plant', [PlantParameters(), LOADED])
@pytest.mark.parametrize('state', [(0.3, 0.8, 1.1, -0.7), (-2.0, 2.5, -0.4, 1.9)])
def test_one_step_satisfies_equation_14(plant, state: tuple[float, ...]) -> None:
    """M q'' + C q' + K q = tau with C from the Christoffel symbols of the rigid block."""
    torque = np.array([3.0, -2.0])
    config = RunConfig(run=RunParameters(control_period=1e-6, duration=1.0), plant=plant)
    arm = make_plant(config)
    size = len(arm.names)
    rng = np.random.default_rng(5)
    q, qd = rng.normal(size=size) * 0.1, rng.normal(size=size) * 0.1
    q[:2], qd[:2] = state[:2], state[2:]
    arm.set_state(q, qd)
    arm.step(*torque)
    acceleration = (arm.qd - qd) / 1e-6

    h = 1e-6
    slope = (rigid_mass(plant, q[1] + h) - rigid_mass(plant, q[1] - h)) / (2 * h)
    rates = qd[:2]
    coriolis = rates[1] * slope @ rates - 0.5 * np.array([0.0, rates @ slope @ rates])
    mass, stiffness = independent_matrices(plant, q[1])
    left = mass @ acceleration + stiffness @ q
    left[:2] += coriolis
    right = np.zeros(size)
    right[:2] = torque
    assert left == pytest.approx(right, abs=2e-3)


def test_runge_kutta_is_of_fourth_order() -> None:
    def end(substeps: int) -> np.ndarray:
        plant = replace(PlantParameters(), modes=2, substeps=substeps, damping_ratio=0.01)
        arm = make_plant(RunConfig(run=RunParameters(control_period=0.02), plant=plant))
        arm.set_state([0.2, 1.0, 0.1, 0.05, -0.1, 0.02], [0.5, -1.0, 0.0, 0.3, 0.2, 0.0])
        for _ in range(20):
            arm.step(20.0, -10.0)
        return np.concatenate([arm.q, arm.qd])

    exact = end(512)
    errors = [np.linalg.norm(end(n) - exact) for n in (8, 16, 32)]
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.25)


def test_a_small_vibration_keeps_frequency_and_amplitude() -> None:
    """Linear free vibration in one mode of the straight arm at the default substeps."""
    config = RunConfig(plant=PlantParameters(modes=2, damping_ratio=0.0))
    mass, stiffness = independent_matrices(config.plant, 0.0)
    squares, vectors = eigh(stiffness, mass)
    omega, vector = math.sqrt(squares[-1]), 1e-7 * vectors[:, -1]
    arm = make_plant(config)
    arm.set_state(vector, np.zeros(6))
    for _ in range(1000):
        arm.step(0.0, 0.0)
    assert arm.q == pytest.approx(vector * math.cos(omega * 1.0), abs=2e-3 * np.abs(vector).max())


def test_too_few_substeps_are_refused_and_enough_are_stable() -> None:
    plant = PlantParameters(modes=6, hub_inertia=(0.0, 0.0))
    config = RunConfig(plant=plant)
    highest = highest_frequency(config)
    least = math.ceil(highest * 0.001 / STABLE_PHASE)
    assert least > 1
    with pytest.raises(ValueError, match=rf'^plant.substeps: {least - 1} .*allowed: {least} or'):
        make_plant(replace(config, plant=replace(plant, substeps=least - 1)))
    arm = make_plant(replace(config, plant=replace(plant, substeps=least)))
    arm.set_state(np.full(14, 1e-3), np.zeros(14))
    for _ in range(2000):
        arm.step(0.0, 0.0)
    assert instability(arm) is None
    assert np.abs(arm.q[2:]).max() < 0.1
    assert make_plant(config).substeps == math.ceil(highest * 0.001 / 0.2)


def test_instability_names_the_quantity() -> None:
    arm = make_plant(RunConfig())
    assert instability(arm) is None
    arm.set_state([0.0, 0.0, 0.0, 26.0], np.zeros(4))
    assert instability(arm) == f'deflection of link2: {arm.deflections()[1]:.6g} m, limit 5 m'
    arm.set_state([0.0, 0.0, 0.0, 0.0], [0.0, math.nan, 0.0, 0.0])
    assert instability(arm) == 'rate of elbow: nan'
    arm.set_state([math.inf, 0.0, 0.0, 0.0], np.zeros(4))
    assert instability(arm) == 'shoulder: inf'


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_the_limit_of_deflection_scales_with_the_link_or_is_given(model: str) -> None:
    def arm(**plant: Any) -> Plant:
        return make_plant(RunConfig(plant=PlantParameters(model=model, **plant)))

    assert arm().limits == (5.0, 5.0)  # exactly: the shipped cases end where they did
    assert arm(length=(0.5, 9.0)).limits == (5.0 / 9.0, 10.0)
    given = arm(deflection_limit=(0.01, 0.2))
    given.set_state([0.0, 0.0, 1.0, 1.0], np.zeros(4))
    unit1, unit2 = given.deflections()[:2]
    for end1, end2, told in (
        (-0.009, 0.19, None),
        (-0.011, 0.0, 'deflection of link1: -0.011 m, limit 0.01 m'),
        (0.0, 0.21, 'deflection of link2: 0.21 m, limit 0.2 m'),
    ):
        given.set_state([0.0, 0.0, end1 / unit1, end2 / unit2], np.zeros(4))
        assert instability(given) == told


@pytest.mark.parametrize('size', [1, 2, 4, 14])
def test_solver_against_numpy(size: int) -> None:
    rng = np.random.default_rng(size)
    root = rng.normal(size=(size, size))
    matrix, vector = root @ root.T + np.eye(size), rng.normal(size=size)
    expected = np.linalg.solve(matrix, vector)
    work, solution = matrix.copy(), vector.copy()
    solve_symmetric(work, solution)
    assert solution == pytest.approx(expected, rel=1e-10)
