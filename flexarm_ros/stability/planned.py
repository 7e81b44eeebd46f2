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
The motion-planning laws, linearised about rest at a pose.

Deviations are from the plan, which needs no torque at rest.

``inverse``: tau = -K_p dtheta - K_d dtheta', from the encoders.  ``passive``: the same, with the
low-pass and the past of its expected measurements as states.  ``lqg`` and ``adaptive``: the
filter's state (x and the chain of past positions of the sensed point), the added torque v and the
integral I.  Their gains vary with time and are frozen at the time of the pose (frozen-time
eigenvalues); the model in the filter is that of the pose.  The unknown parameters are left out:
``lqg`` does not correct them, and those of ``adaptive``, not observable at rest, are constant.
"""

from __future__ import annotations

import math

from flexarm_ros.core.arm.kinematics import jacobian
from flexarm_ros.core.control.design.filter import UNKNOWNS
from flexarm_ros.core.control.design.motion import model_of, plan_for
from flexarm_ros.core.control.lqg import design_of, Latency, latency_of
from flexarm_ros.core.control.planned import lead
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.stability.form import LinearLaw, NoLinearFormError
from flexarm_ros.stability.hold import hold_matrices
from flexarm_ros.stability.modes import LinearArm, linearise
import numpy as np

_NEAR = 0.02
"""Difference of elbow angles that count as equal, rad."""


def inverse_form(config: RunConfig, arm: LinearArm, _time: float | None) -> LinearLaw:
    """Return `InverseLaw` about rest."""
    return LinearLaw.static(_joints(config, arm))


def _check_rate(config: RunConfig) -> None:
    """Raise NoLinearFormError if the tip sensor holds samples."""
    if latency_of(config).every > 1:
        raise NoLinearFormError(
            f'tip_sensor.rate: {config.tip_sensor.rate:g} Hz, law {config.controller.law} treats '
            'a held sample differently from a new one, so that no single matrix describes every '
            'tick; allowed here: 0 (every tick)'
        )


def _encoder(arm: LinearArm) -> int:
    """Return the index of the encoder in the law's inputs; the tip sensor's is four higher."""
    return 2 * len(arm.mass)


def _joints(config: RunConfig, arm: LinearArm) -> FloatArray:
    """Return d ``(2, 2 n + 8)`` of the joint loops."""
    control, at = config.controller, _encoder(arm)
    d = np.zeros((2, at + 8))
    d[:, -8:-6] = -control.joint_kp * np.eye(2)
    d[:, -6:-4] = -control.joint_kd * np.eye(2)
    return d


def _delayed(latency: Latency) -> FloatArray:
    """Return weights ``(1, whole + 2)`` of the values of this tick and of earlier ones."""
    weights = np.zeros((1, latency.whole + 2))
    weights[0, -2:] = 1.0 - latency.part, latency.part
    return weights


def passive_form(config: RunConfig, arm: LinearArm, _time: float | None) -> LinearLaw:
    """
    Return `PassiveLaw` about rest.

    State: the expected measurements of the last whole + 1 ticks, newest first, and c.
    Raises NoLinearFormError if the tip sensor holds samples.
    """
    _check_rate(config)
    control, at = config.controller, _encoder(arm)
    first = config.plant.spans[0]
    along = (first, max(config.tip_sensor.location - first, 0.0))
    j11, j12, j21, j22 = jacobian(along, arm.theta1, arm.theta2, sum(along))
    now = np.zeros((2, at + 8))
    now[:, -8:-6] = [[j11, j12], [j21, j22]]
    weights = np.kron(_delayed(latency_of(config)), np.eye(2))
    ring = weights.shape[1] - 2
    keep = control.passive_bandwidth * Timeline.of(config.run).period
    share = keep * control.passive_share
    # c at this tick, already used by the torque, over the state and over the inputs.
    of_state, of_input = np.zeros((2, ring + 2)), share * weights[:, :2] @ now
    of_state[:, :ring] = share * weights[:, 2:]
    of_state[:, ring:] = (1.0 - keep) * np.eye(2)
    of_input[:, -4:-2] -= share * np.eye(2)
    a, b = np.zeros((ring + 2, ring + 2)), np.zeros((ring + 2, at + 8))
    a[:ring, :ring] = np.eye(ring, k=-2)
    b[:2] = now
    a[ring:], b[ring:] = of_state, of_input
    led = control.joint_kp * _lead(config, arm)
    return LinearLaw(a, b, led @ of_state, _joints(config, arm) + led @ of_input)


def _lead(config: RunConfig, arm: LinearArm) -> FloatArray:
    """Return the lead of the joints' targets for a correction of the tip, ``(2, 2)``."""
    pose, columns = np.array([arm.theta1, arm.theta2]), []
    for unit in np.eye(2):
        target = np.zeros(2)
        lead(pose, config.plant.spans, unit, target)
        columns.append(target - pose)
    return np.asarray(np.array(columns).T)


def lqg_form(config: RunConfig, arm: LinearArm, time: float | None) -> LinearLaw:
    """
    Return `LqgLaw` or `AdaptiveLaw` about rest, with the gains of ``time``, s.

    State: the filter's x and chain, v, I.  The equations are those of one tick of the law.
    Raises NoLinearFormError if the tip sensor holds samples.
    """
    _check_rate(config)
    latency, period = latency_of(config), Timeline.of(config.run).period
    believed = linearise(RunConfig(run=config.run, plant=model_of(config)), arm.theta2, arm.theta1)
    plan, at = plan_for(config), _encoder(arm)
    n = len(believed.mass)
    size, chain = 2 * n, 2 * (latency.whole + 2)
    regulator, gains = _gains(config, arm, time)
    # The filter's prediction of the six readings, and its estimate after their update.
    expected = np.zeros((6, size + chain))
    expected[:2, :2] = expected[2:4, n:][:, :2] = np.eye(2)
    expected[4:, size:] = np.kron(_delayed(latency), np.eye(2))
    z, end = size + chain, size + chain + 4
    state, given = np.zeros((z, end)), np.zeros((z, at + 8))
    state[:, :z] = np.eye(z) - gains @ expected
    given[:, -8:-2] = gains
    # v of this tick is the torque.
    pick = np.zeros((2, end))
    pick[:, -4:-2] = np.eye(2)
    rate = regulator[:, :size]
    c = pick + period * (rate @ state[:size] + np.hstack([np.zeros((2, z)), regulator[:, size:]]))
    d = period * rate @ given[:size]
    hold, drive = hold_matrices(believed, period, (plan.grid.order, plan.grid.substeps))
    a, b = np.zeros((end, end)), np.zeros((end, at + 8))
    a[:size], b[:size] = hold @ state[:size] + drive @ c, hold @ given[:size] + drive @ d
    sensed = believed.point(config.tip_sensor.location)
    a[size:][:2], b[size:][:2] = sensed @ a[:n], sensed @ b[:n]
    a[size:z][2:], b[size:z][2:] = state[size:z][:-2], given[size:z][:-2]
    a[-4:-2], b[-4:-2] = c, d
    tip = period * believed.point(config.plant.reach)
    a[-2:], b[-2:] = tip @ state[:n], tip @ given[:n]
    a[-2:, -2:] += np.eye(2)
    return LinearLaw(a, b, c, d)


def _gains(config: RunConfig, arm: LinearArm, time: float | None) -> tuple[FloatArray, FloatArray]:
    """
    Return the regulator's gains ``(2, 2 n + 4)`` and the filter's ``(2 n + chain, 6)``.

    They are those of ``time``, rotated from the plan's direction to the arm's.
    """
    design, plan = design_of(config), plan_for(config)
    states = plan.motion.state
    spacing = plan.grid.ticks * Timeline.of(config.run).period
    if time is None:
        # The plan has a pose several times; at the last one the gains have settled.
        apart = np.abs(states[:, 1] - arm.theta2)
        knot = int(np.flatnonzero(apart <= apart.min() + _NEAR)[-1])
    else:
        knot = int(time / spacing + 1e-9)
    knot = min(knot, len(design.regulator) - 1)
    size = states.shape[1]
    turn = arm.theta1 - states[knot, 0]
    cos, sin = math.cos(turn), math.sin(turn)
    rotation = np.array([[cos, -sin], [sin, cos]])
    regulator = design.regulator[knot, :, : size + 4].copy()
    regulator[:, size:][:, 2:] = regulator[:, size:][:, 2:] @ rotation.T
    gains = np.delete(design.estimator[knot], range(size, size + UNKNOWNS), axis=0)
    gains[:, 4:] = gains[:, 4:] @ rotation.T
    gains[size:] = np.kron(np.eye((len(gains) - size) // 2), rotation) @ gains[size:]
    return regulator, gains
