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

"""The plant of a scenario, by ``plant.model``, at its initial state."""

from __future__ import annotations

from dataclasses import replace

from flexarm_ros.core.arm.plant import choose_substeps, Plant
from flexarm_ros.core.arm.plant_eq14 import Eq14Matrices, Eq14Plant
from flexarm_ros.core.numerics.runge_kutta import RK4
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import initial_angles
import numpy as np


def highest_frequency(config: RunConfig) -> float:
    """Return the highest natural rate of the plant, rad/s, over all elbow angles."""
    drive, load, plant = config.section('actuator'), config.section('disturbance'), config.plant
    parted = (0.0, 0.0) if drive is None else drive.rotors(plant.hub_inertia)
    if load is not None and load.varies_payload:
        lightest = load.lightest(plant.payload_mass)
        config = replace(config, plant=replace(plant, payload_mass=lightest))
    if plant.model == 'full':
        from flexarm_ros.core.arm.full import plant as plant_full

        return float(plant_full.highest_frequency(config, parted))
    matrices = Eq14Matrices(config.plant)
    matrices.mass[0, 0, 0] -= parted[0]
    matrices.mass[0, 1, 1] -= parted[1]
    return matrices.highest_rate()


def choose_integrator(config: RunConfig) -> tuple[int, int]:
    """
    Return the order of the plant's integrator and its steps per tick.

    Raises ``ValueError`` if ``plant.substeps`` is given but too small.
    """
    if config.plant.model == 'full' and not is_driven(config):
        from flexarm_ros.core.arm.full import plant as full

        return full.choose_integrator(config)
    period, highest = Timeline.of(config.run).period, highest_frequency(config)
    if is_driven(config):
        from flexarm_ros.core.arm.driven.plant import driven_steps

        return RK4.order, driven_steps(config.plant, period, highest)
    return RK4.order, choose_substeps(config.plant, period, highest)


def check_substeps(config: RunConfig) -> None:
    """Raise ``ValueError`` if ``plant.substeps`` is given but too small."""
    if config.plant.substeps is not None:
        choose_integrator(config)


def is_driven(config: RunConfig) -> bool:
    """Return whether friction or drives make the plant of ``config`` a ``DrivenPlant``."""
    plant = config.plant
    coulomb = (*plant.coulomb_friction, *(plant.coulomb_friction_negative or ()))
    # Viscous friction alone is among the damping of eq14.
    friction = any(coulomb) or (plant.model == 'full' and any(plant.viscous_friction))
    return friction or any(config.section(name) for name in ('actuator', 'disturbance'))


def make_plant(config: RunConfig) -> Plant:
    """
    Return the plant of ``config`` at its initial state.

    The joint angles are ``plant.initial_position``, by default those of the reference at the
    start; the links are straight, without elastic rates.  Raises ``ValueError``, which names the
    key, for too few substeps or an unreachable start.
    """
    plant: Plant
    if is_driven(config):
        from flexarm_ros.core.arm.driven.plant import DrivenPlant

        plant = DrivenPlant(config, highest_frequency(config))
    elif config.plant.model == 'full':
        from flexarm_ros.core.arm.full.plant import FullPlant

        plant = FullPlant(config)
    else:
        plant = Eq14Plant(config)
    q, qd = np.zeros(len(plant.names)), np.zeros(len(plant.names))
    q[:2] = initial_angles(config)
    if config.plant.initial_velocity is not None:
        qd[:2] = config.plant.initial_velocity
    plant.set_state(q, qd)
    return plant
