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
The arm about a pose as one linear system, from torques to delivered measurements.

This is :class:`flexarm_ros.stability.sampled_loop.SampledLoop` without the law, as matrices for
any control library.  The discrete-time model, one step per tick, equals the simulation:
zero-order-hold torques, delays exact (``buffer``) or the ramp-invariant approximation
(``pade2``).  In continuous time every delay is the second-order Pade approximation, as in the
paper.
"""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.sensing.parts import TipSensorPart
from flexarm_ros.core.signals import coordinate_names
from flexarm_ros.core.timeline import named_ns, NS_PER_S, ticks_between, Timeline
from flexarm_ros.stability.hold import (
    buffer_line,
    DelayLine,
    hold_matrices,
    line_length,
    pade_line,
)
from flexarm_ros.stability.modes import linearise
from flexarm_ros.stability.sampled_loop import CHANNELS, MOST_STATES, SENSORS
import numpy as np
from scipy.linalg import block_diag

TORQUES = ('tau1', 'tau2')
ENCODER = ('encoder_theta1', 'encoder_theta2', 'encoder_dtheta1', 'encoder_dtheta2')
TIP_SENSOR = ('sensor_x', 'sensor_y', 'sensor_vx', 'sensor_vy')
DEFLECTION = ('delta1', 'delta2')


@dataclass(frozen=True)
class LinearModel:
    """
    x+ (or x') = a x + b u, y = c x + d u: small motions about rest at a pose.

    ``a`` ``(m, m)``, ``b`` ``(m, 2)``, ``c`` ``(p, m)``, ``d`` ``(p, 2)``, all outputs stacked
    in the order of ``outputs``.  ``period``: the tick, s; 0 in continuous time.  Units: N m in;
    rad, rad/s, m, m/s out, as deviations from the pose (``theta1``, ``theta2``, rad), positions
    in frame ``base``.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    states: tuple[str, ...]
    outputs: tuple[str, ...]
    period: float
    theta1: float
    theta2: float

    def select(self, outputs: tuple[str, ...]) -> LinearModel:
        """Return the model with these outputs only, in this order."""
        rows = [self.outputs.index(name) for name in outputs]
        return LinearModel(
            self.a, self.b, self.c[rows], self.d[rows], self.states, outputs, self.period,
            self.theta1, self.theta2,
        )  # fmt: skip


def linear_model(
    config: RunConfig, theta1: float, theta2: float, continuous: bool = False
) -> LinearModel:
    """
    Return the arm of ``config`` with both sensors and their delays, about rest at a pose, rad.

    Outputs: the plant's coordinates and rates (undelayed), encoder and tip sensor as delivered,
    the end deflections (undelayed).  Inputs: the torques at the joints.  Not included: drives and
    the channel of the command, the controller's rate, Coulomb friction, noise, encoder resolution,
    jitter and loss, motion of the pose.  Raises ``ValueError``, naming the key, for a sensor
    slower than the tick (not time-invariant) and for a delay of too many ticks.
    """
    arm = linearise(config, theta2, theta1)
    size = len(arm.mass)
    if continuous:
        a, b = arm.state_space()
        period = 0.0
    else:
        _check_rate(config)
        period = Timeline.of(config.run).period
        a, b = hold_matrices(arm, period)
    point = arm.point(config.tip_sensor.location, config.tip_sensor.measurand == 'elastic')
    sensed = [np.asarray(np.kron(np.eye(2), part)) for part in (np.eye(2, size), point)]
    lines = [_line(config, node, continuous) for node in SENSORS]
    system = _joined(a, b, sensed, lines)
    whole = np.zeros((2 * size + 2, len(system.a)))
    whole[:-2, : 2 * size] = np.eye(2 * size)
    whole[-2:, :size] = arm.deflection
    names = coordinate_names(config.plant.modes)
    coordinates = (*names, *(f'{name}_rate' for name in names))
    c = np.vstack([whole[:-2], system.c, whole[-2:]])
    return LinearModel(
        a=system.a,
        b=system.b,
        c=c,
        d=np.zeros((len(c), len(TORQUES))),
        states=(*coordinates, *_delay_names(lines)),
        outputs=(*coordinates, *ENCODER, *TIP_SENSOR, *DEFLECTION),
        period=period,
        theta1=theta1,
        theta2=theta2,
    )


def _joined(
    a: FloatArray, b: FloatArray, sensed: list[FloatArray], lines: list[DelayLine]
) -> DelayLine:
    """Return arm and delay lines as one system whose outputs are those of the two sensors."""
    size = len(a)
    inner = block_diag(*(line.a for line in lines))
    taken = np.vstack([line.b @ part for line, part in zip(lines, sensed, strict=True)])
    total = np.block([[a, np.zeros((size, len(inner)))], [taken, inner]])
    force = np.vstack([b, np.zeros((len(inner), b.shape[1]))])
    direct = np.vstack([line.d @ part for line, part in zip(lines, sensed, strict=True)])
    delivered = np.hstack([direct, block_diag(*(line.c for line in lines))])
    return DelayLine(total, force, delivered, np.zeros((len(delivered), b.shape[1])))


def _line(config: RunConfig, node: str, continuous: bool) -> DelayLine:
    """Return a sensor's delay line for its four channels."""
    section = config.section(node)
    latency_ns = named_ns(f'{node}.latency', section.latency)
    if continuous:
        return _continuous_pade(latency_ns / NS_PER_S).wide(CHANNELS)
    period_ns = Timeline.of(config.run).period_ns
    if node == TipSensorPart.NAME and section.latency_model == 'pade2':
        return pade_line(period_ns, latency_ns).wide(CHANNELS)
    most = MOST_STATES // CHANNELS
    if line_length(period_ns, latency_ns) > most:
        raise ValueError(
            f'{node}.latency: {section.latency:g} s is {latency_ns // period_ns} ticks, too many '
            f'for a linear model (at most {most})'
        )
    return buffer_line(period_ns, latency_ns).wide(CHANNELS)


def _continuous_pade(latency: float) -> DelayLine:
    """
    Return the paper's second-order Pade approximation of a delay, s, of one channel.

    (1 - s tau / 2 + (s tau)^2 / 12) / (1 + s tau / 2 + (s tau)^2 / 12), states z1 = the input at
    rest and z2 = tau z1'; see :func:`flexarm_ros.core.sensing.delay.pade2_matrices`.
    """
    if latency == 0.0:
        return DelayLine(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1)))
    a = np.array([[0.0, 1.0], [-12.0, -6.0]]) / latency
    b = np.array([[0.0], [12.0]]) / latency
    return DelayLine(a, b, np.array([[0.0, -1.0]]), np.ones((1, 1)))


def _delay_names(lines: list[DelayLine]) -> list[str]:
    return [
        f'{node}_delay{i // CHANNELS + 1}_{i % CHANNELS + 1}'
        for node, line in zip(('encoder', 'sensor'), lines, strict=True)
        for i in range(len(line.a))
    ]


def _check_rate(config: RunConfig) -> None:
    period_ns = Timeline.of(config.run).period_ns
    for node in SENSORS:
        ticks = ticks_between(f'{node}.rate', config.section(node).rate, period_ns)
        if ticks > 1:
            raise ValueError(
                f'{node}.rate: a sample lasts {ticks} ticks, so that the loop is not '
                'time-invariant a tick; allowed here: 0 (every tick)'
            )
