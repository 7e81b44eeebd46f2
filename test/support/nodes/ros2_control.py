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
Stands in for ros2_control in tests: topics, types, QoS and stamps of its nodes, without its C++.

A hardware component ``JointStateTopicSystem``, a ``joint_state_broadcaster`` and a
``forward_command_controller`` for effort, wired as docs/howto/controller_in_the_loop.md says, and
a node that commands it.
"""

from __future__ import annotations

from contextlib import suppress
import math
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data, qos_profile_system_default
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

GOAL = (-2.4, 0.2)
PERIOD = 0.01
"""Of the controller manager's update, s of simulated time; twice the plant's."""

JOINTS = ('shoulder', 'elbow')
STATES, COMMANDS = 'joint_state_broadcaster/joint_states', 'effort_controller/commands'


class ControllerManager(Node):
    """Reads the component's joint states, updates both controllers, and writes its command."""

    def __init__(self) -> None:
        clock = Parameter('use_sim_time', value=True)
        super().__init__('flexarm', parameter_overrides=[clock])
        self.latest, self.effort = JointState(), [0.0, 0.0]
        self.command = self.create_publisher(JointState, 'joint_command', 1)
        self.broadcast = self.create_publisher(JointState, STATES, qos_profile_system_default)
        self.create_subscription(JointState, 'joint_states', self.read, qos_profile_sensor_data)
        self.create_subscription(
            Float64MultiArray, COMMANDS, self.forward, qos_profile_system_default
        )
        self.create_timer(PERIOD, self.update)

    def read(self, states: Any) -> None:
        """Keep the newest joint states."""
        self.latest = states

    def forward(self, command: Any) -> None:
        """Keep the newest efforts."""
        self.effort = list(command.data)

    def update(self) -> None:
        """Publish the joint states, and the efforts with the time of the clock."""
        now = self.get_clock().now().to_msg()
        states = dict(zip(self.latest.name, self.latest.position, strict=True))
        rates = dict(zip(self.latest.name, self.latest.velocity, strict=True))
        if states:
            told = JointState(name=JOINTS, position=[states[j] for j in JOINTS])
            told.velocity, told.effort = [rates[j] for j in JOINTS], [math.nan, math.nan]
            told.header.stamp = now
            self.broadcast.publish(told)
        command = JointState(name=JOINTS, effort=self.effort)
        command.header.stamp = now
        self.command.publish(command)


class Commander(Node):
    """PD on the joints, of what the broadcaster says."""

    def __init__(self) -> None:
        super().__init__('commander')
        self.efforts = self.create_publisher(Float64MultiArray, COMMANDS, 1)
        self.create_subscription(JointState, STATES, self.answer, 1)

    def answer(self, states: Any) -> None:
        """Send the torques."""
        joints = zip(GOAL, states.position, states.velocity, (100.0, 30.0), strict=True)
        data = [kp * (goal - angle) - 0.8 * kp * rate for goal, angle, rate, kp in joints]
        self.efforts.publish(Float64MultiArray(data=data))


if __name__ == '__main__':
    rclpy.init()
    executor = SingleThreadedExecutor()
    for node in (ControllerManager(), Commander()):
        executor.add_node(node)
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        executor.spin()
