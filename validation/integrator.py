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

"""The integrator: order, steps a tick, and what a tick costs."""

from __future__ import annotations

from dataclasses import replace
import math
import time

from flexarm_ros.core.arm.plant import STABLE_PHASE
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import choose_integrator, highest_frequency
import numpy as np
from validation.motion import Array, full_plant, start
from validation.report import Section

PERIOD = 1e-3
CASES = (
    ('eq14', 0.01, (16, 32, 64)),
    ('full', 0.001, (4, 8, 16)),
    ('full', 0.01, (3, 4, 6)),
)
"""Model, tick (s), which decides the order in `full`, and steps per tick."""


def end_state(plant: PlantParameters, substeps: int, period: float = 0.01) -> Array:
    """Return positions and rates after 0.2 s under torques, bent and turning."""
    arm = start(replace(plant, substeps=substeps), (0.2, 1.0), (0.5, -1.0), period)
    modes = plant.modes
    for link in (0, 1):
        arm.q[2 + link * modes] = 0.1 - 0.2 * link
    for _ in range(round(0.2 / period)):
        arm.step(20.0, -10.0)
    return np.concatenate([arm.q, arm.qd])


def orders(plant: PlantParameters, period: float, counts: tuple[int, ...]) -> list[float]:
    """Return the observed order between each pair of numbers of substeps."""
    exact = end_state(plant, 16 * counts[-1], period)
    errors = [float(np.linalg.norm(end_state(plant, n, period) - exact)) for n in counts]
    return [
        math.log(errors[i] / errors[i + 1]) / math.log(counts[i + 1] / counts[i])
        for i in range(len(counts) - 1)
    ]


def cost(plant: PlantParameters) -> tuple[int, float]:
    """Return the steps a tick, and the CPU time of a tick in us: the best of 20 batches."""
    arm = start(plant, (0.0, 1.0), (0.5, 0.3))
    arm.step(0.0, 0.0)
    best = math.inf
    for _ in range(20):
        begin = time.process_time()
        for _ in range(50):
            arm.step(1.0, -0.5)
        best = min(best, (time.process_time() - begin) / 50.0)
    return arm.substeps, 1e6 * best


def run() -> Section:
    """Compute the tables."""
    section = Section('Integrator')
    found = {}
    for model, period, counts in CASES:
        plant = full_plant(modes=2, model=model, hub_inertia=(2.0, 2.0))
        run = RunParameters(control_period=period, duration=0.2)
        order, _ = choose_integrator(RunConfig(run=run, plant=plant))
        found[model, order] = orders(plant, period, counts)
    section.say(
        'Observed order from smaller steps, N = 2, 0.2 s of a bent arm under torques: '
        + '; '.join(
            f'`{model}`, order {order}: ' + ', '.join(f'{value:.2f}' for value in values)
            for (model, order), values in found.items()
        )
        + '.'
    )
    worst = max(
        abs(value / order - 1.0) for (_, order), values in found.items() for value in values
    )
    section.goal(
        'Order of the integrators, relative to theory', f'{worst:.3f}', '0.06', worst < 0.06
    )
    section.say(
        'Cost of a tick of 1 ms: highest frequency (rad/s), order and steps of the integrator, '
        'CPU time (us; best of 20 batches), and the smallest permitted `plant.substeps` '
        f'(a phase of {STABLE_PHASE:g} rad a step):'
    )
    rows, dearest = [], 0.0
    for model in ('eq14', 'full'):
        for hub in (0.0, 8.0):
            for modes in range(1, 7):
                plant = full_plant(model=model, modes=modes, hub_inertia=(hub, hub))
                highest = highest_frequency(RunConfig(plant=plant))
                order, _ = choose_integrator(RunConfig(plant=plant))
                steps, micros = cost(plant)
                dearest = max(dearest, micros)
                least = max(1, math.ceil(highest * PERIOD / STABLE_PHASE))
                rows.append(
                    [f'`{model}`', f'{hub:g}', modes, f'{highest:.0f}', order, steps,
                     f'{micros:.0f}', least]
                )  # fmt: skip
    section.table(
        ['model', 'hub, kg m^2', 'N', 'highest', 'order', 'steps', 'CPU time', 'fewest'], rows
    )
    section.goal(
        'Most expensive tick of 1 ms', f'{dearest:.0f} us',
        '1000 us', dearest < 1000.0,
    )  # fmt: skip
    return section
