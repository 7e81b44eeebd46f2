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

"""Kinematics: round trips, derivatives and rigid limits."""

from __future__ import annotations

import math

from flexarm_ros.core.arm.beam import ClampedFreeModes
from flexarm_ros.core.arm.kinematics import (
    inverse_kinematics,
    jacobian,
    make_point,
    rigid_point,
    round_off,
)
from flexarm_ros.core.parameters.sections import PlantParameters
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

lengths = st.tuples(st.floats(0.5, 10.0), st.floats(0.5, 10.0))
angle = st.floats(-3.1, 3.1)


@given(lengths, angle, st.floats(0.01, 3.13))
def test_inverse_of_the_forward_kinematics(arm, theta1: float, theta2: float) -> None:
    x = arm[0] * math.cos(theta1) + arm[1] * math.cos(theta1 + theta2)
    y = arm[0] * math.sin(theta1) + arm[1] * math.sin(theta1 + theta2)
    found1, found2 = inverse_kinematics(arm, x, y)
    assert 0.0 <= found2 <= math.pi
    assert found2 == pytest.approx(theta2, abs=1e-6)
    back = make_point(PlantParameters(length=arm), sum(arm), False)
    q = np.array([found1, found2, 0.0, 0.0])
    assert back(q, np.zeros(4))[:2] == pytest.approx((x, y), abs=1e-9)


@given(lengths, st.floats(1e-6, 10.0), angle)
def test_out_of_reach_is_refused(arm, excess: float, direction: float) -> None:
    radius = sum(arm) * (1 + 1e-8) + excess
    with pytest.raises(ValueError, match='reached are'):
        inverse_kinematics(arm, radius * math.cos(direction), radius * math.sin(direction))


def test_straight_arm_within_rounding_is_reached() -> None:
    theta1, theta2 = inverse_kinematics((4.5, 4.5), 9.0 * math.cos(0.3), 9.0 * math.sin(0.3))
    assert (theta1, theta2) == pytest.approx((0.3, 0.0), abs=1e-7)


RIGID_PARTS = {'hub_radius': (0.6, 0.3), 'end_offset': (0.4, 0.7)}


@pytest.mark.parametrize('model', ['eq14', 'full'])
@pytest.mark.parametrize('location', [1.3, 4.5, 6.75, 9.0, 11.0])
@pytest.mark.parametrize('elastic', [False, True])
def test_velocity_is_the_derivative_of_position(model, location: float, elastic: bool) -> None:
    plant = PlantParameters(model=model, modes=3, **(RIGID_PARTS if location > 9.0 else {}))
    point = make_point(plant, location, elastic)
    rng = np.random.default_rng(2)
    q, qd = 0.3 * rng.normal(size=8), rng.normal(size=8)
    h = 1e-6
    ahead, behind = point(q + h * qd, qd), point(q - h * qd, qd)
    velocity = [(a - b) / (2 * h) for a, b in zip(ahead[:2], behind[:2], strict=True)]
    assert point(q, qd)[2:] == pytest.approx(velocity, rel=1e-7, abs=1e-7)


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_straight_links_move_as_rigid_ones(model: str) -> None:
    plant = PlantParameters(model=model, modes=2, length=(4.0, 5.0))
    q, qd = np.array([0.4, 1.1, 0, 0, 0, 0]), np.array([0.7, -0.2, 0, 0, 0, 0])
    for location in (2.0, 4.0, 6.0, 9.0):
        rigid = make_point(plant, location, False)(q, qd)
        assert make_point(plant, location, True)(q, qd) == pytest.approx(rigid, abs=1e-12)


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_rigid_parts_follow_the_tangents(model: str) -> None:
    """The hub along the joint's angle, the end along the tangent of the bent link's end."""
    plant = PlantParameters(model=model, modes=2, **RIGID_PARTS)
    q, rest = np.array([0.3, -0.7, 0.2, 0.05, -0.1, 0.02]), np.zeros(6)

    def at(location: float) -> np.ndarray:
        return np.array(make_point(plant, location, True)(q, rest)[:2])

    assert at(0.6) == pytest.approx(0.6 * np.array([math.cos(0.3), math.sin(0.3)]))
    bend, elbow = at(5.1), at(5.5)
    along = np.array([math.cos(0.3), math.sin(0.3)])
    across = np.array([-along[1], along[0]])
    slope = float(across @ (bend - at(5.1 - 1e-6))) / 1e-6
    shorter = 0.5 * slope**2 if model == 'full' else 0.0
    assert across @ (elbow - bend) == pytest.approx(0.4 * slope, rel=1e-5)
    assert along @ (elbow - bend) == pytest.approx(0.4 * (1.0 - shorter), rel=1e-5)


def test_bent_arm_drawn_by_hand() -> None:
    """Straight arm along x, link 1 bent: the elbow goes left and link 2 turns with it."""
    plant = PlantParameters()
    link = ClampedFreeModes(4.5, 0.335, 1676.0, 1)
    q = np.array([0.0, 0.0, 2.0, -1.0])
    bend1, turn = 2.0 * link.shape(4.5)[0], 2.0 * link.slope(4.5)[0]
    bend2 = -1.0 * link.shape(4.5)[0]
    elbow = make_point(plant, 4.5, True)(q, np.zeros(4))
    assert elbow[:2] == pytest.approx((4.5, bend1))
    tip = make_point(plant, 9.0, True)(q, np.zeros(4))
    assert tip[0] == pytest.approx(4.5 + 4.5 * math.cos(turn) - bend2 * math.sin(turn))
    assert tip[1] == pytest.approx(bend1 + 4.5 * math.sin(turn) + bend2 * math.cos(turn))


@given(angle, angle, st.floats(0.0, 9.0))
def test_jacobian_maps_joint_rates_to_velocities(th1: float, th2: float, location: float) -> None:
    j11, j12, j21, j22 = jacobian((4.5, 4.5), th1, th2, location)
    point = make_point(PlantParameters(), location, False)
    _, _, vx, vy = point(np.array([th1, th2]), np.array([0.3, -1.2]))
    assert (j11 * 0.3 - j12 * 1.2, j21 * 0.3 - j22 * 1.2) == pytest.approx((vx, vy), abs=1e-12)


@given(lengths, st.booleans(), st.floats(0.0, 17.0), st.booleans(), angle)
def test_the_way_there_and_back_is_within_round_off(
    arm, equal: bool, near: float, inner: bool, direction: float
) -> None:
    """Also where the arm is stretched, or folded with its tip at the shoulder."""
    arm = (arm[0], arm[0]) if equal else arm
    low, high = abs(arm[0] - arm[1]), sum(arm)
    part = (high - low) * 10.0**-near
    radius = low + part if inner else high - part
    x, y = radius * math.cos(direction), radius * math.sin(direction)
    back = rigid_point(*arm, *inverse_kinematics(arm, x, y), 0.0, 0.0)
    bound = round_off(arm, math.hypot(x, y))
    assert math.hypot(back[0] - x, back[1] - y) <= bound
    assert bound < (1e-13 if radius > 0.1 * high else 1e-6)
