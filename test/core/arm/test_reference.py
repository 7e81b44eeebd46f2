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

"""The full model against the solved cases in test/reference, as a user would fly them too."""

from __future__ import annotations

import csv
import math
from pathlib import Path

from flexarm_ros.cli import main
import numpy as np
import pytest
from validation import references
from validation.references import JUDGED, LIMIT, TIP_LIMIT

SCENARIO = """\
/**:
  ros__parameters: {duration: DURATION}
plant:
  ros__parameters: {model: full, modes: 4, hub_inertia: HUB, initial_position: START}
tip_sensor:
  ros__parameters: {location: 6.75, measurand: elastic}
controller:
  ros__parameters: {law: open_loop, torque_file: torque.csv}
"""


def flown(
    folder: Path, duration: float, hub: str, start: str, rows: list
) -> dict[str, np.ndarray]:
    """Simulate from files, as an outsider would, and return trajectory.csv's columns."""
    text = SCENARIO.replace('DURATION', str(duration)).replace('HUB', hub)
    (folder / 'case.yaml').write_text(text.replace('START', start))
    with (folder / 'torque.csv').open('w', newline='') as file:
        csv.writer(file).writerows([('t', 'tau1', 'tau2'), *rows])
    words = [str(folder / 'case.yaml'), '--no-bag', '--no-pictures', '--out', str(folder / 'out')]
    assert main(['simulate', *words]) == 0
    with (folder / 'out' / 'trajectory.csv').open(newline='') as file:
        table = list(csv.DictReader(file))
    return {name: np.array([float(row[name] or 'nan') for row in table]) for name in table[0]}


def test_t1s_from_the_command_line(tmp_path: Path) -> None:
    times = [i * 1e-3 for i in range(1001)]
    rows = [(t, 20.0 * math.sin(2.0 * math.pi * t), 0.0) for t in times]
    found = flown(tmp_path, 3.001, '[0, 0]', '[0, 1.5707963]', [*rows, (10.0, 0.0, 0.0)])
    reference = references.load('T1S')
    for ours, theirs in (('theta1', 'theta1'), ('theta2', 'theta2'), ('delta1', 'defl1')):
        error = np.abs(found[ours][::10] - reference[theirs]).max()
        assert error < LIMIT * np.ptp(reference[theirs])
    for axis in ('tip_x', 'tip_y'):
        assert np.abs(found[axis][::10] - reference[axis]).max() < TIP_LIMIT


def test_t3_from_the_command_line(tmp_path: Path) -> None:
    """A huge inertia on the rate of theta2 holds the elbow."""
    rows = [(0.0, 1.0, 0.0), (1.0, 1.0, 0.0)]
    found = flown(tmp_path, 0.4, '[0, 1000000.0]', '[0, 0]', rows)
    reference = references.load('T3')
    assert np.abs(found['theta2']).max() < 1e-6
    for column, name in (('tip_y', 'tip_y'), ('meas_y', 'mid2_y')):
        height, time = found[column], found['t']
        last = int(np.flatnonzero((height[:-1] < 0.0) & (height[1:] >= 0.0))[-1])
        crossing = time[last] - height[last] * 1e-3 / (height[last + 1] - height[last])
        expected = float(reference[f'{name}_last_upward_zero_crossing'])
        assert crossing == pytest.approx(expected, rel=LIMIT)


@pytest.mark.parametrize('modes', [4, 6])
def test_t1s(modes: int) -> None:
    found = references.t1s(modes)
    assert max(found[name] for name in JUDGED) < LIMIT
    assert found['tip'] < TIP_LIMIT


@pytest.mark.parametrize('modes', [4, 5, 6])
def test_t3(modes: int) -> None:
    found = references.t3(modes)
    assert abs(found['tip_y crossing']) < LIMIT
    assert abs(found['mid2_y crossing']) < LIMIT
    assert found['tip_y'] < 0.03
