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
Dependence on the middleware (rmw): settings before it starts, and the layout of its GIDs.

No other module of the nodes depends on a particular middleware.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ament_index_python.packages import get_package_share_path
from flexarm_ros.nodes.runtime.process.environment import log_directory
from flexarm_ros.nodes.runtime.topics.identity import gid_of, node_of
import rclpy
from rclpy.signals import SignalHandlerOptions

PROFILES = {
    3: ('FASTDDS_DEFAULT_PROFILES_FILE', 'fastdds.xml'),
    2: ('FASTRTPS_DEFAULT_PROFILES_FILE', 'fastdds2.xml'),
}
"""Major version of Fast DDS -> variable that names a file of profiles, and this package's file.

Neither version accepts the other's file, and version 3 also reads the variable of version 2.
"""

_FASTDDS_3_SINCE = 9
"""Major version of rmw_fastrtps_cpp (Kilted) from which on Fast DDS is version 3."""

_ASSETS = Path(__file__).with_name('assets')
_USERS_LOCAL = 'DEFAULT_FASTDDS_PROFILES.xml'

_RTPS = ('rmw_fastrtps_', 'rmw_cyclonedds_', 'rmw_connextdds', 'rmw_gurumdds_')
"""Middlewares whose GIDs are RTPS GUIDs: 12 bytes of the DDS participant, 4 of the endpoint."""
_PREFIX = 12


def prepare() -> None:
    """
    Set this package's defaults in the environment of this process; the user's values are kept.

    Fast DDS drops messages through shared memory to a process that has not read for a second (it
    was stopped, or the machine is overloaded), and resends them at the writer's next heartbeat,
    every 3 s by default.  At the end of a run that is too late.
    """
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    users = any(variable in os.environ for variable, _ in PROFILES.values())
    if not users and not Path(_USERS_LOCAL).exists():
        variable, file = PROFILES[fastdds_version()]
        os.environ[variable] = str(_ASSETS / file)


def start(name: str, argv: list[str]) -> None:
    """
    Initialise rclpy for a process ``name`` with a ROS command line; ValueError in one line.

    Nodes log to standard error.  rcl's log files, by default in ``~/.ros/log``, are written only
    if the user has chosen a writable directory.
    """
    prepare()
    quiet = [] if log_directory() else ['--ros-args', '--disable-external-lib-logs', '--']
    try:
        rclpy.init(args=[name, *quiet, *argv], signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:  # a bad command line or parameter file
        raise ValueError((str(error).strip() or type(error).__name__).splitlines()[0]) from None


def fastdds_version() -> int:
    """Return the major version of the installed Fast DDS, 2 or 3; 3 if there is none."""
    try:
        manifest = get_package_share_path('rmw_fastrtps_cpp') / 'package.xml'
        version = ElementTree.parse(manifest).findtext('version', '')
        return 3 if int(version.partition('.')[0]) >= _FASTDDS_3_SINCE else 2
    except (LookupError, OSError, ValueError, ElementTree.ParseError):
        return 3


def name() -> str:
    """Return the name of the middleware in use, as in RMW_IMPLEMENTATION."""
    return str(rclpy.get_rmw_implementation_identifier())


def gid_prefix() -> int:
    """Return the number of GID bytes common to all endpoints of a process; 0 if unknown."""
    return _PREFIX if name().startswith(_RTPS) else 0


def source_of(endpoint: Any) -> bytes:
    """
    Return bytes common to all endpoints of one participant of the graph.

    The DDS participant if GIDs are RTPS GUIDs, else the name of the node; two nodes of one name
    are then one source.
    """
    length = gid_prefix()
    return gid_of(endpoint)[:length] if length else node_of(endpoint).encode()
