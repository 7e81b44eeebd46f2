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
What depends on the middleware (rmw): settings before it starts, and how its GIDs are made.

No other module of the nodes assumes anything about one middleware.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from flexarm_ros.nodes.identity import gid_of, node_of
import rclpy

PROFILES_FILE = 'FASTDDS_DEFAULT_PROFILES_FILE'
_PROFILES = Path(__file__).with_name('assets') / 'fastdds.xml'
_USERS = (PROFILES_FILE, 'FASTRTPS_DEFAULT_PROFILES_FILE')
_USERS_LOCAL = 'DEFAULT_FASTDDS_PROFILES.xml'

_RTPS = ('rmw_fastrtps_', 'rmw_cyclonedds_', 'rmw_connextdds', 'rmw_gurumdds_')
"""Middlewares whose GIDs are RTPS GUIDs: 12 bytes of the DDS participant, 4 of the endpoint."""
_PREFIX = 12


def prepare() -> None:
    """
    Put our defaults in the environment of this process; what the user has set stays.

    Fast DDS drops what goes through shared memory to a process that has not read for a
    second (it was stopped, or an overloaded machine did not let it run), and repairs it at
    the writer's next heartbeat, every 3 s.  At the end of a run that is too late.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    if not any(name in os.environ for name in _USERS) and not Path(_USERS_LOCAL).exists():
        os.environ[PROFILES_FILE] = str(_PROFILES)


def name() -> str:
    """Return the middleware in use, as RMW_IMPLEMENTATION names it."""
    return str(rclpy.get_rmw_implementation_identifier())


def gid_prefix() -> int:
    """Return how many bytes of a GID are the same in one process; 0 where none are."""
    return _PREFIX if name().startswith(_RTPS) else 0


def source_of(endpoint: Any) -> bytes:
    """
    Return bytes that are the same for all endpoints of one participant of the graph.

    The DDS participant where GIDs are RTPS GUIDs, else the name of the node: two nodes
    of one name are then one source.
    """
    length = gid_prefix()
    return gid_of(endpoint)[:length] if length else node_of(endpoint).encode()
