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

At every tick each of these topics carries exactly one message, ``/clock`` only where
``/**.clock_rate`` says so.  The order of
``per_tick_topics`` is the order of the messages of one tick in a bag; it follows
the flow of the data: clock, state, measurements and reference, torque.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from flexarm_ros.bag.cdr import ClockCodec, Codec, JointStateCodec, OdometryCodec
from flexarm_ros.core.compiled import FloatArray
from flexarm_ros.core.parameters import RunConfig
from flexarm_ros.core.timeline import clock_ticks

_Values = TypeVar('_Values', tuple[float, ...], FloatArray)

BASE_FRAME = 'base'
JOINTS = ('shoulder', 'elbow')
LINKS = ('link1', 'link2')

CLOCK, STATE, JOINT_STATES, TIP, REFERENCE, COMMAND = range(6)
"""Index of each topic in ``per_tick_topics``; those of further tip sensors come behind them."""

DEPTH = 1000
"""Depth of every history, in messages.

Deep, because the recorder sleeps and takes messages in batches: it may be as
many ticks late.  Reliable keep-last publishers drop what a late reader has not
acknowledged once the depth is passed.
"""


@dataclass(frozen=True)
class Qos:
    """Quality of service of a topic, in rmw's terms."""

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
    it, at tick 0 and every ``every`` ticks.
    """

    name: str
    node: str
    codec: Codec
    qos: Qos = Qos()
    every: int = 1

    def due(self, tick: int) -> bool:
        """Whether a message belongs to ``tick``."""
        return tick % self.every == 0

    def count(self, ticks: int) -> int:
        """Return the number of messages in the first ``ticks`` ticks."""
        return -(-ticks // self.every)

    @property
    def path(self) -> str:
        """Absolute name, as in a bag."""
        return self.name if self.name.startswith('/') else '/' + self.name

    @property
    def type_name(self) -> str:
        """ROS 2 type, as ``sensor_msgs/msg/JointState``."""
        return self.codec.type_name


def state_names(modes: int) -> tuple[str, ...]:
    """Names of the plant's coordinates for ``modes`` assumed modes a link."""
    modal = [f'{link}_mode{i}' for link in LINKS for i in range(1, modes + 1)]
    return (*JOINTS, *modal)


def split_state(values: _Values, size: int) -> tuple[_Values, _Values, _Values]:
    """Split the values of ``plant/state``: ``size`` coordinates, their rates, end deflections."""
    half = size + len(LINKS)
    end = half + size
    return values[:size], values[half:end], values[size:half]


def per_tick_topics(config: RunConfig) -> tuple[Topic, ...]:
    """Return the topics of a run in canonical order."""
    further = len(config.tip_sensor.more_locations or ())
    variance = config.tip_sensor.noise_std * config.tip_sensor.noise_std
    return topics_of(config.plant.modes, further, variance, clock_ticks(config.run))


def topics_of(
    modes: int, further: int = 0, variance: float = 0.0, clock_every: int = 1
) -> tuple[Topic, ...]:
    """
    Return the topics of a run in canonical order.

    ``modes``: assumed modes a link; ``further``: number of tip sensors at
    ``tip_sensor.more_locations``, whose topics come behind all others;
    ``variance``: of the tip sensors' position, m^2; ``clock_every``: ticks between messages on
    ``/clock``.
    """
    state = JointStateCodec((*state_names(modes), *LINKS), BASE_FRAME)
    joints = JointStateCodec(JOINTS, BASE_FRAME)
    tip = OdometryCodec(BASE_FRAME, 'tip_sensor', variance)
    reference = OdometryCodec(BASE_FRAME, 'reference')
    command = JointStateCodec(JOINTS, BASE_FRAME, ('effort',))
    return (
        Topic('/clock', 'plant', ClockCodec(), every=clock_every),
        Topic('plant/state', 'plant', state),
        Topic('joint_states', 'encoder', joints),
        Topic('tip_sensor/odometry', 'tip_sensor', tip),
        Topic('reference', 'trajectory', reference),
        Topic('joint_command', 'controller', command),
        *(
            Topic(
                f'tip_sensor/odometry_{number}', 'tip_sensor',
                OdometryCodec(BASE_FRAME, f'tip_sensor_{number}', variance),
            )
            for number in range(1, further + 1)
        ),
    )  # fmt: skip
