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
Laws ``inverse`` and ``passive``: the planned motion's torque and collocated feedback.

``inverse``: inverse dynamics of the flexible arm as feedforward, with joint loops about the
planned angles,

    tau = tau_p + K_p (theta_p - theta) + K_d (theta_p' - theta'),

from the encoders alone.  The feedback is collocated, so that it dissipates energy of every mode
for any parameters of the arm (Gevarter, AIAA Journal 8, 1970).  The tip sensor is not used.

``passive``: the same, with a slow correction from the delayed tip, through an output between
joints and tip (the mu-tip of Damaren, IEE Proc. D 142, 1995: joint rates and a fraction mu of the
elastic rates; from the torques to it the arm is passive, unlike to the tip's own rate).  The
deviation d(t) of the measured deflection from the planned one is low-passed and compensated in
part:

    c' = w (-mu d - c),   theta_t = theta_p + J^T (J J^T + l^2)^-1 c,

    d(t) = p(t) - [p_p + r(theta) - r(theta_p)](t - latency),

with p the sensed point as delivered, p_p as planned, r and J the rigid arm's point and the tip's
Jacobian.
"""

from __future__ import annotations

from flexarm_ros.core.arm.kinematics import elastic_point, rigid_point
from flexarm_ros.core.control.design.model import Point
from flexarm_ros.core.control.design.motion import plan_for
from flexarm_ros.core.control.feedback import limited
from flexarm_ros.core.control.law import Law, Sample
from flexarm_ros.core.control.lqg import latency_of
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
import numpy as np

_REGULAR = 2.0
"""l, m: below this lever, near the straight arm, a direction is hardly corrected."""


@compiled
def collocated(
    planned: FloatArray, target: FloatArray, encoder: tuple[float, float, float, float],
    gains: tuple[float, float], limit: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the planned torques with those of the joint loops; ``planned`` (2n + 2,)."""
    size = planned.shape[0] - 2
    n = size // 2
    kp, kd = gains
    tau1 = planned[size] + kp * (target[0] - encoder[0]) + kd * (planned[n] - encoder[2])
    tau2 = planned[size + 1] + kp * (target[1] - encoder[1]) + kd * (planned[n + 1] - encoder[3])
    return limited(tau1, limit), limited(tau2, limit)


@compiled
def expect(
    point: Point,
    along: tuple[float, float],
    planned: FloatArray,
    encoder: tuple[float, float, float, float],
    out: FloatArray,
) -> None:
    """Set ``out`` (2,) to the position of the sensed point for the planned deflection."""
    size = planned.shape[0] - 2
    n = size // 2
    x, y, _, _ = elastic_point(planned[:n], planned[n:size], point.shapes, point.shortening)
    rx, ry, _, _ = rigid_point(along[0], along[1], encoder[0], encoder[1], 0.0, 0.0)
    px, py, _, _ = rigid_point(along[0], along[1], planned[0], planned[1], 0.0, 0.0)
    out[0], out[1] = x + rx - px, y + ry - py


@compiled
def lead(
    planned: FloatArray, lengths: tuple[float, float], c: FloatArray, target: FloatArray
) -> None:
    """Set ``target`` (2,), the joint angles that move the rigid tip by ``c`` (2,), damped."""
    th1, th2 = planned[0], planned[1]
    x, y, _, _ = rigid_point(lengths[0], lengths[1], th1, th2, 0.0, 0.0)
    x2, y2, _, _ = rigid_point(0.0, lengths[1], th1, th2, 0.0, 0.0)
    square = _REGULAR * _REGULAR
    a, b, d = y * y + y2 * y2 + square, -x * y - x2 * y2, x * x + x2 * x2 + square
    det = a * d - b * b
    fx, fy = (d * c[0] - b * c[1]) / det, (a * c[1] - b * c[0]) / det
    target[0] = th1 - y * fx + x * fy
    target[1] = th2 - y2 * fx + x2 * fy


class InverseLaw(Law):
    """Inverse dynamics of the flexible arm along the planned motion, and joint loops."""

    PLANS = True
    SENSOR = 'encoder'

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self._plan = plan_for(config)
        self._target = np.zeros(2)

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        planned = self._at(k)
        self._target[:] = planned[:2]
        return self._held(planned, sample)

    def _at(self, k: int) -> FloatArray:
        row: FloatArray = self._plan.dense[max(0, min(k, len(self._plan.dense) - 1))]
        return row

    def _held(self, planned: FloatArray, sample: Sample) -> tuple[float, float]:
        gains = self.config.controller
        torque: tuple[float, float] = collocated(
            planned, self._target, sample.encoder, (gains.joint_kp, gains.joint_kd),
            gains.torque_limit,
        )  # fmt: skip
        return torque


class PassiveLaw(InverseLaw):
    """``inverse`` with the joints' targets slowly corrected by the delayed tip."""

    SENSOR = 'tip_sensor'
    EVERY_TICK = True

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for a low-pass that is unstable at the tick."""
        bandwidth, period = config.controller.passive_bandwidth, config.run.control_period
        if bandwidth * period >= 2.0:
            raise ValueError(
                f'controller.passive.bandwidth: {bandwidth!r} 1/s, allowed with a tick of '
                f'{period:g} s: below {2.0 / period:g}'
            )

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self._late = latency_of(config)
        self._step = config.controller.passive_bandwidth * Timeline.of(config.run).period
        self._ring = np.zeros((self._late.whole + self._late.every + 2, 2))
        self._correction = np.zeros(2)
        first = config.plant.spans[0]
        self._along = (first, max(config.tip_sensor.location - first, 0.0))

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        planned = self._at(k)
        here = self._ring[k % len(self._ring)]
        expect(self._plan.arm.sensed, self._along, planned, sample.encoder, here)
        late = self._late
        # At ticks without a new sample the held one is that much older.
        newer = k - k % late.every - late.whole
        gains, c = self.config.controller, self._correction
        for axis in (0, 1):
            after = self._ring[max(newer, 0) % len(self._ring), axis]
            before = self._ring[max(newer - 1, 0) % len(self._ring), axis]
            beyond = sample.tip[axis] - (after + late.part * (before - after))
            c[axis] += self._step * (-gains.passive_share * beyond - c[axis])
        lead(planned, self.config.plant.spans, c, self._target)
        return self._held(planned, sample)
