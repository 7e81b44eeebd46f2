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
A tip sensor of your own: the rigid tip corrected by the links' end deflections, with a bias.

    export ROS_DOMAIN_ID=7
    python3 examples/strain_sensor.py &
    flexarm run pd_tip --without tip_sensor --set duration=2

It publishes one tip_sensor/odometry for each plant/state, for tick 0 first and none left out; the
stamp is when the value was measured, at the latest the tick's own.
"""

from contextlib import suppress
import math

from nav_msgs.msg import Odometry
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

LENGTH = 4.5  # m, of each link
SHARE = 0.2  # part of the deflections that is let through: all of them and PD diverges
BIAS = (0.002, -0.001)  # m


class StrainSensor(Node):
    """Estimates the tip from joint angles and end deflections."""

    def __init__(self) -> None:
        super().__init__('my_tip_sensor')
        self.sensed = self.create_publisher(Odometry, 'tip_sensor/odometry', 1000)
        self.create_subscription(JointState, 'plant/state', self.answer, 1000)

    def answer(self, state: JointState) -> None:
        """Send the tip of this state."""
        angle = dict(zip(state.name, state.position, strict=True))
        rate = dict(zip(state.name, state.velocity, strict=True))
        a, da = angle['shoulder'], rate['shoulder']
        b, db = a + angle['elbow'], da + rate['elbow']
        x, y, vx, vy = BIAS[0], BIAS[1], 0.0, 0.0
        for link, phi, turn in (('link1', a, da), ('link2', b, db)):
            along, across = (math.cos(phi), math.sin(phi)), (-math.sin(phi), math.cos(phi))
            bent, bending = SHARE * angle[link], SHARE * rate[link]
            x += LENGTH * along[0] + bent * across[0]
            y += LENGTH * along[1] + bent * across[1]
            vx += (LENGTH * turn + bending) * across[0] - bent * turn * along[0]
            vy += (LENGTH * turn + bending) * across[1] - bent * turn * along[1]
        out = Odometry()
        out.header.stamp, out.header.frame_id = state.header.stamp, 'base'
        out.pose.pose.position.x, out.pose.pose.position.y = x, y
        out.twist.twist.linear.x, out.twist.twist.linear.y = vx, vy
        self.sensed.publish(out)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(StrainSensor())
