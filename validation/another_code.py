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

"""Motions against Exudyn."""

from __future__ import annotations

import numpy as np
from validation import exudyn_arm
from validation.cases import BEYOND, CASES
from validation.exudyn_arm import FINE, STIFF
from validation.motion import Case, compare, Difference, fly, full_plant
from validation.report import Section

LIMIT = 0.01
TIP_LIMIT = 3e-3
JOLTED = ('free_bent', 'free_both')
"""Motions that start with straight links at speed."""

FIVE_SECONDS = ('torques_both', 'torques_opposed', *JOLTED)
"""Those of the goal for torques of 20 N m and for free flight, over 5 s."""


COUNTS = (2, 4, 6)

Row = list[object]


def differences(name: str, case: Case) -> tuple[list[Row], Difference]:
    """Return a motion's rows of the table, and how far the plant with N = 4 is from Exudyn."""
    reference = exudyn_arm.solve(case, STIFF if name in JOLTED else FINE)
    bent = f'{100.0 * np.abs(reference[:, 5:]).max() / exudyn_arm.LENGTH:.1f}'
    rows, judged = [], None
    for modes in COUNTS:
        motion = fly(full_plant(modes=modes, payload_mass=case.payload), case, every=20)
        found = compare(motion[: len(reference)], reference)
        shares = (f'{100.0 * value:.2f}' for value in (*found.angles, *found.deflections))
        tip = f'{1e3 * found.tip:.2f}', f'{100.0 * found.tip_of_range:.3f}'
        rows.append([f'`{name}`', bent, modes, *shares, *tip])
        judged = found if modes == 4 else judged
    assert judged is not None
    return rows, judged


def run() -> Section:
    """Compute the table."""
    section = Section('Another code: Exudyn')
    rows: list[Row] = []
    found: dict[str, Difference] = {}
    for name, case in (CASES | BEYOND).items():
        more, found[name] = differences(name, case)
        rows += more
    section.table(
        ['motion', 'bends by, % of length', 'N', 'theta1, %', 'theta2, %', 'delta1, %',
         'delta2, %', 'tip, mm', 'tip, %'], rows,
    )  # fmt: skip
    worst = max(max(found[name].angles) for name in CASES)
    share = max(found[name].tip_of_range for name in CASES)
    farthest = max(found[name].tip for name in FIVE_SECONDS)
    section.goal(
        f'Exudyn, {len(CASES)} motions, N = 4: joint angles, of their range', f'{worst:.2%}',
        '1 %', worst < LIMIT,
    )  # fmt: skip
    section.goal(
        f'Exudyn, {len(CASES)} motions, N = 4: tip, of its range', f'{share:.3%}', '1 %',
        share < LIMIT,
    )  # fmt: skip
    section.goal(
        'Free motion at 1.5 rad/s and torques of 20 N m over 5 s, N = 4: tip',
        f'{1e3 * farthest:.2f} mm', '3 mm', farthest < TIP_LIMIT,
    )  # fmt: skip
    return section
