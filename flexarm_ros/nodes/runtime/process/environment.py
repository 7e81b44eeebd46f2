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

"""ROS environment variables, checked before a run starts."""

from __future__ import annotations

import os
import re
import tempfile

_DOMAIN = re.compile(r'\s*\+?(0|[1-9][0-9]{0,2})', re.ASCII)
_LAST_DOMAIN = 232
"""The ports of higher domains are beyond the last UDP port: DDSI-RTPS 2.5, section 9.6.2."""


class EnvironmentRefused(Exception):
    """An environment variable has an impossible value; one line for the user."""


def read_domain(text: str) -> int:
    """Return a ROS_DOMAIN_ID as rcl reads it; ValueError if it is invalid."""
    match = _DOMAIN.fullmatch(text)
    if match is None or int(match[1]) > _LAST_DOMAIN:
        raise ValueError(f'{text!r}: not a whole number from 0 to {_LAST_DOMAIN}')
    return int(match[1])


def enforce_security() -> None:
    """
    Let rcl fail if it cannot secure a node although ROS_SECURITY_ENABLE is set.

    Its default strategy leaves nodes without keys unsecured, without a message.  Raises
    EnvironmentRefused if there are no keys at all.
    """
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return
    if not os.environ.get('ROS_SECURITY_KEYSTORE'):
        raise EnvironmentRefused(
            'ROS_SECURITY_ENABLE=true: nothing can be secured, ROS_SECURITY_KEYSTORE is not set'
        )
    os.environ['ROS_SECURITY_STRATEGY'] = 'Enforce'


def environment_domain() -> int | None:
    """Return ROS_DOMAIN_ID, None if it is not set; EnvironmentRefused if it is invalid."""
    text = os.environ.get('ROS_DOMAIN_ID', '')
    try:
        return read_domain(text) if text else None
    except ValueError as error:
        raise EnvironmentRefused(f'ROS_DOMAIN_ID={error}') from None


def wanted_log_directory() -> str:
    """
    Return the directory that the user has chosen for rcl's log files, empty if none.

    As rcl finds it, except that the default ``~/.ros/log`` does not count as chosen.
    """
    home = os.environ.get('ROS_HOME')
    chosen = os.environ.get('ROS_LOG_DIR') or (os.path.join(home, 'log') if home else '')
    return os.path.abspath(os.path.expanduser(chosen)) if chosen else ''


def log_directory() -> str:
    """Return `wanted_log_directory`, empty if it cannot be written to."""
    wanted = wanted_log_directory()
    try:
        if wanted:
            os.makedirs(wanted, exist_ok=True)
            tempfile.TemporaryFile(dir=wanted).close()
    except (OSError, ValueError):
        return ''
    return wanted


def environment_notes() -> list[str]:
    """Return a line for each variable that changes how nodes find each other or log."""
    notes = []
    if server := os.environ.get('ROS_DISCOVERY_SERVER'):
        notes.append(
            f'ROS_DISCOVERY_SERVER={server}: nodes discover each other through this server only'
        )
    if (wanted := wanted_log_directory()) and not log_directory():
        notes.append(f'{wanted}: not writable: no log files there (ROS_LOG_DIR, ROS_HOME)')
    return notes
