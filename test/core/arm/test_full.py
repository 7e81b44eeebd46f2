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

"""The full model against its definition, conservation laws, theory and convergence."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.full.dynamics import make_work, mass_and_bias
from flexarm_ros.core.arm.full.model import link_bases, make_constants
from flexarm_ros.core.arm.full.plant import elastic_diagonals, FullPlant, mass_matrix
from flexarm_ros.core.arm.plant import instability, STABLE_PHASE
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import choose_integrator, highest_frequency, make_plant
from flexarm_ros.stability.modes import linearise
import numpy as np
import pytest
from scipy.linalg import eigh
from validation import conservation, rotation
from validation.motion import full_plant, start

LOADED = PlantParameters(
    model='full',
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


RIGID_PARTS = {'hub_radius': (0.6, 0.3), 'end_offset': (0.4, 0.7)}


class Points:
    """
    Every mass of the arm as points in the plane: where they are, from the map's definition.

    The end of each link is that of its rigid part, where the masses and the next joint are.
    """

    def __init__(self, plant: PlantParameters, nodes: int = 40) -> None:
        self.plant = plant
        rule, weights = np.polynomial.legendre.leggauss(nodes)
        xi, self.weights = np.append(0.5 * (rule + 1.0), 1.0), 0.5 * weights
        self.shapes = []
        for link, basis in enumerate(link_bases(plant)):
            length = plant.length[link]
            phi, end_slope = basis.shape(xi), basis.shape(1.0, 1)[:, 0] / length
            short = np.array([basis.shortening(x) for x in xi]) / length
            s, beyond = plant.hub_radius[link] + xi * length, plant.end_offset[link]
            s[-1] += beyond
            phi[:, -1] += beyond * end_slope
            short[-1] += beyond * np.outer(end_slope, end_slope)
            self.shapes.append((s, phi, short, end_slope))

    def places(self, q: np.ndarray) -> np.ndarray:
        """x, y of link 1's points and then of link 2's, each link's end last, ``(points, 2)``."""
        n, found = self.plant.modes, []
        base, angle = np.zeros(2), 0.0
        for link, (s, phi, short, slope) in enumerate(self.shapes):
            angle += q[link]
            a = q[2:].reshape(2, n)[link]
            along = s - 0.5 * np.einsum('i,qij,j->q', a, short, a)
            across = a @ phi
            axis = np.array([math.cos(angle), math.sin(angle)])
            normal = np.array([-axis[1], axis[0]])
            found.append(base + np.outer(along, axis) + np.outer(across, normal))
            base, angle = found[-1][-1], angle + slope @ a
        return np.concatenate(found)

    def masses(self) -> np.ndarray:
        plant = self.plant
        ends = (plant.link_end_mass, plant.payload_mass)
        parts = [
            np.append(plant.mass_density[i] * plant.length[i] * self.weights, ends[i])
            for i in (0, 1)
        ]
        return np.concatenate(parts)

    def turning(self) -> list[tuple[float, np.ndarray]]:
        """Return what turns: inertia, and its rate as a row over q' (all of them constant)."""
        n, plant = self.plant.modes, self.plant
        half, size = 2 + n, 2 + 2 * n
        first, second = np.zeros(size), np.zeros(size)
        first[0], first[2:half] = 1.0, self.shapes[0][3]
        second[:] = first
        second[1], second[half:] = 1.0, self.shapes[1][3]
        return [
            (plant.hub_inertia[0], np.eye(size)[0]),
            (plant.hub_inertia[1], np.eye(size)[1]),
            (plant.link_end_inertia, first),
            (plant.payload_inertia, second),
        ]

    def jacobian(self, q: np.ndarray, h: float = 1e-5) -> np.ndarray:
        """Return d places / d q, ``(points, 2, n)``, by central differences of fourth order."""
        columns = []
        for unit in np.eye(len(q)):
            one = self.places(q + h * unit) - self.places(q - h * unit)
            two = self.places(q + 2 * h * unit) - self.places(q - 2 * h * unit)
            columns.append((8.0 * one - two) / (12.0 * h))
        return np.stack(columns, axis=-1)


def state(plant: PlantParameters, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng, n = np.random.default_rng(seed), plant.modes
    q, qd = rng.normal(size=2 + 2 * n), rng.normal(size=2 + 2 * n)
    size = np.tile(0.3 / np.arange(1, n + 1) ** 2, 2)
    q[2:], qd[2:] = q[2:] * size, qd[2:] * size
    return q, qd


@pytest.mark.parametrize('basis', ['arm_modes', 'craig_bampton', 'clamped_free'])
@pytest.mark.parametrize('case', ['bare', 'loaded', 'rigid parts'])
def test_mass_matrix_and_bias_are_those_of_the_moving_points(basis: str, case: str) -> None:
    """For points that move as the map says: sum m J' (J q'' + J' q') = tau - K q."""
    plant = replace(full_plant(modes=2) if case == 'bare' else LOADED, basis=basis)
    if case == 'rigid parts':
        plant = replace(plant, **RIGID_PARTS)
    points, n = Points(plant), plant.modes
    q, qd = state(plant, 3)
    jacobian, masses = points.jacobian(q), points.masses()
    mass = np.einsum('p,pxi,pxj->ij', masses, jacobian, jacobian)
    for inertia, row in points.turning():
        mass += inertia * np.outer(row, row)
    assert mass_matrix(plant, q) == pytest.approx(mass, rel=1e-7, abs=1e-7)

    # What remains of the points' accelerations when q'' = 0, by the second difference in time.
    h = 1e-3
    near = points.places(q + h * qd) + points.places(q - h * qd)
    far = points.places(q + 2 * h * qd) + points.places(q - 2 * h * qd)
    rest = (16.0 * near - far - 30.0 * points.places(q)) / (12.0 * h * h)
    bias = np.einsum('p,pxi,px->i', masses, jacobian, rest)
    work = make_work(n)
    mass_and_bias(make_constants(plant), q, qd, work)
    assert work[0].force == pytest.approx(bias, rel=1e-6, abs=1e-6)


def test_momentum_is_the_angular_momentum_about_the_shoulder() -> None:
    plant = full_plant(modes=3)
    points, (q, qd) = Points(plant), state(plant, 8)
    arm = start(plant, (0.0, 0.0))
    assert isinstance(arm, FullPlant)
    arm.set_state(q, qd)
    place, velocity = points.places(q), points.jacobian(q) @ qd
    spin = points.masses() @ (place[:, 0] * velocity[:, 1] - place[:, 1] * velocity[:, 0])
    assert arm.momentum() == pytest.approx(float(spin), rel=1e-8)
    kinetic = 0.5 * points.masses() @ np.sum(velocity**2, axis=1)
    arm.set_state(q, 0.0 * qd)
    elastic = arm.energy()
    arm.set_state(q, qd)
    assert arm.energy() - elastic == pytest.approx(float(kinetic), rel=1e-8)


@pytest.mark.parametrize('modes', [1, 4])
def test_energy_and_momentum_stay_in_free_motion(modes: int) -> None:
    plant = full_plant(modes=modes)
    assert max(conservation.drift(plant, pulse=20.0)) < 1e-6


def test_energy_and_momentum_stay_with_hubs_payload_and_unequal_links() -> None:
    assert max(conservation.drift(LOADED, pulse=20.0)) < 1e-6


def test_energy_and_momentum_stay_with_rigid_parts() -> None:
    assert max(conservation.drift(replace(LOADED, **RIGID_PARTS), pulse=20.0)) < 1e-6


def test_work_and_impulse_are_balanced() -> None:
    energy, momentum = conservation.balance(full_plant(modes=3))
    assert energy < 1e-6
    assert momentum < 1e-6


def test_eq14_conserves_neither() -> None:
    energy, momentum = conservation.eq14_drift(PlantParameters(modes=1))
    assert energy > 0.01
    assert momentum > 0.01


@pytest.mark.parametrize('speed', [1.0, 3.0, 6.0, 12.0])
def test_a_rotating_link_stiffens_as_published(speed: float) -> None:
    """Wright et al. 1982; without the foreshortening the first one falls instead."""
    found = rotation.lead_lag(speed, modes=6)
    assert found == pytest.approx(rotation.published(speed), rel=rotation.LIMIT)
    assert rotation.ritz(speed) == pytest.approx(rotation.published(speed), rel=5e-5)
    assert found[0] > 3.516
    assert rotation.lead_lag(speed, modes=6, foreshortening=False)[0] < 3.516


def test_very_stiff_links_move_as_rigid_ones() -> None:
    """The double pendulum without gravity, its equations integrated here."""
    plant = full_plant(modes=1, flexural_rigidity=(1e9, 1e9))
    run = RunParameters(control_period=1e-5, duration=1.0)
    arm = make_plant(RunConfig(run=run, plant=replace(plant, initial_position=(0.3, 0.9))))
    torque, ticks = np.array([30.0, -12.0]), 20_000
    m, length, h = 0.335 * 4.5, 4.5, 1e-4

    def acceleration(x: np.ndarray, v: np.ndarray) -> np.ndarray:
        inertia = m * length**2
        c, s = 0.5 * inertia * math.cos(x[1]), 0.5 * inertia * math.sin(x[1])
        mass = np.array(
            [[5 * inertia / 3 + 2 * c, inertia / 3 + c], [inertia / 3 + c, inertia / 3]]
        )
        swirl = np.array([-s * v[1] * (2 * v[0] + v[1]), s * v[0] ** 2])
        return np.linalg.solve(mass, torque - swirl)

    x, v = np.array([0.3, 0.9]), np.zeros(2)
    for _ in range(2000):
        k1 = acceleration(x, v)
        k2 = acceleration(x + h / 2 * v, v + h / 2 * k1)
        k3 = acceleration(x + h / 2 * (v + h / 2 * k1), v + h / 2 * k2)
        k4 = acceleration(x + h * (v + h / 2 * k2), v + h * k3)
        x, v = x + h * v + h * h / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    for _ in range(ticks):
        arm.step(*torque)
    assert arm.q[:2] == pytest.approx(x, abs=2e-6)


def test_modal_damping_decays_at_its_ratio() -> None:
    """One link on a huge hub: its first coordinate is a damped oscillator."""
    plant = full_plant(
        modes=1, basis='clamped_free', hub_inertia=(1e12, 1e12), damping_ratio=0.02,
        length=(4.5, 0.1), mass_density=(0.335, 1e-7), flexural_rigidity=(1676.0, 1e-5),
    )  # fmt: skip
    arm = start(plant, (0.0, 0.0))
    q = np.zeros(4)
    q[2] = 1e-4
    arm.set_state(q, np.zeros(4))
    omega, zeta = 12.28119, 0.02
    fast = omega * math.sqrt(1.0 - zeta**2)
    for _ in range(1000):
        arm.step(0.0, 0.0)
    expected = math.exp(-zeta * omega) * (
        math.cos(fast) + zeta / math.sqrt(1.0 - zeta**2) * math.sin(fast)
    )
    assert arm.q[2] == pytest.approx(1e-4 * expected, rel=1e-4)


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_link_damping_is_that_of_the_bent_link(model: str) -> None:
    """Of a link bent as by an end force: c per rate of deflection / L, as a dashpot there."""
    plant = PlantParameters(
        model=model, basis='craig_bampton', modes=1, link_damping=(3.0, 5.0), damping_ratio=0.0
    )
    arm = linearise(RunConfig(plant=plant), 0.3)
    for link in (0, 1):
        k, d = arm.stiffness[2 + link, 2 + link], arm.damping[2 + link, 2 + link]
        assert d / k == pytest.approx(plant.link_damping[link] / (3.0 * 1676.0 / 4.5), rel=1e-12)
    if model == 'full':
        bend = arm.deflection[0, 2]
        assert arm.damping[2, 2] == pytest.approx(3.0 * (bend / 4.5) ** 2, rel=1e-9)


def end(
    substeps: int | None, plant: PlantParameters, period: float, order: int | None = None
) -> np.ndarray:
    """Return the state of a bent, turning arm after 0.2 s under torques."""
    config = RunConfig(run=RunParameters(control_period=period), plant=plant)
    arm = make_plant(replace(config, plant=replace(plant, substeps=substeps)))
    assert isinstance(arm, FullPlant)
    arm.order = order or arm.order
    n = plant.modes
    q, qd = np.zeros((2, 2 + 2 * n))
    q[:4], qd[:4] = (0.2, 1.0, 0.1, 0.0), (0.5, -1.0, 0.0, 0.1)
    q[2 + n], qd[2 + n] = -0.1, 0.1
    arm.set_state(q, qd)
    for _ in range(round(0.2 / period)):
        arm.step(20.0, -10.0)
    return np.concatenate([arm.q, arm.qd])


@pytest.mark.parametrize(
    ('order', 'period', 'counts'), [(4, 0.001, (4, 8, 16)), (8, 0.01, (3, 4, 6))]
)
def test_each_integrator_has_its_order(order: int, period: float, counts: tuple[int, ...]) -> None:
    plant = replace(full_plant(modes=2), damping_ratio=0.01)
    run = RunParameters(control_period=period, duration=0.2)
    assert choose_integrator(RunConfig(run=run, plant=plant))[0] == order
    exact = end(64, plant, period)
    errors = [np.linalg.norm(end(n, plant, period) - exact) for n in counts]
    orders = [
        math.log(errors[i] / errors[i + 1]) / math.log(counts[i + 1] / counts[i]) for i in (0, 1)
    ]
    assert orders == pytest.approx([order, order], abs=0.025 * order)


@pytest.mark.parametrize(
    ('modes', 'hub', 'order', 'substeps'),
    [
        (1, 8.0, 4, 1),
        (3, 8.0, 4, 2),
        (3, 0.0, 8, 1),
        (4, 8.0, 8, 1),
        (5, 8.0, 8, 2),
        (6, 8.0, 8, 3),
    ],
)
def test_the_cheapest_integrator_is_chosen(
    modes: int, hub: float, order: int, substeps: int
) -> None:
    """Evaluations per tick: 4 for each step of order 4, 12 for each of order 8."""
    plant = full_plant(modes=modes, hub_inertia=(hub, hub))
    config = RunConfig(plant=plant)
    assert choose_integrator(config) == (order, substeps)
    phase = highest_frequency(config) * config.run.control_period
    classical = math.ceil(phase / 0.33)
    assert (classical <= 2) == (order == 4)
    assert (4 if order == 4 else 12) * substeps <= 4 * classical
    finer = replace(config, plant=replace(plant, substeps=20))
    assert choose_integrator(finer) == (order, 20)


@pytest.mark.parametrize(('modes', 'times'), [(4, 1000.0), (6, 50.0)])
def test_the_eighth_order_is_more_exact_than_classical_steps(modes: int, times: float) -> None:
    """Of the same arm, in steps of at most 0.33 rad; its own are of 1.1 and 1.7 rad."""
    plant = full_plant(modes=modes, hub_inertia=(8.0, 8.0))
    config = RunConfig(plant=plant)
    order, substeps = choose_integrator(config)
    classical = math.ceil(highest_frequency(config) * 1e-3 / 0.33)
    exact = end(8 * substeps, plant, 1e-3)
    ours = np.abs(end(None, plant, 1e-3) - exact).max()
    theirs = np.abs(end(classical, plant, 1e-3, order=4) - exact).max()
    assert order == 8
    assert times * ours < theirs


def test_too_few_substeps_are_refused_and_the_least_allowed_are_stable() -> None:
    plant = full_plant(modes=6)
    config = RunConfig(plant=plant)
    highest = highest_frequency(config)
    least = math.ceil(highest * 0.001 / STABLE_PHASE)
    assert least > 1
    with pytest.raises(ValueError, match=rf'^plant.substeps: {least - 1} .*allowed: {least} or'):
        make_plant(replace(config, plant=replace(plant, substeps=least - 1)))
    arm = start(replace(plant, substeps=least), (0.0, 1.0), (1.0, -0.5))
    for _ in range(2000):
        arm.step(0.0, 0.0)
    assert instability(arm) is None
    assert abs(arm.deflections()[0]) < 0.5


def test_the_highest_frequency_is_that_of_the_mass_matrix() -> None:
    """Over elbow angles that the search itself does not visit."""
    plant = replace(LOADED, modes=4)
    stiffness = np.diag(elastic_diagonals(plant)[0])
    rates = []
    for theta2 in np.linspace(0.0, 2.0 * math.pi, 173):
        q = np.zeros(10)
        q[1] = theta2
        rates.append(math.sqrt(eigh(stiffness, mass_matrix(plant, q), eigvals_only=True)[-1]))
    assert max(rates) == pytest.approx(highest_frequency(RunConfig(plant=plant)), rel=5e-3)
