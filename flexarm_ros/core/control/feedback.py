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
From measurements to the end effector position that the laws compare with the reference.

``encoder``: rigid kinematics of the measured joint angles, at the tip.

``tip_sensor``: the sensed point, extended to the tip by the rest of link 2, straight and at the
joint angles of this tick:

    p_tip = p_sensed + (L1 + L2 - location) u(theta1 + theta2).

So the loop tracks the tip's reference for any sensor location, with the paper's gains and
Jacobian, and with ``location`` at the tip the reading is used directly.  This agrees with the
paper, where 6.75 m changes only the delay ("minimal difference"): without latency, the rigid
measurand gives the tip itself at every location.  The alternatives are worse: a comparison at the
sensed point changes the gains' lever arms, and solving the rigid arm through the sensed point for
its joint angles is singular for a straight arm and at the elbow, and fails for a bent arm out of
reach.
"""

from __future__ import annotations

from flexarm_ros.core.arm.kinematics import rigid_point
from flexarm_ros.core.numerics.compiled import internal
from flexarm_ros.core.numerics.elementary import sincos

Point = tuple[float, float, float, float]


@internal
def tip_from_encoder(
    length1: float, length2: float, a: float, b: float, da: float, db: float
) -> Point:
    """Tip position and velocity from the rigid kinematics of the measured angles."""
    return rigid_point(length1, length2, a, b, da, db)


@internal
def tip_from_point(
    rest: float, th1: float, th2: float, dth1: float, dth2: float,
    x: float, y: float, vx: float, vy: float,
) -> Point:  # fmt: skip
    """Extend the sensed point by ``rest`` m along link 2."""
    if rest == 0.0:
        return x, y, vx, vy
    angle, rate = th1 + th2, dth1 + dth2
    s, c = sincos(angle)
    c, s = rest * c, rest * s
    return x + c, y + s, vx - s * rate, vy + c * rate


@internal
def jacobian_torque(
    length1: float, length2: float, th1: float, th2: float, fx: float, fy: float, limit: float
) -> tuple[float, float]:
    """Return J^T(theta) (fx, fy), each limited to ``limit`` N m if that is above 0."""
    x, y, _, _ = rigid_point(length1, length2, th1, th2, 0.0, 0.0)
    x2, y2, _, _ = rigid_point(0.0, length2, th1, th2, 0.0, 0.0)
    tau1, tau2 = -y * fx + x * fy, -y2 * fx + x2 * fy
    return limited(tau1, limit), limited(tau2, limit)


@internal
def limited(torque: float, limit: float) -> float:
    """Return ``torque`` limited to +-``limit``, or unchanged for a limit of 0."""
    if limit > 0.0 and torque > limit:
        return limit
    if limit > 0.0 and torque < -limit:
        return -limit
    return torque
