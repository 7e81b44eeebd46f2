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

"""Drives: the lag's closed form, crossing of the gap, impacts, energy, order of the integrator."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.driven.dynamics import MOST_EVENTS
from flexarm_ros.core.arm.driven.plant import DrivenPlant
from flexarm_ros.core.arm.full.model import link_bases, make_constants_on
from flexarm_ros.core.arm.full.plant import FullPlant
from flexarm_ros.core.parameters.rig import ActuatorParameters, DisturbanceParameters
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import highest_frequency
import numpy as np
import pytest

MODELS = pytest.mark.parametrize('model', ['eq14', 'full'])
HUB, LINK = 2.0, 0.5
ROTOR = 0.9 * HUB


def one_link(model: str, **keys: object) -> PlantParameters:
    """
    Return an arm whose shoulder turns a stiff beam of inertia LINK beside its hub of HUB.

    Link 2 is next to nothing, and friction holds the elbow.
    """
    plant = PlantParameters(
        model=model, hub_inertia=(HUB, 0.01), length=(1.0, 0.1), mass_density=(1.5, 1e-6),
        flexural_rigidity=(1e4, 1e-7), coulomb_friction=(0.0, 1e3), damping_ratio=0.2,
        basis='craig_bampton',
    )  # fmt: skip
    return replace(plant, **keys)  # type: ignore[arg-type]


def bare(plant: PlantParameters) -> FullPlant:
    """Return the arm without friction and without the rotor of its shoulder."""
    hubs = (HUB - ROTOR, plant.hub_inertia[1])
    return FullPlant(
        RunConfig(plant=replace(plant, hub_inertia=hubs, coulomb_friction=(0.0, 0.0)))
    )


def driven(
    plant: PlantParameters, period: float = 1e-3, bandwidth=(0.0, 0.0), backlash=(0.0, 0.0)
) -> DrivenPlant:
    drive = ActuatorParameters(bandwidth=bandwidth, backlash=backlash)
    config = RunConfig(
        run=RunParameters(control_period=period), plant=plant, further=(('actuator', drive),)
    )
    return DrivenPlant(config, highest_frequency(config))


@MODELS
def test_the_torque_follows_its_set_point_as_a_first_order_lag(model: str) -> None:
    """J w' = u + (tau0 - u) exp(-r t), tick by tick with another u; exact but for RK4."""
    plant = PlantParameters(
        model=model, hub_inertia=(HUB, HUB), length=(0.1, 0.1), mass_density=(1e-6, 1e-6),
        flexural_rigidity=(1e-7, 1e-7), substeps=10,
    )  # fmt: skip
    arm, rate, torque, speed = driven(plant, 0.01, (50.0, 50.0)), 100.0 * math.pi, 0.0, 0.0
    for target in (1.0, 1.0, -2.0, 0.5):
        arm.step(torque, 0.0, target, 0.0)
        fall = math.exp(-rate * 0.01)
        speed += (target * 0.01 + (torque - target) * (1.0 - fall) / rate) / HUB
        torque = target + (torque - target) * fall
        assert arm.qd[0] == pytest.approx(speed, rel=2e-5)


@MODELS
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_the_drive_crosses_its_gap_and_takes_the_joint_along(model: str, sign: float) -> None:
    """From the middle: the joint is at rest until the known time, then both have the impulse."""
    gap, torque = 0.01, 3.0
    arm = driven(one_link(model), backlash=(gap, 0.0))
    time = math.sqrt(gap * ROTOR / torque)
    before = int(time / 1e-3)
    for _ in range(before):
        arm.step(sign * torque, 0.0)
        assert arm.qd.tolist() == [0.0] * 4
    assert arm.drives[1, 0] == pytest.approx(sign * torque * before * 1e-3 / ROTOR, rel=1e-9)
    arm.step(sign * torque, 0.0)
    assert sign * arm.qd[0] > 0.0
    for _ in range(300):
        arm.step(sign * torque, 0.0)
    assert arm.qd[0] == pytest.approx(
        sign * torque * (before + 301) * 1e-3 / (HUB + LINK), rel=0.02
    )
    assert arm.drives[0, 0] - arm.q[0] == pytest.approx(sign * 0.5 * gap, abs=1e-12)
    assert arm.drives[1, 0] == arm.qd[0]


def test_impacts_keep_the_momentum_and_lose_energy() -> None:
    """A drive that is thrown against its link, which bounces on and off it until they agree."""
    plant = one_link('full')
    arm, body = driven(plant, backlash=(0.02, 0.0)), bare(plant)
    arm.drives[1, 0] = 1.0
    contacts = 0
    for _ in range(2500):
        arm.step(0.0, 0.0)
        play = arm.drives[0, 0] - arm.q[0]
        contacts += int(play == 0.01)
        assert abs(play) <= 0.01 * (1.0 + 1e-12)
        body.set_state(arm.q, arm.qd)
        assert body.momentum() + ROTOR * arm.drives[1, 0] == pytest.approx(ROTOR, rel=1e-6)
    assert 0 < contacts < 2500
    # In the end both turn together: ROTOR / (HUB + LINK) of the speed.
    for rate in (arm.qd[0], arm.drives[1, 0]):
        assert rate == pytest.approx(ROTOR / (HUB + LINK), rel=0.02)


def swinging(**keys: object) -> PlantParameters:
    return PlantParameters(
        model='full', modes=2, hub_inertia=(3.0, 1.5), coulomb_friction=(6.0, 3.0), **keys,  # type: ignore[arg-type]
    )  # fmt: skip


def test_the_order_is_four_across_impacts_and_lags() -> None:
    def end(substeps: int) -> np.ndarray:
        arm = driven(swinging(substeps=substeps), 0.05, (8.0, 20.0), (0.02, 0.03))
        arm.set_state([0.2, 0.9, 0.1, 0.0, -0.1, 0.0], [0.5, -0.8, 0.0, 0.0, 0.0, 0.0])
        torque = np.zeros(2)
        for tick in range(8):
            target = 25.0 * math.cos(0.9 * tick), -6.0 * math.sin(0.7 * tick)
            arm.step(*torque, *target)
            torque = np.array(target) + (torque - target) * np.exp(
                -2.0 * math.pi * np.array([8.0, 20.0]) * 0.05
            )
        return np.concatenate([arm.q, arm.qd, arm.drives.ravel()])

    exact = end(4096)
    errors = [np.linalg.norm(end(n) - exact) for n in (128, 256, 512)]
    orders = [math.log2(a / b) for a, b in zip(errors, errors[1:], strict=False)]
    assert orders == pytest.approx([4.0, 4.0], abs=0.5)


@MODELS
def test_a_drive_at_rest_stays_at_its_end_of_the_gap(model: str) -> None:
    """Torque below the joint's friction: in contact, neither drift nor chatter in a minute."""
    plant = PlantParameters(model=model, coulomb_friction=(4.0, 4.0), damping_ratio=0.02)
    arm = driven(plant, 0.01, backlash=(0.01, 0.01))
    for _ in range(200):
        arm.step(3.0, -2.0)
    rest = arm.q.copy(), arm.drives.copy()
    for _ in range(6000):
        arm.step(3.0, -2.0)
    assert arm.qd[:2].tolist() == [0.0, 0.0]
    assert arm.q[:2].tolist() == rest[0][:2].tolist()
    assert arm.drives.tolist() == rest[1].tolist()
    assert arm.drives[0] - arm.q[:2] == pytest.approx([0.005, -0.005], abs=1e-12)


def disturbed(plant: PlantParameters, load: DisturbanceParameters | None = None) -> DrivenPlant:
    config = RunConfig(plant=plant, further=(('disturbance', load or DisturbanceParameters()),))
    return DrivenPlant(config, highest_frequency(config))


@pytest.mark.slow
@MODELS
def test_a_force_at_the_tip_bends_the_links_as_statics_says(model: str) -> None:
    """Both joints stick: a cantilever of two links; the force does the work that bends it."""
    plant = PlantParameters(
        model=model, modes=4, coulomb_friction=(1e4, 1e4), damping_ratio=0.5, length=(1.0, 1.5),
        flexural_rigidity=(2e3, 1e3),
    )  # fmt: skip
    arm = disturbed(plant)
    for _ in range(1500):
        arm.disturb(0.0, 0.4)
        arm.step(0.0, 0.0)
    bend2 = 0.4 * 1.5**3 / (3.0 * 1e3)
    bend1 = 0.4 * (1.0 / (3.0 * 2e3) + 1.5 / (2.0 * 2e3))
    found = arm.deflections()
    # Four cantilever modes hold a moment at their end to some percent only.
    assert found[0] == pytest.approx(bend1, rel=2e-3 if model == 'full' else 0.05)
    assert found[1] == pytest.approx(bend2, rel=2e-3)
    assert arm.q[:2].tolist() == [0.0, 0.0]


def test_a_grasp_keeps_the_momentum_and_a_release_the_rates() -> None:
    """At the first tick at or after their times; a grasp of a body at rest loses energy."""
    plant = PlantParameters(model='full', modes=2, hub_inertia=(3.0, 1.0), payload_mass=0.2)
    load = DisturbanceParameters(payload_times=(0.002, 0.0035), payload_masses=(1.5, 0.0))
    arm = disturbed(plant, load)
    arm.set_state([0.2, 0.9, 0.05, 0.0, -0.02, 0.0], [0.5, -0.8, 0.1, 0.0, 0.0, 0.2])
    bodies = {m: made(plant, m) for m in (0.2, 1.5, 0.0)}

    def measured(mass: float) -> tuple[float, float]:
        bodies[mass].set_state(arm.q, arm.qd)
        return bodies[mass].energy(), bodies[mass].momentum()

    energy, momentum = measured(0.2)
    for tick, mass in enumerate((0.2, 0.2, 1.5, 1.5, 0.0, 0.0)):
        rates = arm.qd.copy()
        arm.disturb(0.0, 0.0, load.payload_at(1e-3 * tick, 0.2))
        now = measured(mass)
        if tick == 2:
            assert now[0] < 0.9 * energy
            assert now[1] == pytest.approx(momentum, rel=1e-9)
        else:
            assert arm.qd.tolist() == rates.tolist()
        arm.step(0.0, 0.0)
        energy, momentum = measured(mass)
        assert (energy, momentum) == pytest.approx(now, rel=1e-6)


def made(plant: PlantParameters, mass: float) -> FullPlant:
    """Return the plain arm with another payload, on the shape functions of ``plant``."""
    body = FullPlant(RunConfig(plant=plant))
    loaded = replace(plant, payload_mass=mass)
    body.constants = make_constants_on(loaded, link_bases(plant))
    return body


def test_a_drive_that_leaves_its_contact_does_not_chatter() -> None:
    """Some events at an impact and at a reversal, none in between; the shipped arm as flown."""
    from flexarm_ros import scenario
    from flexarm_ros.core.run.loop import ClosedLoop

    loop = ClosedLoop(scenario.load('lab_arm', ['duration=3.0']))
    assert isinstance(loop.plant, DrivenPlant)
    events = []
    while loop.tick() is not None:
        events.append(loop.plant.events)
    assert len(events) == 3000
    assert 0 < max(events) <= loop.plant.substeps * MOST_EVENTS
    assert sum(events) < 600
