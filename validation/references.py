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

"""The two solved cases of test/reference: T1S, a bent arm, and T3, a step with the elbow held."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from validation.motion import Array, Case, fly, full_plant
from validation.nonminimum_phase import held, reversal, step_response
from validation.pictures import BLUE, GREY, new_figure, ORANGE
from validation.report import Section

DIRECTORY = Path(__file__).resolve().parent.parent / 'test' / 'reference'
LIMIT = 0.01
TIP_LIMIT = 3e-4
JUDGED = ('theta1', 'theta2', 'defl1')
"""Columns of T1S that are held to :data:`LIMIT` of their range; tip to :data:`TIP_LIMIT` m."""

SENSED = {'tip_y': 9.0, 'mid2_y': 6.75, 'elbow_y': 4.5}
"""Columns of T3, and the points' distances from the shoulder, m."""


def load(name: str) -> dict[str, Any]:
    """Return a reference solution; columns as arrays."""
    data = json.loads((DIRECTORY / f'{name}.json').read_text('utf-8'))
    return {key: np.array(v) if isinstance(v, list) else v for key, v in data.items()}


def _pulse(time: float) -> tuple[float, float]:
    return (20.0 * math.sin(2.0 * math.pi * time) if time < 1.0 else 0.0), 0.0


T1S = Case((0.0, 0.5 * math.pi), 3.0, torque=_pulse)


def t1s(modes: int, basis: str = 'arm_modes') -> dict[str, float]:
    """Return largest differences: of the range (angles, ``defl1``), and ``tip`` in m."""
    reference = load('T1S')
    motion = fly(full_plant(modes=modes, basis=basis), T1S)
    found: dict[str, float] = {}
    columns = {'theta1': 1, 'theta2': 2, 'defl1': 5, 'defl2': 6}
    for name, column in columns.items():
        error = np.abs(motion[:, column] - reference[name]).max()
        found[name] = float(error / np.ptp(reference[name]))
    apart = motion[:, 3:5] - np.column_stack([reference['tip_x'], reference['tip_y']])
    found['tip'] = float(np.hypot(*apart.T).max())
    return found


def t3(modes: int) -> dict[str, float]:
    """Return relative errors of the last crossings, and of the heights of the range."""
    reference, arm = load('T3'), held(0.0, modes)
    found = {
        f'{name} crossing': reversal(arm, SENSED[name]).time
        / float(reference[f'{name}_last_upward_zero_crossing'])
        - 1.0
        for name in ('tip_y', 'mid2_y')
    }
    times: Array = reference['t']
    for name, location in SENSED.items():
        error = np.abs(step_response(arm, location, times) - reference[name]).max()
        found[name] = float(error / np.ptp(reference[name]))
    return found


def run() -> Section:
    """Compute the tables."""
    section = Section('Two solved cases')
    rows = []
    for basis in ('arm_modes', 'craig_bampton', 'clamped_free'):
        for modes in range(1, 7) if basis == 'arm_modes' else (4, 6):
            found = t1s(modes, basis)
            shares = (f'{100.0 * found[name]:.2f}' for name in (*JUDGED, 'defl2'))
            rows.append([basis, modes, *shares, f'{1e3 * found["tip"]:.3f}'])
            if basis == 'arm_modes' and modes == 4:
                worst = max(found[name] for name in JUDGED)
                section.goal(
                    'T1S, N = 4: angles and deflection of link 1, of their range',
                    f'{worst:.2%}', '1 %', worst < LIMIT,
                )  # fmt: skip
                section.goal(
                    'T1S, N = 4: tip', f"{1e3 * found['tip']:.3f} mm", '0.3 mm',
                    found['tip'] < TIP_LIMIT,
                )  # fmt: skip
    section.say(
        'T1S, largest differences: angles and deflections in % of their range, tip in mm (link 2 '
        'bends by 0.8 mm in all):'
    )
    section.table(['basis', 'N', 'theta1', 'theta2', 'delta1', 'delta2', 'tip'], rows)
    section.say('T3, `arm_modes`, N functions a link: errors in %, of the range for the heights:')
    rows = []
    for modes in range(2, 7):
        found = t3(modes)
        rows.append([modes, *(f'{100.0 * value:.2f}' for value in found.values())])
        if modes == 4:
            worst = max(abs(found['tip_y crossing']), abs(found['mid2_y crossing']))
            section.goal(
                'T3, N = 4: last crossings of tip and 6.75 m point', f'{worst:.2%}', '1 %',
                worst < LIMIT,
            )  # fmt: skip
    section.table(['N', 'tip crossing', '6.75 m crossing', 'tip', '6.75 m', 'elbow'], rows)
    _draw(section)
    return section


def _draw(section: Section) -> None:
    reference, times = load('T1S'), load('T1S')['t']
    figure, axis = new_figure('T1S: end deflection of link 1')
    axis.plot(times, 1e3 * reference['defl1'], color=GREY, linewidth=3.0, label='reference')
    for modes, color, dashes in ((1, ORANGE, ':'), (4, BLUE, '--')):
        motion = fly(full_plant(modes=modes), T1S)
        axis.plot(
            motion[:, 0], 1e3 * motion[:, 5], dashes, color=color, label=f'full, N = {modes}'
        )
    axis.set_xlabel('time, s')
    axis.set_ylabel('mm')
    axis.legend()
    section.picture('t1s', figure, 'End deflection of link 1 in T1S and its reference')
