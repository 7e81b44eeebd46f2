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

"""What the middleware is told before rclpy starts it: who may hear us, how soon loss is mended."""

from __future__ import annotations

import os
from pathlib import Path

PROFILES_FILE = 'FASTDDS_DEFAULT_PROFILES_FILE'
_PROFILES = Path(__file__).with_name('assets') / 'fastdds.xml'
_USERS = (PROFILES_FILE, 'FASTRTPS_DEFAULT_PROFILES_FILE')
_USERS_LOCAL = 'DEFAULT_FASTDDS_PROFILES.xml'


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
