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
Identity of the publisher of a message, as far as the middleware and rclpy provide it.

The graph shows every endpoint with its GID.  The info of a received message may hold the same
GID (Fast DDS with rclpy of June 2025 or later), a handle that is valid in the receiving process
only (Cyclone DDS), or nothing (rclpy of Jazzy).  Which of them is not derived from the name of the
middleware: each node finds out from its own status message, which it receives itself
(`flexarm_ros.nodes.runtime.joining.status`).
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

UNKNOWN_NODE = '_NODE_NAME_UNKNOWN_'
"""Node name of an endpoint until it is known; permanent for endpoints outside ROS 2."""


class SenderInfo(Enum):
    """How the info of a received message identifies the publisher."""

    GID = 'gid'
    """The GID of the publisher as the graph shows it."""
    HANDLE = 'handle'
    """Bytes common to all messages of one publisher, other than its GID."""
    NONE = 'none'
    """Not at all."""


def sender_of(info: Mapping[str, Any]) -> bytes:
    """Return the bytes that identify the publisher in a message's info; empty if none do."""
    sender = info.get('publisher_gid')
    data = bytes(sender['data'])[:16] if sender else b''
    return data if any(data) else b''


def gid_of(endpoint: Any) -> bytes:
    """Return the GID of an endpoint of the graph, comparable with `sender_of`."""
    return bytes(endpoint.endpoint_gid)[:16]


def node_of(endpoint: Any) -> str:
    """Return the fully qualified name of the node that an endpoint of the graph belongs to."""
    return f'{endpoint.node_namespace.rstrip("/")}/{endpoint.node_name}'
