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
A controller for tests of free-running runs: PD on the joints, and not always in time.

The word after the script says how it fails: ``late``: it answers the newest state only, and takes
4 ms longer now and then; ``dies``: it is ended by SIGTERM after 100 states; ``silent``: it goes on
and says nothing after 100 states.
"""

from __future__ import annotations

from contextlib import suppress
import random
import signal
import sys
import threading
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

GOAL = (-2.5, 0.28)
STATES = 100


class Controller(Node):
    """Answers states as the ``mode`` says."""

    def __init__(self, mode: str) -> None:
        super().__init__('free_controller')
        self.mode, self.states = mode, 0
        self.random = random.Random(4)
        self.never = threading.Event()
        self.torque = self.create_publisher(JointState, 'joint_command', 10)
        depth = 1 if mode == 'late' else 1000
        self.create_subscription(JointState, 'plant/state', self.answer, depth)

    def answer(self, state: Any) -> None:
        """Send the torque of a state."""
        self.states += 1
        if self.states > STATES and self.mode == 'dies':
            # rclpy's handler races with its wait sets, and the exit status with it.
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
            signal.raise_signal(signal.SIGTERM)
        if self.states > STATES and self.mode in ('dies', 'silent'):
            return
        if self.mode == 'late' and self.random.random() < 0.3:
            self.never.wait(0.004)
        command = JointState(name=['shoulder', 'elbow'])
        command.header.stamp = state.header.stamp
        for i, (kp, kd) in enumerate(((2000.0, 400.0), (600.0, 120.0))):
            command.effort.append(kp * (GOAL[i] - state.position[i]) - kd * state.velocity[i])
        self.torque.publish(command)


if __name__ == '__main__':
    rclpy.init()
    with suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(Controller(sys.argv[1]))
