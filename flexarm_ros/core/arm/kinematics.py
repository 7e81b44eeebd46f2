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
Positions and velocities of points of the arm, and inverse kinematics.

Everything is in frame ``base``: origin at the shoulder, x and y in m, angles
counter-clockwise positive in rad.
"""

from __future__ import annotations

from functools import cached_property
import math
from typing import Any, NamedTuple

from flexarm_ros.core.arm.beam import ClampedFreeModes
from flexarm_ros.core.numerics.compiled import bound, compiled, FloatArray, inlined, interpreted
from flexarm_ros.core.numerics.elementary import acos, atan2, sincos
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np

Lengths = tuple[float, float]

_UNIT = 2.0**-53
_SQRT_8_UNIT = math.sqrt(8.0 * _UNIT)

REACH_TOLERANCE = 1e-9
"""Fraction of the reach by which rounding may move a point out of it."""


@compiled
def rigid_point(
    length1: float, beyond: float, th1: float, th2: float, dth1: float, dth2: float
) -> tuple[float, float, float, float]:
    """Return x, y, vx, vy of the point ``beyond`` m past the elbow of the rigid arm."""
    s1, c1 = sincos(th1)
    s2, c2 = sincos(th1 + th2)
    x1, y1 = length1 * c1, length1 * s1
    x2, y2 = beyond * c2, beyond * s2
    turn = dth1 + dth2
    return x1 + x2, y1 + y2, -y1 * dth1 - y2 * turn, x1 * dth1 + x2 * turn


@compiled
def elastic_point(
    q: FloatArray, qd: FloatArray, shapes: FloatArray, shortening: FloatArray
) -> tuple[float, float, float, float]:
    """
    Return x, y, vx, vy of a material point of the bent arm.

    ``shapes`` ``(3, N + 1)``: rows are the shape functions of link 1 at its
    end (or at the point, if it is on link 1), their slopes, and the shape
    functions of link 2 at the point; the last column holds the distances along
    link 1 (row 0) and along link 2 (row 2), m.  ``shortening``
    ``(2, N, N)``: the axial foreshortening of each up to there is
    q' S q / 2; of shape ``(2, 0, 0)`` if the model has none.
    """
    count = shapes.shape[1] - 1
    w1, dw1, turn, dturn, w2, dw2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        a, b, da, db = q[2 + i], q[2 + count + i], qd[2 + i], qd[2 + count + i]
        w1 += shapes[0, i] * a
        dw1 += shapes[0, i] * da
        turn += shapes[1, i] * a
        dturn += shapes[1, i] * da
        w2 += shapes[2, i] * b
        dw2 += shapes[2, i] * db
    u1, u2, du1, du2 = shapes[0, count], shapes[2, count], 0.0, 0.0
    for i in range(shortening.shape[1]):
        for j in range(shortening.shape[1]):
            u1 -= 0.5 * shortening[0, i, j] * q[2 + i] * q[2 + j]
            du1 -= shortening[0, i, j] * q[2 + i] * qd[2 + j]
            u2 -= 0.5 * shortening[1, i, j] * q[2 + count + i] * q[2 + count + j]
            du2 -= shortening[1, i, j] * q[2 + count + i] * qd[2 + count + j]
    s1, c1 = sincos(q[0])
    s2, c2 = sincos(q[0] + turn + q[1])
    rate = qd[0] + dturn + qd[1]
    x = u1 * c1 - w1 * s1 + u2 * c2 - w2 * s2
    y = u1 * s1 + w1 * c1 + u2 * s2 + w2 * c2
    along1, across1 = du1 - w1 * qd[0], dw1 + u1 * qd[0]
    along2, across2 = du2 - w2 * rate, dw2 + u2 * rate
    vx = along1 * c1 - across1 * s1 + along2 * c2 - across2 * s2
    vy = along1 * s1 + across1 * c1 + along2 * s2 + across2 * c2
    return x, y, vx, vy


class SensedPoint(NamedTuple):
    """
    A point of the arm for compiled code; `sensed_point` takes it.

    ``elastic``: the point of `elastic_point` with ``shapes`` and ``shortening``; otherwise
    that of `rigid_point`, ``along1`` m along link 1 and ``beyond`` m along link 2.
    """

    elastic: bool
    along1: float
    beyond: float
    shapes: FloatArray
    shortening: FloatArray


@inlined
def sensed_point(
    point: SensedPoint, q: FloatArray, qd: FloatArray
) -> tuple[float, float, float, float]:
    """Return x, y, vx, vy of either kind of point."""
    if point.elastic:
        return elastic_point(q, qd, point.shapes, point.shortening)
    return rigid_point(point.along1, point.beyond, q[0], q[1], qd[0], qd[1])


class PointKinematics:
    """Position and velocity of one material point; made by :func:`make_point`."""

    def __init__(self, shapes: FloatArray, shortening: FloatArray) -> None:
        self.shapes, self.shortening = shapes, shortening

    def record(self) -> SensedPoint:
        """Return the point for compiled code."""
        return SensedPoint(True, 0.0, 0.0, self.shapes, self.shortening)

    def __call__(self, q: FloatArray, qd: FloatArray) -> tuple[float, float, float, float]:
        """Return x, y (m), vx, vy (m/s) in ``base`` for a state of shapes ``(n,)``."""
        result: tuple[float, float, float, float] = elastic_point(
            q, qd, self.shapes, self.shortening
        )
        return result


class RigidPointKinematics(PointKinematics):
    """The same point on an arm with rigid links: joint angles only."""

    def __init__(self, lengths: Lengths, location: float) -> None:
        super().__init__(np.zeros((3, 1)), np.zeros((2, 0, 0)))
        self._along1 = min(location, lengths[0])
        self._beyond = max(location - lengths[0], 0.0)

    def record(self) -> SensedPoint:
        """Return the point for compiled code."""
        return SensedPoint(False, self._along1, self._beyond, self.shapes, self.shortening)

    def __call__(self, q: FloatArray, qd: FloatArray) -> tuple[float, float, float, float]:
        """Return x, y (m), vx, vy (m/s) in ``base``; only the first two entries are read."""
        result: tuple[float, float, float, float] = self._bound(q[0], q[1], qd[0], qd[1])
        return result

    @cached_property
    def _bound(self) -> Any:
        return bound(rigid_point, self._along1, self._beyond, example=(0.0,) * 4)


def round_off(lengths: Lengths, radius: Any) -> Any:
    """
    Return the largest rounding error between a point and the tip at its joint angles, m.

    ``radius``, m, of any shape: the point's distance from the shoulder.  With the unit round-off
    u and the reach R, the angles and the forward kinematics cost some 16 u R, and the cosine of
    theta2, by cancellation, an error of r^2 of 8 u R^2: of r by 4 u R^2 / r, or sqrt(8 u) R at
    the shoulder.
    """
    whole = lengths[0] + lengths[1]
    folded = np.minimum(4.0 * _UNIT * whole / np.maximum(radius, _UNIT * whole), _SQRT_8_UNIT)
    return whole * (16.0 * _UNIT + folded)


def make_point(plant: PlantParameters, location: float, elastic: bool) -> PointKinematics:
    """
    Return the kinematics of the point ``location`` m from the shoulder along the arm.

    ``elastic`` false: rigid kinematics of theta1 and theta2 (the paper's
    Figure 4).  True: the material point of the bent arm, with the shape
    functions of ``plant.model`` (and the foreshortening of ``full``).
    """
    if not elastic:
        return RigidPointKinematics(plant.spans, location)
    count, first = plant.modes, plant.spans[0]
    along = (min(location, first), max(location - first, 0.0))
    shapes = np.zeros((3, count + 1))
    shapes[0, count], shapes[2, count] = along
    shortening = []
    for link in (0, 1):
        shapes[2 * link, :count], slope, short = _shapes_at(plant, link, along[link])
        shortening.append(short)
        if link == 0:
            shapes[1, :count] = slope
    return PointKinematics(shapes, np.ascontiguousarray(np.stack(shortening)))


def _shapes_at(
    plant: PlantParameters, link: int, distance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return shape functions (N,), slopes (N,) and foreshortening at ``distance`` m from the joint.

    The foreshortening is (N, N) as in `elastic_point`, (0, 0) for a model without.
    """
    if plant.model == 'full':
        from flexarm_ros.core.arm.full.shapes import link_shapes

        return link_shapes(plant, link, distance)
    modes = ClampedFreeModes(
        plant.length[link], plant.mass_density[link], plant.flexural_rigidity[link], plant.modes
    )
    bent, beyond = plant.flexible_part(link, distance)
    slope = modes.slope(bent)
    return modes.shape(bent) + beyond * slope, slope, np.zeros((0, 0))


def frame_shapes(plant: PlantParameters, location: float) -> tuple[FloatArray, FloatArray]:
    """
    Return ``shapes`` (4, N + 1) and ``shortening`` of a frame fixed to the bent arm.

    ``location`` m from the shoulder along the arm; for `frame_motion`: the rows of
    `elastic_point`, then the slopes of link 2 at the frame; the last entry of row 1 is 1 for a
    frame on link 2, 0 on link 1.
    """
    point = make_point(plant, location, elastic=True)
    beyond = location - plant.spans[0]
    slopes = np.zeros((1, plant.modes + 1))
    if beyond > 0.0:
        slopes[0, : plant.modes] = _shapes_at(plant, 1, beyond)[1]
    shapes = np.concatenate([point.shapes, slopes])
    shapes[1, plant.modes] = float(beyond > 0.0)
    return shapes, point.shortening


@compiled
def frame_motion(
    q: FloatArray, qd: FloatArray, qdd: FloatArray, shapes: FloatArray, shortening: FloatArray
) -> tuple[float, float, float]:
    """
    Return the rate of turn (rad/s) and the acceleration (m/s^2) of a frame on the bent arm.

    The acceleration is that of its origin in ``base``, along the frame's axes: x along the
    tangent of the link towards the tip, y to the left.  ``qdd`` (n,): accelerations of the
    coordinates; for ``shapes`` and ``shortening`` see `frame_shapes`.
    """
    count = shapes.shape[1] - 1
    second = shapes[1, count] > 0.0
    w1, dw1, ddw1, w2, dw2, ddw2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    turn, dturn, ddturn, tilt, dtilt = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(count):
        j, k = 2 + i, 2 + count + i
        w1 += shapes[0, i] * q[j]
        dw1 += shapes[0, i] * qd[j]
        ddw1 += shapes[0, i] * qdd[j]
        turn += shapes[1, i] * q[j]
        dturn += shapes[1, i] * qd[j]
        ddturn += shapes[1, i] * qdd[j]
        w2 += shapes[2, i] * q[k]
        dw2 += shapes[2, i] * qd[k]
        ddw2 += shapes[2, i] * qdd[k]
        tilt += shapes[3, i] * q[k]
        dtilt += shapes[3, i] * qd[k]
    u1, du1, ddu1 = shapes[0, count], 0.0, 0.0
    u2, du2, ddu2 = shapes[2, count], 0.0, 0.0
    for i in range(shortening.shape[1]):
        for j in range(shortening.shape[1]):
            a, b, s = 2 + i, 2 + j, shortening[0, i, j]
            u1 -= 0.5 * s * q[a] * q[b]
            du1 -= s * q[a] * qd[b]
            ddu1 -= s * (qd[a] * qd[b] + q[a] * qdd[b])
            a, b, s = a + count, b + count, shortening[1, i, j]
            u2 -= 0.5 * s * q[a] * q[b]
            du2 -= s * q[a] * qd[b]
            ddu2 -= s * (qd[a] * qd[b] + q[a] * qdd[b])
    # Of each link in its own axes, which turn.
    rate, spin = qd[0], qdd[0]
    along = ddu1 - 2.0 * rate * dw1 - spin * w1 - rate * rate * u1
    across = ddw1 + 2.0 * rate * du1 + spin * u1 - rate * rate * w1
    if not second:
        sine, cosine = sincos(turn)
        return rate + dturn, cosine * along + sine * across, cosine * across - sine * along
    sine, cosine = sincos(turn + q[1])
    along, across = cosine * along + sine * across, cosine * across - sine * along
    rate, spin = rate + dturn + qd[1], spin + ddturn + qdd[1]
    along += ddu2 - 2.0 * rate * dw2 - spin * w2 - rate * rate * u2
    across += ddw2 + 2.0 * rate * du2 + spin * u2 - rate * rate * w2
    sine, cosine = sincos(tilt)
    return rate + dtilt, cosine * along + sine * across, cosine * across - sine * along


def jacobian(
    lengths: Lengths, th1: float, th2: float, location: float
) -> tuple[float, float, float, float]:
    """
    Return J11, J12, J21, J22 (m) of the rigid point ``location`` m along the arm.

    (vx, vy) = J (theta1', theta2').
    """
    along1 = min(location, lengths[0])
    beyond = max(location - lengths[0], 0.0)
    x, y, _, _ = rigid_point(along1, beyond, th1, th2, 0.0, 0.0)
    x2, y2, _, _ = rigid_point(0.0, beyond, th1, th2, 0.0, 0.0)
    return -y, -y2, x, x2


def reach(lengths: Lengths) -> tuple[float, float]:
    """Return the smallest and the largest distance from the shoulder within reach, m."""
    return abs(lengths[0] - lengths[1]), lengths[0] + lengths[1]


def inverse_kinematics(
    lengths: Lengths, x: float, y: float, once: bool = False
) -> tuple[float, float]:
    """
    Return theta1, theta2 (rad, theta2 from 0 to pi) with the rigid tip at x, y.

    ``once``: without compiled code, which pays from some hundred points on.  Raises
    ``ValueError`` if the point is out of reach.
    """
    length1, length2 = lengths
    radius = math.sqrt(x * x + y * y)
    low, high = reach(lengths)
    slack = REACH_TOLERANCE * high
    if not low - slack <= radius <= high + slack:
        raise ValueError(
            f'({x:.6g}, {y:.6g}) m is {radius:.6g} m from the shoulder, '
            f'reached are {low:.6g} to {high:.6g} m'
        )
    solve = interpreted(_angles_to) if once else _angles_to
    theta1, theta2 = solve(length1, length2, radius, x, y)
    return float(theta1), float(theta2)


@compiled
def _angles_to(
    length1: float, length2: float, radius: float, x: float, y: float
) -> tuple[float, float]:
    """Return the joint angles for a point at distance ``radius``, m, limited to the reach."""
    cosine = (radius * radius - length1 * length1 - length2 * length2) / (2.0 * length1 * length2)
    theta2 = acos(min(1.0, max(-1.0, cosine)))
    s, c = sincos(theta2)
    return atan2(y, x) - atan2(length2 * s, length1 + length2 * c), theta2
