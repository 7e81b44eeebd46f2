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
Write two recordings of an arm that is not quite the given scenario's, as a rig would.

    python3 examples/example_recording.py my_arm.yaml

The true arm is softer and heavier than the scenario says.  A joint controller moves it; the
encoders have 1e-4 rad a count, and the gauges noise and a low-pass of 4 Hz.
"""

from __future__ import annotations

import math
import sys
from typing import Any

from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.identification.setting import load_setting
import numpy as np
from scipy.signal import bilinear, lfilter

PERIOD, DURATION = 0.002, 6.0
TRUE = {
    'plant.flexural_rigidity.1': 3.4, 'plant.flexural_rigidity.2': 0.9,
    'plant.link_end_mass': 1.35, 'plant.link_damping.1': 0.02, 'plant.link_damping.2': 0.005,
}  # fmt: skip
GAINS = (0.9, 1.1)


def fly(setting: Any, mirror: float) -> np.ndarray:
    """Return rows of theta1, theta2, deflections / lengths, torques, moved by a joint PD law."""
    plant, lengths = make_plant(setting.config), setting.config.plant.length
    rows = []
    for k in range(round(DURATION / PERIOD)):
        t = k * PERIOD
        goals = mirror * (0.5 if t % 3.0 < 1.5 else -0.3), 0.4 if (t + 0.7) % 2.4 < 1.2 else 0.0
        torques = [
            stiffness * (goals[j] - plant.q[j]) - damping * plant.qd[j]
            for j, stiffness, damping in ((0, 40.0, 12.0), (1, 8.0, 1.6))
        ]
        ends = plant.deflections()
        bends = [ends[j] / lengths[j] for j in (0, 1)]
        rows.append([*plant.q[:2], *bends, *torques])
        plant.step(*torques)
    return np.array(rows)


def main(scenario: str) -> None:
    """Write first.csv and second.csv."""
    setting = load_setting(scenario).with_numbers(TRUE)
    omega = 2.0 * math.pi * 4.0
    low_pass = bilinear([omega**2], [1.0, 1.4 * omega, omega**2], fs=1.0 / PERIOD)
    for number, (name, mirror) in enumerate((('first', 1.0), ('second', -1.0))):
        rows, random = fly(setting, mirror), np.random.default_rng(number)
        columns = {'t_s': PERIOD * np.arange(len(rows))}
        for j in (0, 1):
            columns[f'theta{j + 1}_rad'] = np.round(rows[:, j] / 1e-4) * 1e-4
            noise = 2e-5 * random.standard_normal(len(rows))
            strain = lfilter(*low_pass, GAINS[j] * rows[:, 2 + j])
            columns[f'strain{j + 1}_rad'] = strain + noise
            columns[f'tau{j + 1}_nm'] = rows[:, 4 + j]
        table, header = np.stack(list(columns.values()), axis=1), ','.join(columns)
        np.savetxt(f'{name}.csv', table, delimiter=',', header=header, comments='')


if __name__ == '__main__':
    main(sys.argv[1])
