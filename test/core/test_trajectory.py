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

"""References: square, hold, way points, their delay and their reach."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.parameters.sections import (
    PlantParameters,
    RunConfig,
    RunParameters,
    TrajectoryParameters,
)
from flexarm_ros.core.trajectory import (
    check_reachable,
    initial_angles,
    make_path,
    Reference,
    rest_to_rest,
)
from hypothesis import given
from hypothesis import strategies as st
import pytest


def config(**keys) -> RunConfig:
    return RunConfig(trajectory=TrajectoryParameters(**keys))


WAYPOINTS = {
    'kind': 'waypoints',
    'waypoint_times': (0.0, 1.0, 3.0, 4.0),
    'waypoint_x': (3.0, 5.0, 5.0, 5.0),
    'waypoint_y': (0.0, 0.0, 4.0, 4.0),
}


def test_square_is_clockwise_from_lower_left() -> None:
    reference = Reference(config())
    assert reference.at(0)[:4] == (-6.3, -6.3, 0.0, 3.15)
    assert reference.at(2000)[:2] == pytest.approx((-6.3, 0.0))
    # At a corner the velocity is already that of the side that begins there.
    assert reference.at(4000)[:4] == pytest.approx((-6.3, 6.3, 3.15, 0.0))
    assert reference.at(8000)[:4] == pytest.approx((6.3, 6.3, 0.0, -3.15))
    assert reference.at(12000)[:4] == pytest.approx((6.3, -6.3, -3.15, 0.0))
    assert reference.at(15999)[:2] == pytest.approx((-6.3 + 0.00315, -6.3))
    assert reference.at(18000) == reference.at(2000)


@given(st.integers(0, 40_000), st.integers(0, 3_000_000_000))
def test_delayed_command_is_the_reference_of_that_time(k: int, delay: int) -> None:
    reference = Reference(config())
    reference.set_delay_ns(delay)
    time = k * 1_000_000 - delay
    expected = (-6.3, -6.3, 0.0, 0.0) if time < 0 else make_path(config()).at(time)[:4]
    assert reference.command(k) == expected


def test_delay_from_the_scenario_and_its_check() -> None:
    reference = Reference(config(delay=0.001238))
    assert reference.command(1) == (-6.3, -6.3, 0.0, 0.0)
    assert reference.command(2) == pytest.approx((-6.3, -6.3 + 3.15 * 0.000762, 0.0, 3.15))
    with pytest.raises(ValueError, match='^trajectory.delay'):
        reference.set_delay_ns(-1)


def test_hold() -> None:
    assert Reference(config(kind='hold', hold_position=(3.0, 4.0))).at(123) == (3, 4, 0, 0, 0, 0)
    assert Reference(config(kind='hold')).at(5)[:2] == (-6.3, -6.3)
    bent = replace(config(kind='hold'), plant=PlantParameters(initial_position=(0.0, math.pi / 2)))
    assert Reference(bent).at(0)[:2] == pytest.approx((4.5, 4.5))


def test_waypoints_and_the_rest_after_them() -> None:
    reference = Reference(config(**WAYPOINTS))
    assert reference.at(500) == (4.0, 0.0, 2.0, 0.0, 0.0, 0.0)
    assert reference.at(2000) == (5.0, 2.0, 0.0, 2.0, 0.0, 0.0)
    assert reference.at(3500)[:4] == reference.at(9000)[:4] == (5.0, 4.0, 0.0, 0.0)


@pytest.mark.parametrize('kind', [{}, WAYPOINTS])
def test_smooth_rests_at_every_corner_and_is_consistent(kind) -> None:
    path = make_path(config(time_law='smooth', **kind))
    for side in path.sides:
        for time in (side.start_ns, side.start_ns + side.time_ns):
            assert path.at(time)[2:] == pytest.approx((0.0,) * 4, abs=1e-12)
        for part in (0.1, 0.37, 0.5, 0.9):
            time, h = side.start_ns + int(part * side.time_ns), 20_000
            ahead, here, behind = path.at(time + h), path.at(time), path.at(time - h)
            for i in (0, 1):
                rate = (ahead[i] - behind[i]) / (2e-9 * h)
                second = (ahead[i + 2] - behind[i + 2]) / (2e-9 * h)
                assert here[i + 2] == pytest.approx(rate, abs=1e-6)
                assert here[i + 4] == pytest.approx(second, abs=1e-6)


def test_septic_has_no_jerk_at_its_ends() -> None:
    assert rest_to_rest(0.0) == (0.0, 0.0, 0.0)
    assert rest_to_rest(1.0) == pytest.approx((1.0, 0.0, 0.0), abs=1e-14)
    assert rest_to_rest(0.5)[0] == pytest.approx(0.5)
    assert rest_to_rest(1e-4)[2] / 1e-4 == pytest.approx(0.0, abs=0.1)


def test_switches() -> None:
    path = make_path(config())
    found = [path.switch(i) for i in range(5)]
    assert [s.time_ns for s in found] == [4 * 10**9 * (i + 1) for i in range(5)]
    assert [(s.along_x, s.along_y) for s in found] == [(0, 1), (1, 0), (0, -1), (-1, 0), (0, 1)]
    assert (found[0].x, found[0].y) == pytest.approx((-6.3, 6.3))
    turns = make_path(config(**WAYPOINTS))
    assert [turns.switch(i).time_ns for i in (0, 1)] == [10**9, 3 * 10**9]
    assert turns.switch(2) is None
    assert make_path(config(kind='hold')).switch(0) is None


@pytest.mark.parametrize(
    ('keys', 'lengths', 'key'),
    [
        ({'side': 13.0}, (4.5, 4.5), 'trajectory.side: 13.0'),
        ({'side': 4.0}, (6.0, 3.0), 'trajectory.side: 4.0'),
        ({'kind': 'hold', 'hold_position': (9.0, 1.0)}, (4.5, 4.5), 'trajectory.hold_position'),
        (WAYPOINTS | {'waypoint_y': (0.0, 0.0, 8.0, 8.0)}, (4.5, 4.5), 'trajectory.waypoint_x'),
    ],
)
def test_out_of_reach_names_the_key(keys, lengths, key: str) -> None:
    bad = replace(config(**keys), plant=PlantParameters(length=lengths))
    with pytest.raises(ValueError, match=f'^{key}.*allowed:'):
        check_reachable(bad)


def test_what_is_within_reach_passes() -> None:
    check_reachable(config())
    check_reachable(config(**WAYPOINTS))
    check_reachable(config(kind='hold', hold_position=(9.0, 0.0)))


@pytest.mark.parametrize(
    ('keys', 'key'),
    [
        ({'waypoint_times': None}, 'waypoint_times'),
        ({'waypoint_x': (1.0,)}, 'waypoint_x'),
        ({'waypoint_times': (0.0, 1.0, 1.0, 2.0)}, 'waypoint_times'),
        ({'waypoint_times': (0.5, 1.0, 2.0, 3.0)}, 'waypoint_times'),
    ],
)
def test_bad_waypoints_name_the_key(keys, key: str) -> None:
    with pytest.raises(ValueError, match=f'^trajectory.{key}'):
        make_path(config(**(WAYPOINTS | keys)))


def test_initial_angles() -> None:
    theta1, theta2 = initial_angles(config())
    assert theta2 > 0.0
    assert 4.5 * (math.cos(theta1) + math.cos(theta1 + theta2)) == pytest.approx(-6.3)
    assert 4.5 * (math.sin(theta1) + math.sin(theta1 + theta2)) == pytest.approx(-6.3)
    given = replace(config(), plant=PlantParameters(initial_position=(1.0, -2.0)))
    assert initial_angles(given) == (1.0, -2.0)
    with pytest.raises(ValueError, match='^trajectory.side: 30.0: start out of reach'):
        initial_angles(config(side=30.0))


def test_ticks_that_do_not_divide_the_side_time() -> None:
    run = RunParameters(control_period=0.003, duration=15.0)
    reference = Reference(replace(config(), run=run))
    assert reference.at(1333)[:4] == pytest.approx((-6.3, -6.3 + 3.999 * 3.15, 0.0, 3.15))
    assert reference.at(1334)[:4] == pytest.approx((-6.3 + 0.002 * 3.15, 6.3, 3.15, 0.0))
