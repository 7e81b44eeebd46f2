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
Publishers and subscriptions of the hot path, outside rclpy's executors.

An rclpy executor costs 50 us per message more than the DDS hop itself, so that the lock-step loop
waits on one wait set and reads serialized bytes.  These subscriptions are in a callback group that
no executor runs; parameter services and the rest of the node are in an ordinary executor on a
thread of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos_overriding_options import QoSOverridingOptions

NO_OVERRIDES = QoSOverridingOptions([])


class _NoExecutor(CallbackGroup):
    """Callback group whose entities no executor waits on: the lock-step loop takes them."""

    def can_execute(self, entity: object) -> bool:
        """Return False: nothing in this group is ever for an executor."""
        return False

    def beginning_execution(self, entity: object) -> bool:
        """Return False, see `can_execute`."""
        return False

    def ending_execution(self, entity: object) -> None:
        """Do nothing, see `can_execute`."""


HOT = _NoExecutor()


class Waiter:
    """One wait set for the subscriptions of all participants of this process."""

    def __init__(self, context: Context, capacity: int = 32) -> None:
        self._set = _rclpy.WaitSet(capacity, 0, 0, 0, 0, 0, context.handle)

    @property
    def address(self) -> int:
        """Address of rcl's wait set."""
        return int(self._set.pointer)

    def wait(self, subscriptions: Sequence[Any], timeout_ns: int) -> None:
        """Sleep until one of the ``subscriptions`` (rclpy handles) has a message."""
        self._set.clear_entities()
        for handle in subscriptions:
            self._set.add_subscription(handle)
        self._set.wait(timeout_ns)
