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

"""Optional parts between controller and arm: the drives, and disturbances."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
import math
from typing import Any

from flexarm_ros.core.parameters.rig import ActuatorParameters, DisturbanceParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import Answer, Column, COMMAND, STATE
from flexarm_ros.core.sensing.channel_keys import check_channel
from flexarm_ros.core.signals import JOINTS, Joints, PlanarForce, PointMass, Signal
from flexarm_ros.core.timeline import NS_PER_S, Timeline

ACTUATOR_TORQUE, WRENCH = 'actuator/torque', 'disturbance/wrench'
PAYLOAD = 'disturbance/payload'


class ActuatorPart(Answer):
    """
    The drives: from the commanded torque to that applied at the joints.

    The command reaches the drives through a channel; before the first one has arrived it is 0.
    With one latency for all commands the drives have at each tick the mean, over the tick, of
    the command as it arrives.  It is rounded to the resolution, reduced by the efficiency and
    saturated: the set point, which the torque approaches with the drive's bandwidth.  Backlash
    is the plant's.
    """

    NAME = 'actuator'
    Parameters = ActuatorParameters
    READS = (COMMAND,)

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the torques applied at the time of the stamp, then their set points."""
        names = (*JOINTS, *(f'{joint}_set_point' for joint in JOINTS))
        return (Signal(ACTUATOR_TORQUE, Joints(names, ('effort',))),)

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the applied torques."""
        return tuple(Column(f'applied{i + 1}', ACTUATOR_TORQUE, i, 'N m') for i in (0, 1))

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for backlash without a hub's inertia, and for lost commands."""
        drive, hubs = config.section(cls.NAME), config.plant.hub_inertia
        check_channel(cls.NAME, drive, Timeline.of(config.run).period_ns)
        for joint, (gap, hub) in enumerate(zip(drive.backlash, hubs, strict=True)):
            if gap > 0.0 and hub == 0.0:
                raise ValueError(
                    f'actuator.backlash: {gap!r} rad of {JOINTS[joint]}, whose '
                    'plant.hub_inertia is 0; allowed: 0, or a hub inertia above 0'
                )
        if config.run.sync == 'free' and config.plant.command_loss == 'zero':
            raise ValueError(
                'plant.command_loss: zero; allowed with sync: free and section actuator, whose '
                'drives take every command: end'
            )

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.numerics.elementary import exp
        from flexarm_ros.core.sensing.channel import LatencyChannel

        self._drive: ActuatorParameters = config.section(self.NAME)
        self._channel = LatencyChannel(
            self.NAME, self._drive, Timeline.of(config.run), 2, config.run.seed, start=(0.0, 0.0)
        )
        self._command: Sequence[float] = (0.0, 0.0)
        period = Timeline.of(config.run).period
        self._falls = [
            exp(-2.0 * math.pi * hz * period) if hz > 0.0 else 0.0 for hz in self._drive.bandwidth
        ]
        self._torque = (0.0, 0.0)
        self._lag = [hz > 0.0 for hz in self._drive.bandwidth]

    def answer(self, k: int, command: tuple[float, float]) -> tuple[float, ...]:
        """Return the torques at t_k and the set points from there on, N m."""
        arrived = self._channel.step(k, command)
        if arrived is not None:
            self._command = arrived[1]
        points = tuple(self._set_point(self._command[joint], joint) for joint in (0, 1))
        now = tuple(
            torque if lag else point
            for torque, point, lag in zip(self._torque, points, self._lag, strict=True)
        )
        first, second = (
            point + (torque - point) * fall
            for point, torque, fall in zip(points, now, self._falls, strict=True)
        )
        self._torque = first, second
        return (*now, *points)

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys that the channel cannot take."""
        self._channel.check(config.section(self.NAME))

    def retune(self, config: RunConfig) -> None:
        """Take latency, jitter and loss from the next tick on."""
        self._channel.retune(config.section(self.NAME))

    def _set_point(self, command: float, joint: int) -> float:
        drive = self._drive
        step, limit = drive.resolution[joint], drive.torque_limit[joint]
        if step > 0.0 and abs(command) < 1e15 * step:
            command = round(command / step) * step
        torque = drive.efficiency[joint] * command
        return min(max(torque, -limit), limit) if limit > 0.0 else torque


class DisturbancePart(Answer):
    """A force at the tip and the payload, from their files; an external node may give any."""

    NAME = 'disturbance'
    Parameters = DisturbanceParameters
    SHARED = ('payload_live', 'payload_times', 'payload_masses')
    READS = (STATE,)

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the force over the tick, and the payload if it varies."""
        force = Signal(WRENCH, PlanarForce())
        if not cls.varies_payload(config):
            return (force,)
        return force, Signal(PAYLOAD, PointMass(config.plant.payload_mass))

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the force, and the payload if it varies."""
        force = Column('force_x', WRENCH, 0, 'N'), Column('force_y', WRENCH, 1, 'N')
        payload = (Column('payload', PAYLOAD, 0, 'kg'),)
        return (*force, *payload) if cls.varies_payload(config) else force

    @classmethod
    def varies_payload(cls, config: RunConfig) -> bool:
        """Return whether the payload is on a topic."""
        held = config.section(cls.NAME)
        return held is not None and bool(held.varies_payload)

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for tables that are incomplete or not in order of time."""
        held = config.section(cls.NAME)
        for file, names in TABLES.items():
            columns = [getattr(held, name) for name in names]
            given = [column for column in columns if column is not None]
            if getattr(held, file) is not None and not given:
                raise ValueError(f'disturbance.{file}: its contents were not supplied')
            if given and (len(given) < len(names) or len({len(c) for c in given}) > 1):
                keys = ', '.join(names)
                raise ValueError(f'disturbance.{names[0]}: {keys} must be of one length')
            for before, after in pairwise(columns[0] or ()):
                if after < before:
                    raise ValueError(
                        f'disturbance.{names[0]}: {after!r} s after {before!r} s; times must not '
                        'decrease'
                    )

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.control.open_loop import torque_at
        import numpy as np

        self._held = held = config.section(self.NAME)
        self._first_mass = config.plant.payload_mass
        self._at, self._period_ns = torque_at, Timeline.of(config.run).period_ns
        columns = (held.force_times, held.force_x, held.force_y)
        self._table = np.array([column or () for column in columns], dtype=float).T.copy()
        self._varies = held.varies_payload

    def answer(self, k: int, state: Any) -> Any:
        """Return fx, fy, N, at the middle of the tick; with a payload a tuple of that and kg."""
        force = self._force(k)
        if not self._varies:
            return force
        return force, (self._held.payload_at(k * self._period_ns / NS_PER_S, self._first_mass),)

    def _force(self, k: int) -> tuple[float, float]:
        if not len(self._table):
            return 0.0, 0.0
        found: tuple[float, float] = self._at(self._table, k, self._period_ns, 0.0)
        return found


TABLES = {
    'force_file': ('force_times', 'force_x', 'force_y'),
    'payload_file': ('payload_times', 'payload_masses'),
}
"""Key of a file in section ``disturbance`` -> keys of its columns."""
