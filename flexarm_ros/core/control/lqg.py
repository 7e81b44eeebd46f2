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
Laws ``lqg`` and ``adaptive``: estimated flexible state, regulated about a planned motion.

Both use the undelayed encoders and the delayed position of the tip sensor, not the elastic state
that the plant publishes.  For plan, gains and filter see
:mod:`flexarm_ros.core.control.design`.

``lqg``: errors of EI, density and latency count in the filter's covariance and are not
estimated.  ``adaptive``: they are estimated, the filter's model follows them, and the regulator
compensates their predicted effect.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math
from typing import NamedTuple

from flexarm_ros.core.arm.full.dynamics import step
from flexarm_ros.core.arm.full.model import floats
from flexarm_ros.core.arm.kinematics import elastic_point
from flexarm_ros.core.control.design.filter import fill_filter, FilterModel, UNKNOWNS
from flexarm_ros.core.control.design.model import adjust, Arm, Point
from flexarm_ros.core.control.design.motion import APART, around, model_of, plan_for, Planned
from flexarm_ros.core.control.design.plan import Grid
from flexarm_ros.core.control.design.regulator import fill_regulator, RegulatorWeights
from flexarm_ros.core.control.feedback import limited
from flexarm_ros.core.control.law import Law, Sample
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
from flexarm_ros.core.numerics.elementary import exp
from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.parameters.sections import (
    ControllerParameters,
    RunConfig,
    TipSensorParameters,
)
from flexarm_ros.core.timeline import named_ns, ticks_between, Timeline
import numpy as np

_BEYOND_S = 10.0
"""Time after the plan over which the regulator's gains converge, s."""

_FARTHEST = 0.35
"""Largest estimate of log EI and log density."""


class Design(NamedTuple):
    """Gains of the regulator (K, 2, 2n + 6) and of the estimator (K, total, 6)."""

    regulator: FloatArray
    estimator: FloatArray


class Latency(NamedTuple):
    """The assumed latency in ticks, integer and fraction, and the ticks per tip sample."""

    whole: int
    part: float
    every: int


class Memory(NamedTuple):
    """State of a law: estimate z (total,), added torque v (2,), integral (2,)."""

    z: FloatArray
    v: FloatArray
    integral: FloatArray


class Own(NamedTuple):
    """The filter's constants ``con``, their ``numbers``, and those of the model, ``base``."""

    con: Records
    numbers: FloatArray
    base: FloatArray


def own_of(con: Records) -> Own:
    """Return a copy of the model's constants that follows the estimates."""
    own = con.copy()
    return Own(own, floats(own), floats(con))


def latency_of(config: RunConfig) -> Latency:
    """Return the latency that the controller assumes."""
    period_ns = Timeline.of(config.run).period_ns
    own = config.controller.model_tip_latency
    seconds = config.tip_sensor.latency if own is None else own
    whole, rest = divmod(named_ns('controller.model.tip_latency', seconds), period_ns)
    every = ticks_between('tip_sensor.rate', config.tip_sensor.rate, period_ns)
    return Latency(whole, rest / period_ns, every)


def filter_model(
    gains: ControllerParameters, latency: Latency, period: float, size: int, adapt: bool
) -> FilterModel:
    """Return the filter's assumptions; ``size`` is 2n."""
    start = np.full(size + UNKNOWNS, 1e-8)
    unsure = (gains.lqg_model_std, gains.lqg_model_std, gains.lqg_latency_std)
    for i, std in enumerate(unsure):
        start[size + i] = std * std
    start[-2:] = 0.0  # no initial torque disturbance
    wander = np.zeros(UNKNOWNS)
    if adapt:
        steps = [std * gains.adaptive_wander for std in unsure]
        wander[:3] = [step * step * period for step in steps]
    considered = np.array([0.0 if adapt else 1.0] * 3 + [1.0] * 2)
    measured = np.array([gains.lqg_angle_std, gains.lqg_rate_std, gains.lqg_tip_std])
    driven = np.array([gains.lqg_torque_noise, gains.lqg_joint_noise, gains.lqg_elastic_noise])
    return FilterModel(
        latency.whole, latency.part, latency.every, measured * measured, driven * driven, start,
        wander, considered,
    )  # fmt: skip


@lru_cache(maxsize=4)
def _design(config: RunConfig, adapt: bool) -> Design:
    """Return the gains for ``config``, which has only the keys that the design depends on."""
    plan, gains, latency = plan_for(config), config.controller, latency_of(config)
    count, size = plan.motion.rate.shape[0], plan.motion.state.shape[1]
    spacing = plan.grid.ticks * plan.grid.substeps * plan.grid.step
    weights = RegulatorWeights(
        gains.lqg_tip_weight, gains.lqg_integral_weight, gains.lqg_torque_weight,
        gains.lqg_rate_weight,
    )  # fmt: skip
    regulator = np.zeros((count, 2, size + 6))
    near, beyond = around(plan.arm), math.ceil(_BEYOND_S / spacing)
    fill_regulator(plan.arm, near, APART, weights, plan.grid, plan.motion, beyond, regulator)
    period = Timeline.of(config.run).period
    setup = filter_model(gains, latency, period, size, adapt)
    filtered = np.zeros((count, size + UNKNOWNS + 2 * (latency.whole + 2), 6))
    fill_filter(plan.arm, near, APART, setup, plan.grid, plan.motion, filtered)
    return Design(regulator, filtered)


def design_of(config: RunConfig) -> Design:
    """Return the gains of ``config``, whose law is ``lqg`` or ``adaptive``."""
    return _design(design_key(config), config.controller.law == 'adaptive')


def design_key(config: RunConfig) -> RunConfig:
    """
    Return ``config`` without the keys that no design depends on, so that runs can share one.

    The plant's own parameters count only as defaults of the controller's model.
    """
    latency = config.controller.model_tip_latency
    latency = config.tip_sensor.latency if latency is None else latency
    believed = replace(config.controller, law='lqg', model_tip_latency=latency)
    sensor = replace(
        TipSensorParameters(), location=config.tip_sensor.location, rate=config.tip_sensor.rate
    )
    return RunConfig(
        run=replace(config.run, seed=0), plant=model_of(config), tip_sensor=sensor,
        trajectory=config.trajectory, controller=believed,
    )  # fmt: skip


@compiled
def correct(
    z: FloatArray, gains: FloatArray, latency: Latency, period: float, n: int, tip: bool,
    encoder: tuple[float, float, float, float], point: tuple[float, float],
) -> None:  # fmt: skip
    """Update by this tick's readings; z (total,), gains (total, 6)."""
    size = 2 * n
    newer = size + 5 + 2 * latency.whole
    e0, e1 = encoder[0] - z[0], encoder[1] - z[1]
    e2, e3 = encoder[2] - z[n], encoder[3] - z[n + 1]
    e4, e5 = 0.0, 0.0
    if tip:
        late = latency.part + z[size + 2] / period
        e4 = point[0] - z[newer] - late * (z[newer + 2] - z[newer])
        e5 = point[1] - z[newer + 1] - late * (z[newer + 3] - z[newer + 1])
    for i in range(z.shape[0]):
        z[i] += gains[i, 0] * e0 + gains[i, 1] * e1 + gains[i, 2] * e2 + gains[i, 3] * e3
        z[i] += gains[i, 4] * e4 + gains[i, 5] * e5


@internal
def tip_deviation(point: Point, z: FloatArray, planned: FloatArray, n: int) -> tuple[float, float]:
    """Return the deviation of the estimated tip from the planned one, m."""
    end = 2 * n
    x, y, _, _ = elastic_point(z[:n], z[n:end], point.shapes, point.shortening)
    px, py, _, _ = elastic_point(planned[:n], planned[n:end], point.shapes, point.shortening)
    return x - px, y - py


@allocating
def regulate(
    arm: Arm, gains: FloatArray, planned: FloatArray, memory: Memory, period: float, limit: float
) -> tuple[float, float]:
    """
    Return the torques: the plan's plus v, whose rate is linear in the deviations.

    v is the part within the limit, and the integral stops while a joint is at its limit, as
    anti-windup for both.
    """
    z, v, integral = memory
    size = planned.shape[0] - 2
    rate, torque = np.zeros(2), np.zeros(2)
    for c in range(2):
        for i in range(size):
            rate[c] += gains[c, i] * (z[i] - planned[i])
        for i in range(2):
            rate[c] += gains[c, size + i] * v[i]
            rate[c] += gains[c, size + 2 + i] * integral[i]
            rate[c] += gains[c, size + 4 + i] * z[size + i]
    free = True
    for c in range(2):
        asked = planned[size + c] + v[c] + period * rate[c]
        torque[c] = limited(asked, limit)
        free = free and asked == torque[c]
        v[c] = torque[c] - planned[size + c]
    if free:
        dx, dy = tip_deviation(arm.tip, z, planned, size // 2)
        integral[0] += period * dx
        integral[1] += period * dy
    return torque[0], torque[1]


@compiled
def predict_state(
    arm: Arm, own: Own, grid: Grid, z: FloatArray, tau1: float, tau2: float, n: int
) -> None:
    """Propagate the estimate over a tick with the torques held."""
    size = 2 * n
    for i in range(2):
        z[size + i] = min(max(z[size + i], -_FARTHEST), _FARTHEST)
    if z[size] != 0.0 or z[size + 1] != 0.0:
        ei, rho = exp(z[size]) - 1.0, exp(z[size + 1]) - 1.0
        adjust(own.base, arm.rigidity, arm.density, ei, rho, own.numbers)
    step(
        own.con, z[:n], z[n:size], tau1 + z[size + 3], tau2 + z[size + 4], grid.step,
        grid.substeps, grid.order, arm.work,
    )  # fmt: skip
    for i in range(z.shape[0] - 1, size + 6, -1):
        z[i] = z[i - 2]
    x, y, _, _ = elastic_point(z[:n], z[n:size], arm.sensed.shapes, arm.sensed.shortening)
    z[size + 5], z[size + 6] = x, y


class LqgLaw(Law):
    """Kalman filter and time-varying linear-quadratic regulator about the optimal motion."""

    ADAPT = False
    PLANS = TIME_VARYING = MODELS_LATENCY = EVERY_TICK = True
    SENSOR = 'tip_sensor'

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        self._plan: Planned = plan_for(config)
        self._latency = latency_of(config)
        self._design = _design(design_key(config), self.ADAPT)
        self._period = Timeline.of(config.run).period
        self._n = self._plan.motion.state.shape[1] // 2
        self._own = own_of(self._plan.arm.con)
        z = np.zeros(self._design.estimator.shape[1])
        size = 2 * self._n
        z[:size] = self._plan.dense[0, :size]
        sensed = self._plan.arm.sensed
        point = elastic_point(z[: self._n], z[: self._n], sensed.shapes, sensed.shortening)
        past = z[size:][UNKNOWNS:]
        past[::2], past[1::2] = point[:2]
        self._memory = Memory(z, np.zeros(2), np.zeros(2))

    @property
    def unknowns(self) -> FloatArray:
        """Estimates of log EI, log density, latency's error (s), torque disturbances (N m)."""
        size = 2 * self._n
        return np.array(self._memory.z[size:][:UNKNOWNS])

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        plan, n, memory = self._plan, self._n, self._memory
        knot = min(k // plan.grid.ticks, len(self._design.regulator) - 1)
        tip = k % self._latency.every == 0
        correct(
            memory.z, self._design.estimator[knot], self._latency, self._period, n, tip,
            sample.encoder, sample.tip[:2],
        )  # fmt: skip
        planned = plan.dense[min(k, len(plan.dense) - 1)]
        torque: tuple[float, float] = regulate(
            plan.arm, self._design.regulator[knot], planned, memory, self._period,
            self.config.controller.torque_limit,
        )  # fmt: skip
        predict_state(plan.arm, self._own, plan.grid, memory.z, *torque, n)
        return torque


class AdaptiveLaw(LqgLaw):
    """``lqg`` with online estimation of EI, density and latency."""

    ADAPT = True
