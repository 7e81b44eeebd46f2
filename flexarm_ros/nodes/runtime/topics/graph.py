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

"""The node graph of a run in rclpy's types, and the topics of its flow control."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import part_of, readers
from flexarm_ros.wire.topics import Qos, Topic
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

RECORDED_TOPIC = 'lockstep/recorded'
"""std_msgs/UInt64 from the recorder: number of ticks completely recorded."""

TICK_TOPIC = 'lockstep/tick'
"""std_msgs/UInt64 from the plant, every `TICK_EVERY` ticks: its current tick."""

TICK_EVERY = 4


def message_class(type_name: str) -> Any:
    """Return the Python class of a ROS type such as ``sensor_msgs/msg/JointState``."""
    package, _, name = type_name.split('/')
    return getattr(import_module(f'{package}.msg'), name)


def qos_profile(qos: Qos) -> QoSProfile:
    """Return the QoS of a topic as an rclpy profile."""
    return QoSProfile(
        depth=qos.depth,
        history=HistoryPolicy.KEEP_LAST,
        reliability=ReliabilityPolicy[qos.reliability.upper()],
        durability=DurabilityPolicy[qos.durability.upper()],
    )


def reads(role: str, topic: Topic, config: RunConfig) -> bool:
    """Whether ``role`` reads ``topic``."""
    return role in readers(topic.name, config)


def output_of(role: str, config: RunConfig) -> str:
    """Return the topic by which an external node is recognised to fill a role, or none."""
    own = part_of(role).signals(config)
    return own[-1].name if own else ''
