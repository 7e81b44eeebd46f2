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
Which publisher a message came from, as far as the middleware and rclpy tell.

The graph shows every endpoint with its GID.  A received message's info may hold the
same GID (Fast DDS with rclpy of June 2025 or later), a handle that means something in
the receiving process only (Cyclone DDS), or nothing (rclpy of Jazzy).  No name of a
middleware decides which: each node measures it on its own status message, which comes
back to it (`flexarm_ros.nodes.runtime.joining.status`).
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""Name of an endpoint's node in the graph until it is known; for ever outside ROS 2."""


class SenderInfo(Enum):
    """What a received message's info says of its publisher."""

    GID = 'gid'
    """The GID of the publisher as the graph shows it."""
    HANDLE = 'handle'
    """Bytes that are the same in all messages of one publisher, and are not its GID."""
    NONE = 'none'
    """Nothing."""


def sender_of(info: Mapping[str, Any]) -> bytes:
    """Return the bytes by which a message's info names its publisher; empty where it does not."""
    sender = info.get('publisher_gid')
    data = bytes(sender['data'])[:16] if sender else b''
    return data if any(data) else b''


def gid_of(endpoint: Any) -> bytes:
    """Return the GID of an endpoint of the graph, comparable with `sender_of`."""
    return bytes(endpoint.endpoint_gid)[:16]


def node_of(endpoint: Any) -> str:
    """Return the fully qualified name of the node that an endpoint of the graph belongs to."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
