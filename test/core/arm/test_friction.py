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


"""Friction at the joints: closed forms, true stick, energy, order of the integrator."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.driven.plant import DrivenPlant
from flexarm_ros.core.arm.full.plant import FullPlant
from flexarm_ros.core.arm.plant import Plant
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import make_plant
import numpy as np
import pytest

MODELS = pytest.mark.parametrize('model', ['eq14', 'full'])
INERTIA = 2.0


def hub_only(**keys: object) -> PlantParameters:
    """Return an arm whose hubs are all of its inertia: links of 2e-8 kg m^2."""
    light: dict[str, object] = {
        'hub_inertia': (INERTIA, INERTIA), 'length': (0.1, 0.1), 'mass_density': (1e-6, 1e-6),
        'flexural_rigidity': (1e-7, 1e-7), 'modes': 2,
    }  # fmt: skip
    return PlantParameters(**{**light, **keys})  # type: ignore[arg-type]


def arm_of(plant: PlantParameters, rates=(0.0, 0.0), period: float = 1e-3) -> Plant:
    posed = replace(plant, initial_position=(0.2, 0.9), initial_velocity=rates)
    return make_plant(RunConfig(run=RunParameters(control_period=period), plant=posed))


@MODELS
def test_viscous_friction_decays_exponentially(model: str) -> None:
    arm = arm_of(hub_only(model=model, viscous_friction=(3.0, 0.5)), rates=(0.7, -0.4))
    for _ in range(400):
        arm.step(0.0, 0.0)
    fall = (math.exp(-3.0 * 0.4 / INERTIA), math.exp(-0.5 * 0.4 / INERTIA))
    # theta2's hub turns on the end of link 1, and each feels its own friction only.
    assert arm.qd[0] == pytest.approx(0.7 * fall[0], rel=1e-6)
    assert arm.qd[1] == pytest.approx(-0.4 * fall[1], rel=1e-6)
    assert arm.q[0] - 0.2 == pytest.approx(0.7 * (1.0 - fall[0]) * INERTIA / 3.0, rel=1e-6)


@MODELS
@pytest.mark.parametrize('viscous', [0.0, 1.5])
def test_a_sliding_joint_stops_after_the_known_time_and_angle(model: str, viscous: float) -> None:
    """J w' = -F - b w; the other direction has its own friction, the elbow stops later."""
    plant = hub_only(
        model=model, coulomb_friction=(3.0, 9.0), coulomb_friction_negative=(9.0, 1.0),
        viscous_friction=(viscous, viscous),
    )  # fmt: skip
    arm = arm_of(plant, rates=(0.8125, -0.6103))
    assert isinstance(arm, DrivenPlant)
    stops = []
    for speed, friction in ((0.8125, 3.0), (0.6103, 1.0)):
        if viscous:
            time = INERTIA / viscous * math.log1p(viscous * speed / friction)
            angle = INERTIA / viscous * (speed - friction / INERTIA * time)
        else:
            time, angle = INERTIA * speed / friction, 0.5 * INERTIA * speed**2 / friction
        stops.append((time, angle))
    for tick in range(1, 1500):
        before = arm.qd.copy()
        arm.step(0.0, 0.0)
        for joint, (time, _) in enumerate(stops):
            assert (arm.qd[joint] == 0.0) == (tick * 1e-3 > time), (tick, joint, before)
    assert arm.q[0] == pytest.approx(0.2 + stops[0][1], rel=1e-6)
    assert arm.q[1] == pytest.approx(0.9 - stops[1][1], rel=1e-6)


@MODELS
def test_a_joint_at_rest_does_not_drift_in_a_minute(model: str) -> None:
    """Torques within the breakaway torques of both directions, changing at every tick."""
    plant = PlantParameters(
        model=model, modes=2, coulomb_friction=(4.0, 2.0), coulomb_friction_negative=(1.0, 3.0),
        viscous_friction=(0.1, 0.1),
    )  # fmt: skip
    arm = arm_of(plant, period=0.01)
    rng = np.random.default_rng(4)
    for _ in range(6000):
        arm.step(rng.uniform(-0.99, 3.99), rng.uniform(-2.99, 1.99))
        assert arm.qd.tolist() == [0.0] * 6
    assert arm.q.tolist() == [0.2, 0.9, *[0.0] * 4]


@MODELS
@pytest.mark.parametrize(('torque', 'moves'), [(3.99, 0), (4.01, 1), (-0.99, 0), (-1.01, -1)])
def test_a_joint_breaks_away_at_its_friction(model: str, torque: float, moves: int) -> None:
    plant = hub_only(
        model=model, coulomb_friction=(4.0, 4.0), coulomb_friction_negative=(1.0, 1.0)
    )
    arm = arm_of(plant)
    for _ in range(100):
        arm.step(torque, 0.0)
    assert np.sign(arm.qd[0]) == moves
    if moves:
        net = torque - 4.0 if moves > 0 else torque + 1.0
        assert arm.qd[0] == pytest.approx(net * 0.1 / INERTIA, rel=1e-4)


@MODELS
def test_joints_stick_while_bent_links_ring(model: str) -> None:
    """The links' moments reach both joints; below the friction neither moves, nor chatters."""
    plant = PlantParameters(model=model, coulomb_friction=(60.0, 60.0), damping_ratio=0.01)
    arm = arm_of(plant)
    q = np.array([0.2, 0.9, 0.02, 0.02])
    if model == 'eq14':
        q[2:] *= 5.0  # its shapes have 0.2 at the end
    arm.set_state(q, np.zeros(4))
    for _ in range(3000):
        arm.step(0.0, 0.0)
        assert arm.qd[:2].tolist() == [0.0, 0.0]
    assert arm.q[:2].tolist() == [0.2, 0.9]
    assert abs(arm.deflections()[0]) > 1e-4


def swinging(**keys: object) -> PlantParameters:
    return PlantParameters(
        model='full', modes=2, hub_inertia=(1.0, 0.5), coulomb_friction=(12.0, 3.0),
        coulomb_friction_negative=(8.0, 4.0), **keys,  # type: ignore[arg-type]
    )  # fmt: skip


def start_swinging(arm: Plant) -> None:
    arm.set_state([0.2, 0.9, 0.3, 0.02, -0.2, 0.01], [2.0, -3.0, 0.0, 0.1, 0.1, 0.0])


def test_friction_takes_the_energy_and_never_gives_any() -> None:
    """With stick and slip of both joints: E falls by the work of friction, to 1e-6 of it."""
    plant = swinging(viscous_friction=(0.5, 0.2))
    arm = arm_of(plant)
    start_swinging(arm)
    body = FullPlant(RunConfig(plant=plant))
    body.set_state(arm.q, arm.qd)
    first = last = body.energy()
    lost, changes = 0.0, 0
    signs = np.sign(arm.qd[:2])
    for _ in range(4000):
        before = arm.qd[:2].copy()
        arm.step(0.0, 0.0)
        body.set_state(arm.q, arm.qd)
        now = body.energy()
        assert now <= last * (1.0 + 1e-9)
        last = now
        changes += int(np.any(np.sign(arm.qd[:2]) != signs))
        signs = np.sign(arm.qd[:2])
        for joint in (0, 1):
            friction = plant.coulomb_friction, plant.coulomb_friction_negative
            for rate in (before[joint], arm.qd[joint]):
                coulomb = friction[int(rate < 0.0)][joint]
                lost += 0.5e-3 * (coulomb * abs(rate) + plant.viscous_friction[joint] * rate**2)
    assert changes > 10
    assert last < 0.2 * first  # the undamped links ring on when both joints stick
    # The trapezoidal rule of the work costs 1e-4 of it.
    assert lost == pytest.approx(first - last, rel=1e-3)


def test_the_order_is_four_across_events() -> None:
    """Several stops, reversals and breakaways, none of them at the end of a step."""

    def end(substeps: int) -> np.ndarray:
        arm = arm_of(swinging(substeps=substeps), period=0.05)
        start_swinging(arm)
        for tick in range(16):
            arm.step(25.0 * math.cos(0.4 * tick), -6.0 * math.sin(0.5 * tick))
        return np.concatenate([arm.q, arm.qd])

    exact = end(4096)
    errors = [np.linalg.norm(end(n) - exact) for n in (64, 128, 256)]
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.35)


@MODELS
def test_without_friction_the_motion_is_that_of_the_plain_plant(model: str) -> None:
    """Nearly no friction: equal to the other integrator of the same model."""
    plain = PlantParameters(model=model, modes=2)
    arms = [arm_of(replace(plain, coulomb_friction=(f, f)), (0.5, -0.8)) for f in (0.0, 1e-12)]
    assert not isinstance(arms[0], DrivenPlant)
    assert isinstance(arms[1], DrivenPlant)
    for _ in range(500):
        for arm in arms:
            arm.step(20.0, -5.0)
    assert arms[1].q == pytest.approx(arms[0].q, abs=1e-9)
    assert arms[1].deflections() == pytest.approx(arms[0].deflections(), abs=1e-8)
