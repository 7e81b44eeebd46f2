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
The sampled closed loop, linearised about rest at a pose of the arm.

The loop's state is

    (x, x', torques of drives with a bandwidth, content of each sensor's delay line, held samples,
    the law's own state, a held torque, content of the command's delay line, a held command,
    the low-passes of the strain gauges)

at the start of a tick: the sensors deliver, the law computes, the torques are held and the arm
moves to the next tick.  Small motions about the pose decay if every eigenvalue of this one-tick
matrix is inside the unit circle.  With a lower rate of a sensor, the law or the command it is the
matrix over the least common multiple of their ticks.

For (21) this holds at the gain K_s lambda(0, 0) of straight links.  Another gain, by ``factor``,
freezes lambda at its value for bent links: such a loop does not exist at rest, but does while the
arm swings.

The motion-planning laws are in :mod:`flexarm_ros.stability.planned`.

Not in the linear analysis: torque limits, Coulomb friction, backlash, noise, resolutions,
disturbances, jitter and loss of samples, motion of the pose.  Viscous friction, the drives'
bandwidth, rates, the compute delay and the latency of the command are in it, and so are strain
gauges with their low-pass where a law is linear in the deflections.  Measured latencies count with
their mean; `largest_latency_s` is for a bound.
"""

from __future__ import annotations

from itertools import pairwise
import math
from typing import Any

from flexarm_ros.core.control import LAWS
from flexarm_ros.core.control.state_feedback import StateFeedback
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, specs, values_of
from flexarm_ros.core.run.make_plant import choose_integrator
from flexarm_ros.core.run.required_parts import ControllerPart
from flexarm_ros.core.run.rig_parts import ActuatorPart, DisturbancePart
from flexarm_ros.core.sensing.parts import EncoderPart, TipSensorPart
from flexarm_ros.core.sensing.strain_gauge import closes_the_loop, StrainGaugePart
from flexarm_ros.core.timeline import named_ns, NS_PER_S, ticks_between, Timeline
from flexarm_ros.stability.form import LinearLaw
from flexarm_ros.stability.gauge import DeflectionSensor
from flexarm_ros.stability.hold import (
    buffer_line,
    DelayLine,
    driven_hold_matrices,
    line_length,
    pade_line,
)
from flexarm_ros.stability.law import FORMS, linear_law, reads_deflections
from flexarm_ros.stability.modes import linearise
import numpy as np
from numpy.typing import NDArray

MOST_STATES = 1500
"""Largest state of a loop that is analysed; its eigenvalues take about ten seconds."""

SENSORS = (EncoderPart.NAME, TipSensorPart.NAME)
GAUGE = StrainGaugePart.NAME
RATED = (*SENSORS, GAUGE, ControllerPart.NAME, ActuatorPart.NAME)
"""Roles with a rate in the loop."""

_ANALYSED = {
    EncoderPart.NAME: {'latency', 'rate', 'offset'},
    TipSensorPart.NAME: {
        *('location', 'more_locations', 'measurand', 'latency', 'latency_model', 'rate'),
    },
    ActuatorPart.NAME: {
        *('bandwidth', 'efficiency', 'rotor_share', 'torque_constant', 'gear_ratio', 'latency'),
        'rate',
    },
    GAUGE: {
        *('location', 'output', 'gain', 'offset', 'offset_slope', 'filter_cutoff'),
        *('filter_damping', 'latency', 'rate'),
    },
}
"""Role -> keys in the linear analysis, or without effect on it; the others are left out."""
_DEPENDENT = {'jitter_distribution', 'latency_file', 'dropout_burst', 'arrival'}
"""Keys of a channel that have an effect only with another one, which is named."""

CHANNELS = 4
WIDTHS = (CHANNELS, CHANNELS, 2)
"""Channels of encoder, tip sensor and deflections."""
TORQUES = 2


def sensor_of(config: RunConfig) -> str:
    """Return the sensor whose latency is varied: ``controller.feedback`` or the law's input."""
    return LAWS[config.controller.law].SENSOR or config.controller.feedback


def left_out(config: RunConfig) -> list[str]:
    """Return the keys of a scenario that affect the simulation but not its linear analysis."""
    law = LAWS[config.controller.law]
    closes, linear = closes_the_loop(config), reads_deflections(config)
    keys: dict[str, Any] = {
        f'{role}.{key}': values_of(config, role).get(key, default) != default
        for role, analysed in _ANALYSED.items()
        for key, (_, _, default) in specs(SECTIONS[role]).items()
        if key not in analysed | _DEPENDENT and (role != GAUGE or (closes and linear))
    }
    keys |= {
        'controller.torque_limit': config.controller.torque_limit,
        DisturbancePart.NAME: config.section(DisturbancePart.NAME) is not None,
        'plant.coulomb_friction': any(config.plant.coulomb_friction),
        'plant.coulomb_friction_negative': any(config.plant.coulomb_friction_negative or ()),
        'controller.StateFeedback.limit': law is StateFeedback
        and any(config.controller.own().limit),
        # At rest the other laws of this package depend on readings at rest only; a linear form
        # without deflections among its inputs takes the exact ones.
        GAUGE: closes and law not in FORMS and not linear,
        'trajectory.delay': config.trajectory.delay,
    }
    return sorted(key for key, value in keys.items() if value)


def largest_latency_s(channel: ChannelParameters) -> float | None:
    """Return the largest latency that a sample can have, s; None if there is no bound."""
    if channel.latencies is not None:
        return max(channel.latencies)
    if channel.jitter > 0.0 and channel.jitter_distribution != 'uniform':
        return None
    return channel.latency + channel.jitter


def _mean_latency_ns(node: str, channel: ChannelParameters) -> int:
    if channel.latencies is not None:
        return round(sum(channel.latencies) / len(channel.latencies) * NS_PER_S)
    return named_ns(f'{node}.latency', channel.latency)


class SampledLoop:
    """
    The closed loop of a scenario about rest at an elbow angle, over one tick.

    ``theta2``, rad; theta1 is 0, since arm and law are independent of it.
    ``integrator``: ``exact``, or ``plant``, the plant's own steps.  ``compress``
    keeps of a sensor's past only those combinations of its four channels that
    the law reads, instead of the channels themselves.  ``time``, s: time of the gains of a
    time-varying law.

    Raises NoLinearFormError, and ``ValueError`` for a latency of too many ticks.
    """

    def __init__(
        self,
        config: RunConfig,
        theta2: float,
        integrator: str = 'exact',
        compress: bool = True,
        time: float | None = None,
    ) -> None:
        self.config, self.theta2 = config, theta2
        timeline, tip = Timeline.of(config.run), config.tip_sensor
        self.period, self.period_ns = timeline.period, timeline.period_ns
        self.arm = linearise(config, theta2)
        law = linear_law(config, self.arm, time)
        size = len(self.arm.mass)
        deflected = law.reads_deflections(size)
        self.law = law.padded(size)
        steps = choose_integrator(config) if integrator == 'plant' else None
        self.hold = driven_hold_matrices(
            self.arm, config.section(ActuatorPart.NAME), self.period, steps
        )
        sections = {role: config.section(role) or SECTIONS[role]() for role in RATED}
        self._every = {
            role: ticks_between(f'{role}.rate', held.rate, self.period_ns)
            for role, held in sections.items()
        }
        self._gauge = DeflectionSensor.of(config, self.arm, deflected)
        if not self._gauge.measured:
            self._every[GAUGE] = 1
        self.ticks_per_sample = math.lcm(*self._every.values())
        delay_ns = named_ns('controller.compute_delay', config.controller.compute_delay)
        self._command_ns = -(-delay_ns // self.period_ns) * self.period_ns
        self._way_ns = _mean_latency_ns(ActuatorPart.NAME, sections[ActuatorPart.NAME])
        point = self.arm.point(tip.location, tip.measurand == 'elastic')
        joints = np.eye(2, len(self.arm.mass))
        sensed = (np.kron(np.eye(2), part) for part in (joints, point))
        self._sensed = (*sensed, self._gauge.direct)
        self._compress, self._pade = compress, tip.latency_model == 'pade2'
        self._latencies = {name: _mean_latency_ns(name, sections[name]) for name in SENSORS}
        measured = self._gauge.measured
        self._latencies[GAUGE] = _mean_latency_ns(GAUGE, sections[GAUGE]) if measured else 0

    @property
    def sensor(self) -> str:
        """Return the sensor whose latency is varied, see :func:`sensor_of`."""
        return sensor_of(self.config)

    @property
    def latency_ns(self) -> int:
        """Return the latency of the law's sensor, which :meth:`matrix` may vary."""
        return self._latencies[self.sensor]

    @property
    def longest_latency_ns(self) -> int:
        """Return the longest latency of that sensor that :meth:`matrix` accepts."""
        if self.sensor == TipSensorPart.NAME and self._pade:
            return NS_PER_S
        width = max(len(combined) for _, combined in self._splits(self.law)[:2])
        return MOST_STATES // max(width, 1) * self.period_ns

    @property
    def gain(self) -> float:
        """Return the law's own gain, K_s lambda(0, 0) of (21), that ``factor`` multiplies."""
        return self.law.gain

    def matrix(self, factor: float = 1.0, latency_ns: int | None = None) -> FloatArray:
        """
        Return the state's matrix over one tick, or over `ticks_per_sample`.

        ``factor`` multiplies the torques; ``latency_ns`` replaces :attr:`latency_ns`.
        """
        latencies = dict(self._latencies)
        if latency_ns is not None:
            latencies[self.sensor] = latency_ns
        law = self.law.scaled(factor)
        found: dict[frozenset[str], FloatArray] = {}
        result: FloatArray | None = None
        for k in range(self.ticks_per_sample):
            due = frozenset(node for node, every in self._every.items() if k % every == 0)
            if due not in found:
                found[due] = self._tick(law, latencies, due)
            result = found[due] if result is None else found[due] @ result
        assert result is not None
        return result

    def eigenvalues(
        self, factor: float = 1.0, latency_ns: int | None = None
    ) -> NDArray[np.complex128]:
        """
        Return the eigenvalues per tick, ``(states,)``, the largest modulus first.

        If a sample or a torque lasts several ticks, they are the roots of those over that time.
        """
        values = np.linalg.eigvals(self.matrix(factor, latency_ns)).astype(complex)
        if self.ticks_per_sample > 1:
            share = 1.0 / self.ticks_per_sample
            values = np.abs(values) ** share * np.exp(1j * share * np.angle(values))
        return np.asarray(values[np.argsort(-np.abs(values), kind='stable')])

    def modulus(self, factor: float = 1.0, latency_ns: int | None = None) -> float:
        """Return the largest modulus per tick."""
        return float(np.abs(self.eigenvalues(factor, latency_ns)[0]))

    def _line(self, node: str, latency_ns: int, width: int) -> DelayLine:
        if node == TipSensorPart.NAME and self._pade:
            return pade_line(self.period_ns, latency_ns).wide(width)
        if width * line_length(self.period_ns, latency_ns) > MOST_STATES:
            raise ValueError(
                f'{node}.latency: {latency_ns / 1e9:g} s is {latency_ns // self.period_ns} ticks, '
                f'too many for this analysis (at most {MOST_STATES // width})'
            )
        return buffer_line(self.period_ns, latency_ns).wide(width)

    def _tick(self, law: LinearLaw, latencies: dict[str, int], due: frozenset[str]) -> FloatArray:
        """Return the one-tick matrix; ``due``: what takes a sample or computes at this tick."""
        a, b = self.hold
        size, own, arm = len(a), len(law.a), 2 * len(self.arm.mass)
        nodes, split, gauge = RATED[:3], self._splits(law), self._gauge
        lines = [
            self._line(node, latencies[node], len(combined))
            for node, (_, combined) in zip(nodes, split, strict=True)
        ]
        kept = [
            len(combined) if self._every[node] > 1 else 0
            for node, (_, combined) in zip(nodes, split, strict=True)
        ]
        way = self._line(ActuatorPart.NAME, self._command_ns + self._way_ns, TORQUES)
        out, at = (2 if self._every[node] > 1 else 0 for node in RATED[3:])
        lengths = [*(len(line.a) for line in lines), *kept, own, out, len(way.a), at, len(gauge.a)]
        ends = np.cumsum([size, *lengths])
        places = [slice(int(start), int(end)) for start, end in pairwise(ends)]
        memory, torques, command, applied, filters = places[6:]
        total = int(ends[-1])
        result, whole = np.zeros((total, total)), np.eye(total)
        # The law's inputs as rows over the whole state: b for its own state, d for the torques.
        rows = np.vstack([law.b, law.d])[:, :arm] @ whole[:arm]
        for node, place, store, line, sensed, (gains, combined) in zip(
            nodes, places[:3], places[3:6], lines, self._sensed, split, strict=True
        ):
            sample = np.zeros((len(combined), total))
            sample[:, :arm] = combined @ sensed
            if node == GAUGE:
                sample[:, filters] = combined @ gauge.c
            result[place] = line.b @ sample
            result[place, place] += line.a
            delivered = line.d @ sample
            delivered[:, place] += line.c
            if node not in due:
                delivered = whole[store]
            if self._every[node] > 1:
                result[store] = delivered
            rows += gains @ delivered
        rows[:own, memory] += law.a
        rows[own:, memory] += law.c
        if ControllerPart.NAME not in due:
            rows[:own], rows[own:] = whole[memory], whole[torques]
        result[memory] = rows[:own]
        if out:
            result[torques] = rows[own:]
        result[command] = way.b @ rows[own:] + way.a @ whole[command]
        torque = way.d @ rows[own:] + way.c @ whole[command]
        if ActuatorPart.NAME not in due:
            torque = whole[applied]
        if at:
            result[applied] = torque
        result[filters, :arm], result[filters, filters] = gauge.b, gauge.a
        result[:size] = b @ torque
        result[:size, :size] += a
        return result

    def _splits(self, law: LinearLaw) -> list[tuple[FloatArray, FloatArray]]:
        """Return `_split` of encoder, tip sensor and deflections."""
        starts = np.cumsum([2 * len(self.arm.mass), *WIDTHS]).tolist()
        return [self._split(law, start, end) for start, end in pairwise(starts)]

    def _split(self, law: LinearLaw, start: int, end: int) -> tuple[FloatArray, FloatArray]:
        """
        Split the law's columns of a sensor: gains ``(m + 2, r)`` times combinations ``(r, w)``.

        r, the rank of the columns, is the smallest possible; w: the sensor's channels.
        """
        columns = np.vstack([law.b, law.d])[:, start:end]
        if not columns.any():
            return np.zeros((len(columns), 0)), np.zeros((0, end - start))
        if not self._compress:
            return columns, np.eye(end - start)
        left, values, right = np.linalg.svd(columns, full_matrices=False)
        rank = int(np.sum(values > 1e-13 * values[0]))
        return left[:, :rank] * values[:rank], right[:rank]
