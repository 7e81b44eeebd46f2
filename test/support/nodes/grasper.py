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
An external node ``disturbance`` for tests: no force, and the payloads of the command line.

Its words are ``TICK KG`` pairs: the payload from that state on.
"""

from __future__ import annotations

from contextlib import suppress
import sys
from typing import Any

from geometry_msgs.msg import InertiaStamped, WrenchStamped
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState


class Grasper(Node):
    """Answers each state with the force and the payload."""

    def __init__(self, masses: dict[int, float]) -> None:
        super().__init__('grasper')
        self.masses, self.states = masses, 0
        self.force = self.create_publisher(WrenchStamped, 'disturbance/wrench', 1000)
        self.payload = self.create_publisher(InertiaStamped, 'disturbance/payload', 1000)
        self.create_subscription(JointState, 'plant/state', self.answer, 1000)

    def answer(self, state: Any) -> None:
        """Send the messages of one tick."""
        force, payload = WrenchStamped(), InertiaStamped()
        force.header.stamp = payload.header.stamp = state.header.stamp
        payload.inertia.m = [m for k, m in self.masses.items() if k <= self.states][-1]
        self.force.publish(force)
        self.payload.publish(payload)
        self.states += 1


if __name__ == '__main__':
    rclpy.init()
    pairs = {int(k): float(m) for k, m in zip(sys.argv[1::2], sys.argv[2::2], strict=True)}
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Grasper(pairs))
