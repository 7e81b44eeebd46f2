#!/usr/bin/env python3
"""A controller of your own in 40 lines: PD on the joints, in lock-step with our plant.

    flexarm run pd_collocated --without controller &     # says its ROS_DOMAIN_ID
    ROS_DOMAIN_ID=... python3 examples/minimal_controller.py

Answer each plant/state with one joint_command that carries the same stamp; nothing else is asked.
"""

import math
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

GOAL = (-3 * math.pi / 4 - 0.14, 0.28)
KP, KD = (2000.0, 600.0), (400.0, 120.0)


class MinimalController(Node):
    """Holds the arm at GOAL (rad); kp in N m/rad, kd in N m s/rad."""

    def __init__(self) -> None:
        super().__init__("my_controller")
        self.torque = self.create_publisher(JointState, "joint_command", 1000)
        self.create_subscription(JointState, "plant/state", self.answer, 1000)

    def answer(self, state: JointState) -> None:
        """Send the torque for the tick of this state."""
        command = JointState(name=["shoulder", "elbow"])
        command.header.stamp = state.header.stamp
        for i in range(2):
            error = GOAL[i] - state.position[i]
            command.effort.append(KP[i] * error - KD[i] * state.velocity[i])
        self.torque.publish(command)


if __name__ == "__main__":
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(MinimalController())
