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
A trajectory node of your own: a circle in place of the square, in lock-step.

    export ROS_DOMAIN_ID=7
    python3 examples/circle_trajectory.py &
    flexarm run fls_tip --without trajectory --set duration=4

For each plant/state it publishes one reference with the same stamp.
"""

from contextlib import suppress
import math

from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

RADIUS, LAP = 6.3, 8.0  # m, s
START = -0.75 * math.pi  # where the arm of the shipped scenarios starts, as seen from the base
T0 = 1.0  # the stamp of tick 0, s


class CircleTrajectory(Node):
    """Leads the end effector around the base, clockwise."""

    def __init__(self) -> None:
        super().__init__('my_trajectory')
        self.reference = self.create_publisher(Odometry, 'reference', 1000)
        self.create_subscription(JointState, 'plant/state', self.answer, 1000)

    def answer(self, state: JointState) -> None:
        """Send the reference of this tick: position and velocity, frame base."""
        stamp = state.header.stamp
        time = stamp.sec + stamp.nanosec * 1e-9 - T0
        turn = -2.0 * math.pi / LAP
        angle = START + turn * time
        # It spirals from the square's corner, where the arm starts, on to the circle.
        beyond = (6.3 * math.sqrt(2.0) - RADIUS) * math.exp(-2.0 * time)
        radius, speed = RADIUS + beyond, -2.0 * beyond
        out = Odometry()
        out.header.stamp, out.header.frame_id = stamp, 'base'
        out.pose.pose.position.x = radius * math.cos(angle)
        out.pose.pose.position.y = radius * math.sin(angle)
        out.twist.twist.linear.x = speed * math.cos(angle) - turn * radius * math.sin(angle)
        out.twist.twist.linear.y = speed * math.sin(angle) + turn * radius * math.cos(angle)
        self.reference.publish(out)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(CircleTrajectory())
