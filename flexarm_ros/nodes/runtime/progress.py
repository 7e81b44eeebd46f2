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
Progress topics: the number of ticks that a node has completed, published every few ticks.

No tick depends on them, and they are repeated during a run.  The plant publishes its tick for the
trajectory, the recorder the number of recorded ticks for the plant.
"""

from __future__ import annotations

from collections.abc import Callable

from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.topics.endpoints import HOT, NO_OVERRIDES
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import UInt64

_QOS = QoSProfile(depth=1)


class ProgressOutput:
    """Publishes a number of ticks on ``topic``."""

    def __init__(self, node: Node, topic: str) -> None:
        self.publisher = node.create_publisher(
            UInt64, topic, _QOS, qos_overriding_options=NO_OVERRIDES
        )

    def tell(self, ticks: int) -> None:
        """Publish ``ticks``."""
        self.publisher.publish(UInt64(data=ticks))


class ProgressInput:
    """
    The largest number of ticks that the node of ``role`` has published on ``topic``.

    ``most`` returns the largest number that is possible now, which limits the effect of other
    publishers if messages do not identify theirs.
    """

    def __init__(
        self, node: Node, membership: Membership, topic: str, role: str, most: Callable[[], int]
    ) -> None:
        self._membership = membership
        self._role, self._topic, self._most = role, topic, most
        self._subscription = node.create_subscription(
            UInt64, topic, lambda _: None, _QOS, callback_group=HOT,
            qos_overriding_options=NO_OVERRIDES,
        )  # fmt: skip
        self.handle = self._subscription.handle
        self.ticks = 0

    def update(self) -> bool:
        """Read one message; False if there is none."""
        taken = self.handle.take_message(UInt64, False)
        if taken is None:
            return False
        ours = self._membership.sent_by(self._role, self._topic, taken[1])
        if ours is not False and taken[0].data <= self._most():
            self.ticks = max(self.ticks, taken[0].data)
        return True

    def drain(self) -> None:
        """Discard the queue: a new run begins at 0."""
        while self.handle.take_message(UInt64, False) is not None:
            pass
        self.ticks = 0
