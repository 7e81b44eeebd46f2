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

"""Energy, and the momentum conjugate to theta1: free and forced motions, both models."""

from __future__ import annotations

import math

from flexarm_ros.core.arm.full.plant import FullPlant
from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.arm.plant_eq14 import Eq14Matrices
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np
from validation.motion import Array, full_plant, start
from validation.pictures import BLUE, GREY, new_figure, ORANGE
from validation.report import Section

LIMIT = 1e-6
TICKS = 5000


def drift(plant: PlantParameters, pulse: float = 0.0) -> tuple[float, float]:
    """
    Return the largest relative change of energy and of momentum in 5 s of free motion.

    From theta2 = 1.2 rad at rates 1.5 and -0.7 rad/s with straight links;
    ``pulse``: torque on both joints, N m, in the tenth of a second before.
    """
    arm = start(plant, (0.0, 1.2), (1.5, -0.7))
    assert isinstance(arm, FullPlant)
    for tick in range(100 if pulse else 0):
        shape = math.sin(math.pi * (tick + 0.5) / 100.0)
        arm.step(pulse * shape, -pulse * shape)
    energy, momentum = arm.energy(), arm.momentum()
    changes = np.zeros(2)
    for tick in range(TICKS):
        arm.step(0.0, 0.0)
        if tick % 50 == 49:
            now = (arm.energy() / energy - 1.0, arm.momentum() / momentum - 1.0)
            changes = np.maximum(changes, np.abs(now))
    return float(changes[0]), float(changes[1])


def balance(plant: PlantParameters, period: float = 1e-3) -> tuple[float, float]:
    """
    Return what is missing in the balance of energy and of momentum of a forced motion.

    Smooth torques on both joints for 3 s.  Torques are held for a tick, so
    that their work is exactly the sum of torque times change of angle.
    Relative to the largest energy and momentum.
    """
    arm = start(plant, (0.0, 1.0), period=period)
    assert isinstance(arm, FullPlant)
    work, impulse, errors, sizes = 0.0, 0.0, np.zeros(2), np.zeros(2)
    for tick in range(round(3.0 / period)):
        time = (tick + 0.5) * period
        torque = (20.0 * math.sin(2.0 * math.pi * time), -15.0 * math.sin(5.0 * time))
        before = arm.q[:2].copy()
        arm.step(*torque)
        work += sum(t * (now - old) for t, now, old in zip(torque, arm.q[:2], before, strict=True))
        impulse += torque[0] * period
        state = np.array([arm.energy(), arm.momentum()])
        errors = np.maximum(errors, np.abs(state - (work, impulse)))
        sizes = np.maximum(sizes, np.abs(state))
    return float(errors[0] / sizes[0]), float(errors[1] / sizes[1])


def eq14_history(plant: PlantParameters) -> Array:
    """
    Return rows of both relative changes, tick by tick, for ``eq14`` in the same free motion.

    With the kinetic energy of its own mass matrix at each elbow angle.
    """
    matrices = Eq14Matrices(plant)
    arm = start(plant, (0.0, 1.2), (1.5, -0.7))
    rows = []
    for _ in range(TICKS + 1):
        mass = matrices.mass_at(float(arm.q[1]))
        kinetic = 0.5 * float(arm.qd @ mass @ arm.qd)
        elastic = 0.5 * float(matrices.stiffness @ arm.q**2)
        rows.append((kinetic + elastic, float(mass[0] @ arm.qd)))
        arm.step(0.0, 0.0)
    history = np.array(rows)
    return np.asarray(history / history[0] - 1.0)


def eq14_drift(plant: PlantParameters) -> tuple[float, float]:
    """Return the largest of both changes for ``eq14``."""
    largest = np.abs(eq14_history(plant)).max(axis=0)
    return float(largest[0]), float(largest[1])


def survival(modes: int) -> float:
    """Return when ``eq14`` without hub inertia becomes unstable in the free motion, s; or inf."""
    arm = start(full_plant(model='eq14', modes=modes), (0.0, 1.2), (1.5, -0.7))
    for tick in range(TICKS):
        arm.step(0.0, 0.0)
        if instability(arm) is not None:
            return 1e-3 * (tick + 1)
    return math.inf


def run() -> Section:
    """Compute the tables."""
    section = Section('Energy and momentum')
    section.say(
        'Largest relative change in 5 s of free, undamped motion, default integrator steps; from '
        'straight links at 1.5 and -0.7 rad/s, theta2 = 1.2 rad, and after torque pulses of '
        '20 N m and 0.1 s on both joints:'
    )
    rows, worst = [], 0.0
    for hub in (0.0, 8.0):
        for modes in range(1, 7):
            plant = full_plant(modes=modes, hub_inertia=(hub, hub))
            free, pulsed = drift(plant), drift(plant, 20.0)
            rows.append([f'{hub:g}', modes, *(f'{value:.1e}' for value in (*free, *pulsed))])
            worst = max(worst, *free, *pulsed)
    section.table(
        ['hub, kg m^2', 'N', 'energy', 'momentum', 'energy (pulsed)', 'momentum (pulsed)'], rows
    )
    section.goal(
        'Energy and momentum of free motions over 5 s, N = 1 to 6', f'{worst:.1e}', '1e-6',
        worst < LIMIT,
    )  # fmt: skip
    section.say(
        'Forced motion, 3 s, smooth torques on both joints; residual of the balance, relative '
        'to the largest energy and momentum:'
    )
    rows, worst = [], 0.0
    for modes in (1, 4):
        missing = balance(full_plant(modes=modes))
        rows.append([modes, *(f'{value:.1e}' for value in missing)])
        worst = max(worst, *missing)
    section.table(['N', 'energy - work', 'momentum - impulse'], rows)
    section.goal(
        'Balance of energy with work, of momentum with impulse', f'{worst:.1e}', '1e-6',
        worst < LIMIT,
    )  # fmt: skip
    _eq14(section)
    return section


def _eq14(section: Section) -> None:
    section.say('`eq14` with hubs of 8 kg m^2, free motion as above, largest relative change:')
    rows = []
    for modes in (1, 4):
        plant = PlantParameters(model='eq14', modes=modes, hub_inertia=(8.0, 8.0))
        rows.append([modes, *(f'{value:.3f}' for value in eq14_drift(plant))])
    section.table(['N', 'energy', 'momentum'], rows)
    lost = ', '.join(f'{1e3 * survival(modes):.0f} ms at N = {modes}' for modes in (1, 2, 4))
    section.say(f'Without hub inertia it diverges in this motion: after {lost}.')
    history = eq14_history(PlantParameters(model='eq14', modes=1, hub_inertia=(8.0, 8.0)))
    figure, axis = new_figure('Free motion of eq14, N = 1, hubs of 8 kg m²', (6.5, 3.0))
    times = 1e-3 * np.arange(len(history))
    for column, (name, color) in enumerate((('energy', BLUE), ('momentum', ORANGE))):
        axis.plot(times, 100.0 * history[:, column], color=color, label=name)
    axis.axhline(0.0, color=GREY, linewidth=0.8)
    axis.set_xlabel('time, s')
    axis.set_ylabel('change, %')
    axis.legend()
    section.picture('eq14', figure, 'Energy and momentum of eq14 in free motion')
