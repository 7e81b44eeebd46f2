#!/usr/bin/env python3
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
A controller of your own in 40 lines: PD on the joints, in lock-step with our plant.

    flexarm run pd_collocated --without controller &     # says its ROS_DOMAIN_ID
    ROS_DOMAIN_ID=... python3 examples/minimal_controller.py

Answer each plant/state with one joint_command that carries the same stamp; nothing else is asked.
"""

from contextlib import suppress
import math

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

GOAL = (-3 * math.pi / 4 - 0.14, 0.28)
KP, KD = (2000.0, 600.0), (400.0, 120.0)


class MinimalController(Node):
    """Holds the arm at GOAL (rad); kp in N m/rad, kd in N m s/rad."""

    def __init__(self) -> None:
        super().__init__('my_controller')
        self.torque = self.create_publisher(JointState, 'joint_command', 1000)
        self.create_subscription(JointState, 'plant/state', self.answer, 1000)

    def answer(self, state: JointState) -> None:
        """Send the torque for the tick of this state."""
        command = JointState(name=['shoulder', 'elbow'])
        command.header.stamp = state.header.stamp
        for i in range(2):
            error = GOAL[i] - state.position[i]
            command.effort.append(KP[i] * error - KD[i] * state.velocity[i])
        self.torque.publish(command)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(MinimalController())
