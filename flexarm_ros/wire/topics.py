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
The topics of a run: names, types, quality of service and canonical order.

Each of these topics carries exactly one message at every tick, except ``/clock``, which depends
on ``/**.clock_rate``, and what the plant reads in a free-running run.  The topics follow from the
scenario's parts (`flexarm_ros.core.run.parts`).
The order of ``per_tick_topics`` is the order of the messages of one tick in a bag; it follows
the data flow: clock, state, measurements and reference, torque; then what optional parts publish.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, TipSensorParameters
from flexarm_ros.core.run import part, parts
from flexarm_ros.core.run.required_parts import PlantPart
from flexarm_ros.core.signals import (
    BASE_FRAME,
    Content,
    Inertial,
    Joints,
    PlanarForce,
    PlanarPoint,
    PointMass,
    TOOL_FRAME,
)
from flexarm_ros.wire.cdr import (
    ClockCodec,
    Codec,
    ImuCodec,
    JointStateCodec,
    MassCodec,
    OdometryCodec,
    WrenchCodec,
)

CLOCK, STATE, JOINT_STATES, TIP, REFERENCE, COMMAND = map(
    parts.place,
    (part.CLOCK, part.STATE, part.JOINT_STATES, part.TIP, part.REFERENCE, part.COMMAND),
)
"""Index of each required topic in ``per_tick_topics``, the same in every scenario."""

DEPTH = 1000
"""Depth of every history, in messages.

The recorder takes messages in batches and may lag by as many ticks.  Reliable keep-last
publishers drop messages that a late reader has not acknowledged once the depth is exceeded.
"""


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic, in the terms of rmw."""

    reliability: str = 'reliable'
    durability: str = 'volatile'
    history: str = 'keep_last'
    depth: int = DEPTH


@dataclass(frozen=True)
class Topic:
    """
    One per-tick topic of a run.

    ``name`` is relative (``plant/state``), so that namespaces and remapping
    work, except ``/clock``; ``path`` is the name in a bag.  ``node`` publishes
    it, at tick 0 and every ``every`` ticks.  For the stamps ``late`` and ``ahead`` see
    `flexarm_ros.core.run.part.Part`.  ``recorded_from``: the topic from which the recorder has
    it, if another.  ``start``: what the plant of a free-running run holds before the first
    message, zeros if empty.  ``repeated``: its publisher may skip ticks, for which readers repeat
    the message before.
    """

    name: str
    node: str
    codec: Codec
    qos: Qos = Qos()
    every: int = 1
    late: bool = False
    ahead: bool = False
    recorded_from: str = ''
    start: tuple[float, ...] = ()
    repeated: bool = False

    def due(self, tick: int) -> bool:
        """Whether a message belongs to ``tick``."""
        return tick % self.every == 0

    def count(self, ticks: int) -> int:
        """Return the number of messages in the first ``ticks`` ticks."""
        return -(-ticks // self.every)

    @property
    def nothing(self) -> tuple[float, ...]:
        """Return the values that the plant holds before the first message."""
        return self.start or (0.0,) * len(self.codec.fields)

    @property
    def path(self) -> str:
        """Absolute name, as in a bag."""
        return self.name if self.name.startswith('/') else '/' + self.name

    @property
    def type_name(self) -> str:
        """ROS 2 type, as ``sensor_msgs/msg/JointState``."""
        return self.codec.type_name


APPLIED = ('plant/applied_command', 'plant/applied_wrench', 'plant/applied_payload')
"""In a free-running run: what the plant has held of each topic that it reads, in their order.

It is recorded in place of that topic: ``joint_command`` or, with drives, ``actuator/torque``; the
wrench; the payload.
"""

TIMING = 'plant/timing'
"""In a free-running run: the wall times `TIMES` of each tick."""

TIMES = ('tick', 'due', 'command')
"""Names in `TIMING`; ``position``: s since the first tick was due, by a monotonic clock.

When the tick began, when it was due, and when the command held over it arrived (-1: none yet).
"""


def per_tick_topics(config: RunConfig) -> tuple[Topic, ...]:
    """
    Return the topics of a run in canonical order.

    In a free-running one the message of a tick on a topic that the plant reads is what the plant
    held, with the stamp of the tick that it answers, and the times of each tick come last.  A
    command that the plant does not read, since drives do, may skip ticks.
    """
    topics = _lockstep_topics(config)
    if config.run.sync != 'free':
        return topics
    held = dict(zip(PlantPart.reads(config), APPLIED, strict=False))
    timing = Topic(TIMING, PlantPart.NAME, JointStateCodec(TIMES, '', ('position',)))
    return (
        *(
            replace(t, late=True, recorded_from=held[t.name])
            if t.name in held
            else replace(t, repeated=t.name == part.COMMAND)
            for t in topics
        ),
        timing,
    )


def torque_place(topics: Sequence[Topic]) -> int:
    """Return the index of the torque that the plant of a free-running run holds."""
    return [topic.recorded_from for topic in topics].index(APPLIED[0])


def applied(topic: Topic) -> Topic:
    """Return the topic on which the plant publishes what it held of ``topic``."""
    name = topic.recorded_from
    return replace(topic, name=name, node=PlantPart.NAME, recorded_from='')


def _lockstep_topics(config: RunConfig) -> tuple[Topic, ...]:
    return tuple(
        Topic(
            signal.name,
            owner.NAME,
            codec(signal.content),
            every=signal.every,
            late=owner.LATE,
            ahead=owner.AHEAD,
            start=(signal.content.start,) if isinstance(signal.content, PointMass) else (),
        )
        for owner, signal in parts.signals(config)
    )


def codec(content: Content) -> Codec:
    """Return the codec of a signal's values."""
    if isinstance(content, PlanarForce):
        return WrenchCodec(BASE_FRAME)
    if isinstance(content, PointMass):
        return MassCodec(TOOL_FRAME)
    if isinstance(content, Inertial):
        return ImuCodec(content.frame, content.gyro_variance, content.accel_variance)
    if isinstance(content, Joints):
        return JointStateCodec(content.names, BASE_FRAME, content.fields)
    if isinstance(content, PlanarPoint):
        return OdometryCodec(BASE_FRAME, content.child, content.variance)
    return ClockCodec()


def topics_of(modes: int, further: int = 0, clock_every: int = 1) -> tuple[Topic, ...]:
    """
    Return the topics of a run without a scenario, in canonical order.

    ``modes``: assumed modes per link; ``further``: number of tip sensors at
    ``tip_sensor.more_locations``; ``clock_every``: ticks between messages on ``/clock``.
    """
    plant = PlantParameters(modes=modes)
    tip = TipSensorParameters(more_locations=(0.0,) * further or None)
    topics = list(per_tick_topics(RunConfig(plant=plant, tip_sensor=tip)))
    topics[CLOCK] = replace(topics[CLOCK], every=clock_every)
    return tuple(topics)
