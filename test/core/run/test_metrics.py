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

"""Metrics on data made by hand."""

from __future__ import annotations

import math
import tracemalloc

from flexarm_ros.core.parameters.sections import RunConfig, RunParameters, TrajectoryParameters
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.run.results.metrics import Metrics
import numpy as np
import pytest

CONFIG = RunConfig(run=RunParameters(control_period=0.1, duration=16.0))


def row(**values: float) -> tuple[float, ...]:
    return tuple(values.get(name, 0.0) for name in COLUMNS)


def fill(config: RunConfig, rows) -> dict:
    metrics = Metrics(config)
    for item in rows:
        metrics.add(item)
    return metrics.result()


def test_errors_are_distances_from_the_reference() -> None:
    rows = [
        row(rigid_x=1.0, rigid_y=1.0, ref_x=1.0, ref_y=1.0, tip_x=1.0, tip_y=2.0),
        row(rigid_x=3.0, rigid_y=4.0, tip_x=0.0, tip_y=-2.0),
        row(delta1=-0.5, delta2=0.3, tau1=7.0, tau2=-9.0),
    ]
    found = fill(CONFIG, rows)
    assert found['rms_error'] == pytest.approx(math.sqrt(25.0 / 3))
    assert found['max_error'] == pytest.approx(5.0)
    assert found['tip_rms_error'] == pytest.approx(math.sqrt((1 + 4) / 3))
    assert found['tip_max_error'] == pytest.approx(2.0)
    assert (found['max_deflection'], found['max_torque'], found['ticks']) == (0.5, 9.0, 3)


def test_rounding_is_no_error() -> None:
    """An arm that is put on its reference by the inverse kinematics is there to 1e-15 m."""
    there = {'ref_x': 6.0, 'ref_y': 3.0}
    off = {'rigid_x': 6.0 + 9e-16, 'rigid_y': 3.0, 'tip_x': 6.0, 'tip_y': 3.0 + 4e-16}
    found = fill(CONFIG, [row(**there, **off)])
    names = ('rms_error', 'max_error', 'tip_rms_error', 'tip_max_error')
    assert [found[name] for name in names] == [0.0] * 4
    off = {'rigid_x': 6.0 + 1e-12, 'rigid_y': 3.0, 'tip_x': 6.0, 'tip_y': 3.0 + 1e-12}
    found = fill(CONFIG, [row(**there, **off)])
    assert [found[name] for name in names] == pytest.approx([1e-12] * 4, rel=1e-3)


def square_rows(ticks: int = 160) -> list[tuple[float, ...]]:
    """Upper corner passed by 0.7 m (tip 0.9), the right one never, the lower by 0.2 m."""
    rows = []
    for k in range(ticks):
        values = {'rigid_x': 0.0, 'rigid_y': 0.0, 'tip_x': 0.0, 'tip_y': 0.0}
        if k == 39:
            values |= {'rigid_y': 20.0}  # before the switch: not an overshoot of it
        if k == 45:
            values |= {'rigid_y': 7.0, 'tip_y': 7.2}
        if k == 50:
            values |= {'rigid_y': 6.6}
        if k == 51:
            values |= {'rigid_y': 9.0}  # more than a second after it
        if k == 83:
            values |= {'rigid_x': 6.2}
        if k == 130:
            values |= {'rigid_y': -6.5}  # exactly one second after it
        rows.append(row(**values))
    return rows


def test_overshoot_is_along_the_old_direction_within_a_second() -> None:
    found = fill(CONFIG, square_rows())
    assert found['overshoot'] == pytest.approx([0.7, 0.0, 0.2])
    assert found['tip_overshoot'] == pytest.approx([0.9, 0.0, 0.0])
    assert found['max_overshoot'] == pytest.approx(0.7)


def test_a_run_broken_off_has_null_for_what_was_not_reached() -> None:
    found = fill(CONFIG, square_rows(60))
    assert found['overshoot'] == [pytest.approx(0.7), None, None]
    assert found['max_overshoot'] == pytest.approx(0.7)
    empty = fill(CONFIG, [])
    assert empty['rms_error'] is None
    assert empty['max_torque'] is None
    assert empty['overshoot'] == [None, None, None]
    assert empty['max_overshoot'] is None


def test_asking_in_between_changes_nothing() -> None:
    rows = [
        row(rigid_x=float(x), tip_y=float(x)) for x in np.random.default_rng(0).normal(size=160)
    ]
    metrics = Metrics(CONFIG)
    for item in rows:
        metrics.add(item)
        metrics.result()
    assert metrics.result() == fill(CONFIG, rows)


def test_what_is_not_finite_is_null() -> None:
    found = fill(CONFIG, [row(rigid_x=math.inf, delta1=math.inf)])
    assert found['rms_error'] is None
    assert found['max_deflection'] is None
    assert found['tip_max_error'] == 0.0


def test_waypoints_and_hold() -> None:
    trajectory = TrajectoryParameters(
        kind='waypoints',
        waypoint_times=(0.0, 1.0, 2.0),
        waypoint_x=(2.0, 4.0, 4.0),
        waypoint_y=(0.0, 0.0, 3.0),
    )
    config = RunConfig(run=CONFIG.run, trajectory=trajectory)
    rows = [
        row(rigid_x=4.25 if k == 12 else 0.0, rigid_y=3.5 if k == 30 else 0.0) for k in range(40)
    ]
    assert fill(config, rows)['overshoot'] == pytest.approx([0.25, 0.5])
    hold = RunConfig(run=CONFIG.run, trajectory=TrajectoryParameters(kind='hold'))
    assert fill(hold, rows)['overshoot'] == []


def test_overlapping_seconds_at_short_sides() -> None:
    trajectory = TrajectoryParameters(side_time=0.5)
    config = RunConfig(run=RunParameters(control_period=0.1, duration=2.0), trajectory=trajectory)
    rows = [row(rigid_x=0.0, rigid_y=6.4 if k == 14 else 0.0) for k in range(20)]
    assert fill(config, rows)['overshoot'] == pytest.approx([0.1, 0.0, 0.0])


def test_memory_does_not_grow_with_the_run() -> None:
    config = RunConfig(
        run=RunParameters(duration=1e4), trajectory=TrajectoryParameters(kind='hold')
    )
    metrics = Metrics(config)
    item = row(rigid_x=1.0)
    for _ in range(1024):
        metrics.add(item)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(16 * 1024):
        metrics.add(item)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 10_000
