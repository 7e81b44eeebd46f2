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
Control laws, linearised about rest.

The arm rests with straight links and the reference is constant at its tip, so that there is no
force: the derivative of J^T does not contribute, and (20) and (21) are

    tau = -g J^T (Kp dp + Kd dv),

where dp and dv are the measured deviations of the tip.  For (20) g = 1.  For (21)
g = K_s lambda(0, 0), exactly: the slope of lambda does not contribute either, and so neither
does the low-pass of strain gauges.  With ``controller.deflection_source: strain_gauge`` lambda is
that of the gauges' readings at rest, their offsets.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

from flexarm_ros.core.arm.kinematics import jacobian
from flexarm_ros.core.control import gain_of, Law, LAWS
from flexarm_ros.core.control.lqg import AdaptiveLaw, LqgLaw
from flexarm_ros.core.control.pd import FlsLaw, PdLaw
from flexarm_ros.core.control.planned import InverseLaw, PassiveLaw
from flexarm_ros.core.control.state_feedback import StateFeedback
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.rig import StrainGaugeParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.sensing.strain_gauge import deflection_scales, StrainGaugePart
from flexarm_ros.stability.form import LinearLaw, NoLinearFormError
from flexarm_ros.stability.modes import LinearArm, linearise
from flexarm_ros.stability.planned import inverse_form, lqg_form, passive_form
from flexarm_ros.stability.state_feedback import state_feedback_form
import numpy as np


def linear_law(config: RunConfig, arm: LinearArm, time: float | None = None) -> LinearLaw:
    """
    Return the law of ``config`` about rest at ``arm``'s pose.

    ``time``, s: when the trajectory has the pose, for time-varying laws; default the last time
    at which the plan's elbow angle is nearest.  A law that is not in `FORMS` takes part with a
    class method ``linear_form(config, arm) -> LinearLaw``.

    Raises NoLinearFormError for a law without one.
    """
    name = config.controller.law
    law: Any = LAWS[name]
    if law in FORMS:
        return FORMS[law](config, arm, time)
    if not hasattr(law, 'linear_form'):
        raise NoLinearFormError(f'controller.law: {name} has no linear form, no loop to analyse')
    found: LinearLaw = law.linear_form(config, arm)
    return found


def reads_deflections(config: RunConfig) -> bool:
    """Return whether the law of ``config`` has a linear form with the deflections as inputs."""
    try:
        arm = linearise(config, 0.0)
        return linear_law(config, arm).reads_deflections(len(arm.mass))
    except NoLinearFormError:
        return False


def _pd_form(config: RunConfig, arm: LinearArm, _time: float | None) -> LinearLaw:
    return LinearLaw.static(_jacobian_law(config, arm))


def _fls_form(config: RunConfig, arm: LinearArm, time: float | None) -> LinearLaw:
    gain = config.controller.ks * gain_of(config, *_bends_at_rest(config, arm))
    return _pd_form(config, arm, time).scaled(gain)


def _bends_at_rest(config: RunConfig, arm: LinearArm) -> tuple[float, float]:
    """Return the end deflections that the law uses at rest, m: 0 but for gauges' offsets."""
    scales = deflection_scales(config)
    if scales is None:
        return 0.0, 0.0
    gauge: StrainGaugeParameters = config.section(StrainGaugePart.NAME)
    first, second = (
        scale * (offset + slope * angle)
        for scale, offset, slope, angle in zip(
            scales, gauge.offset, gauge.offset_slope, (arm.theta1, arm.theta2), strict=True
        )
    )
    return first, second


FORMS: dict[type[Law], Callable[[RunConfig, LinearArm, float | None], LinearLaw]] = {
    PdLaw: _pd_form,
    FlsLaw: _fls_form,
    InverseLaw: inverse_form,
    PassiveLaw: passive_form,
    LqgLaw: lqg_form,
    AdaptiveLaw: lqg_form,
    StateFeedback: state_feedback_form,
}
"""
Class of a law -> its linear form, for the laws of this package.

They are here rather than in the classes because no number of a run depends on them: the digest of
the source covers `core`, not `stability`.  A subclass is not its base: it has a form of its own.
"""


def _jacobian_law(config: RunConfig, arm: LinearArm) -> FloatArray:
    """Return d, shape ``(2, 2 n + 8)``, of tau = J^T (Kp e + Kd e')."""
    controller, size = config.controller, len(arm.mass)
    whole = config.plant.reach
    j11, j12, j21, j22 = jacobian(config.plant.spans, arm.theta1, arm.theta2, whole)
    tip = np.array([[j11, j12], [j21, j22]])
    # Columns: q, q', the encoder's angles and rates, the tip sensor's position and velocity.
    position, rate = np.zeros((2, 2, 2 * size + 8))
    joint_rates = slice(size, size + 2)
    if controller.feedback == 'encoder':
        position[:, -8:-6] = rate[:, -6:-4] = tip
    else:
        # The remaining part of link 2 is extended at this tick's joint angles.
        rest = max(whole - config.tip_sensor.location, 0.0)
        angle = arm.theta1 + arm.theta2
        carried = np.outer([-rest * math.sin(angle), rest * math.cos(angle)], [1.0, 1.0])
        position[:, -4:-2] = rate[:, -2:] = np.eye(2)
        position[:, :2] = rate[:, joint_rates] = carried
    if controller.velocity_source == 'encoder':
        rate[:] = 0.0
        rate[:, joint_rates] = tip
    return np.asarray(-tip.T @ (controller.kp * position + controller.kd * rate))
