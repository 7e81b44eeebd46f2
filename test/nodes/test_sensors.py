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

"""Sensors that are noisy, slow and late: the same numbers as processes and in one process."""

from __future__ import annotations

import csv
from pathlib import Path

from flexarm_ros.cli import main
from nodetools import flexarm
import numpy as np
import pytest

pytestmark = pytest.mark.nodes
SETTINGS = [
    'duration=0.2', 'seed=7', 'plant.model=full', 'plant.modes=2', 'encoder.noise_std=1e-3',
    'encoder.resolution=1e-4', 'encoder.latency=0.0005', 'tip_sensor.noise_std=0.01',
    'tip_sensor.rate=250', 'tip_sensor.latency=0.0031', 'tip_sensor.latency_model=pade2',
    'tip_sensor.measurand=elastic',
]  # fmt: skip


def flown(command: str, out: Path, *more: str) -> Path:
    words = [word for key in (*SETTINGS, *more) for word in ('--set', key)]
    words = [command, 'pd_tip', *words, '--no-pictures', '--out', str(out)]
    if command == 'simulate':
        assert main(words) == 0
    else:
        done = flexarm(*words)
        assert done.returncode == 0, done.stderr
    return out


def sensed(out: Path) -> np.ndarray:
    with (out / 'trajectory.csv').open(newline='') as file:
        return np.array([float(row['meas_x']) for row in csv.DictReader(file)])


def test_noise_is_seeded_and_the_same_in_run_and_simulate(tmp_path: Path) -> None:
    nodes = flown('run', tmp_path / 'nodes')
    alone = flown('simulate', tmp_path / 'alone')
    other = flown('simulate', tmp_path / 'other', 'seed=8')
    for file in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (nodes / file).read_bytes() == (alone / file).read_bytes()
    # The noise is there: of another seed, and of the size that was asked for.
    jumps = np.diff(sensed(alone)[::4])
    assert 0.005 < jumps.std() < 0.03
    assert np.abs(sensed(alone) - sensed(other)).max() > 0.005
    # 250 Hz: held for four ticks.
    assert np.all(np.diff(sensed(alone).reshape(-1, 4), axis=1) == 0.0)
