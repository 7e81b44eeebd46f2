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

"""Laws that hold the true tip: bounds are the goals, not what came out."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from flexarm_ros import scenario
from flexarm_ros.core.control import make_law, PLANNING
from flexarm_ros.core.control.design import motion
from flexarm_ros.core.control.lqg import AdaptiveLaw
from flexarm_ros.core.run.checks import check
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.trajectory_rows import Rows
import numpy as np
import pytest

SIDE = ('duration=4.0',)
SOFT = 'plant.flexural_rigidity=[1508.4, 1508.4]'
STIFF = 'plant.flexural_rigidity=[1843.6, 1843.6]'
HEAVY = 'plant.mass_density=[0.3685, 0.3685]'
LATE = 'tip_sensor.latency=0.03432'


@lru_cache(maxsize=32)
def fly(name: str, *settings: str) -> tuple[ClosedLoop, dict]:
    config = scenario.load(name, settings)
    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    while (r := loop.tick()) is not None:
        metrics.add(rows.row(r.k, r.q, r.qd, r.deflections[:2], r.tip[1:3], r.torque))
    return loop, metrics.result()


@pytest.mark.parametrize('law', PLANNING)
def test_the_nominal_tip_keeps_to_the_smooth_side(law: str) -> None:
    loop, found = fly(f'{law}_smooth', *SIDE)
    assert loop.unstable is None
    assert found['tip_rms_error'] < 0.005
    assert found['tip_max_error'] < 0.010
    assert found['max_torque'] <= 80.0


@pytest.mark.parametrize('change', [SOFT, STIFF, LATE])
def test_lqg_bears_one_parameter_off(change: str) -> None:
    loop, found = fly('lqg_smooth', *SIDE, change)
    assert loop.unstable is None
    assert found['tip_rms_error'] < 0.020
    assert found['max_torque'] <= 80.0


def test_adaptive_learns_what_is_off() -> None:
    loop, found = fly('adaptive_smooth', *SIDE, SOFT, HEAVY, LATE)
    assert loop.unstable is None
    assert found['tip_rms_error'] < 0.020
    assert isinstance(loop.law, AdaptiveLaw)
    rigidity, density, latency, _, _ = loop.law.unknowns
    assert rigidity == pytest.approx(np.log(0.9), abs=0.02)
    assert density == pytest.approx(np.log(1.1), abs=0.02)
    assert latency == pytest.approx(0.00312, abs=0.0005)


@pytest.mark.parametrize('law', PLANNING)
def test_the_nominal_tip_follows_at_constant_speed(law: str) -> None:
    """Through the first corner; the start from rest dominates, so the whole run's rms is lower."""
    loop, found = fly(f'{law}_constant', 'duration=5.5')
    assert loop.unstable is None
    assert found['tip_overshoot'][0] < 0.05
    assert found['max_torque'] <= 150.0


@pytest.mark.parametrize('law', ['lqg', 'adaptive'])
def test_a_torque_limit_below_the_need_is_kept_and_forgotten(law: str) -> None:
    """At rest again after a limit that the heavier arm asks more of: nothing has wound up."""
    hold = (
        'trajectory.kind=waypoints', 'trajectory.waypoint_times=[0.0, 4.0]',
        'trajectory.waypoint_x=[-6.3, -6.3]', 'trajectory.waypoint_y=[-6.3, 0.0]',
        'controller.torque_limit=30.0', 'controller.plan.torque_share=1.0', 'duration=9.0',
        'plant.mass_density=[0.3685, 0.3685]',
    )  # fmt: skip
    config = scenario.load(f'{law}_smooth', hold)
    loop, rows, largest = ClosedLoop(config), Rows(config), 0.0
    row: tuple[float, ...] = ()
    while (r := loop.tick()) is not None:
        row = rows.row(r.k, r.q, r.qd, r.deflections[:2], r.tip[1:3], r.torque)
        largest = max(largest, abs(r.torque[0]), abs(r.torque[1]))
    assert largest == 30.0
    assert np.hypot(row[9] - row[15], row[10] - row[16]) < 0.05


def test_the_design_is_the_same_every_time() -> None:
    config = scenario.load('lqg_smooth', ['duration=0.5'])
    first = motion.plan_for(config)
    motion._plan.cache_clear()
    again = motion.plan_for(config)
    assert first is not again
    assert np.array_equal(first.dense, again.dense)


def test_the_plant_may_differ_from_the_model_at_no_cost() -> None:
    """One plan serves every plant: it depends on what the controller believes."""
    config = scenario.load('lqg_smooth', ['duration=0.5'])
    other = scenario.load('lqg_smooth', ['duration=0.5', SOFT, LATE, 'seed=7'])
    assert motion.plan_for(config) is motion.plan_for(other)
    assert make_law(config)._design is make_law(other)._design


def test_too_long_a_motion_is_named() -> None:
    config = scenario.load('lqg_smooth')
    long = replace(config, run=replace(config.run, duration=300.0))
    with pytest.raises(ValueError, match=r'^/\*\*\.duration: 300\.0 s, law lqg'):
        check(long)


def test_a_law_is_stable_with_more_modes_than_it_knows() -> None:
    loop, _ = fly('lqg_smooth', *SIDE, 'plant.modes=4')
    assert loop.unstable is None


@pytest.mark.slow
@pytest.mark.parametrize(
    'name', [f'{law}_{pace}' for law in PLANNING for pace in ('smooth', 'constant')]
)
def test_the_arm_stays_at_rest_for_a_minute(name: str) -> None:
    settings = (
        'duration=76.0', 'trajectory.kind=waypoints',
        'trajectory.waypoint_times=[0.0, 4.0, 8.0, 12.0, 16.0]',
        'trajectory.waypoint_x=[-6.3, -6.3, 6.3, 6.3, -6.3]',
        'trajectory.waypoint_y=[-6.3, 6.3, 6.3, -6.3, -6.3]', 'tip_sensor.noise_std=0.002',
    )  # fmt: skip
    config = scenario.load(name, settings)
    loop, rows, largest = ClosedLoop(config), Rows(config), 0.0
    while (r := loop.tick()) is not None:
        if r.k >= 70_000:
            row = rows.row(r.k, r.q, r.qd, r.deflections[:2], r.tip[1:3], r.torque)
            largest = max(largest, np.hypot(row[9] - row[15], row[10] - row[16]))
    assert loop.unstable is None
    assert largest < 0.010


@pytest.mark.slow
@pytest.mark.parametrize('signs', [(0.9, 1.1, 0.9), (1.1, 0.9, 1.1), (1.1, 1.1, 1.1)])
def test_adaptive_holds_the_second_square_with_all_three_off(signs: tuple[float, ...]) -> None:
    ei, density, latency = 1676.0 * signs[0], 0.335 * signs[1], round(0.0312 * signs[2], 9)
    config = scenario.load(
        'adaptive_smooth',
        [
            f'plant.flexural_rigidity=[{ei!r}, {ei!r}]',
            f'plant.mass_density=[{density!r}, {density!r}]',
            f'tip_sensor.latency={latency!r}', 'duration=32.0',
        ],
    )  # fmt: skip
    loop, rows, squares = ClosedLoop(config), Rows(config), 0.0
    while (r := loop.tick()) is not None:
        if r.k >= 16_000:
            row = rows.row(r.k, r.q, r.qd, r.deflections[:2], r.tip[1:3], r.torque)
            squares += (row[9] - row[15]) ** 2 + (row[10] - row[16]) ** 2
    assert loop.unstable is None
    assert np.sqrt(squares / 16_000) < 0.008
