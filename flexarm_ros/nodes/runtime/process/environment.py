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

"""What a ROS environment asks for, looked at before anything starts."""

from __future__ import annotations

import os
import re
import tempfile

_DOMAIN = re.compile(r'\s*\+?(0|[1-9][0-9]{0,2})', re.ASCII)
_LAST_DOMAIN = 232
"""The ports of higher domains are beyond the last UDP port: DDSI-RTPS 2.5, section 9.6.2."""


class EnvironmentRefused(Exception):
    """A variable asks for what cannot be done; one line for the user."""


def read_domain(text: str) -> int:
    """Return a ROS_DOMAIN_ID as rcl reads it; ValueError where it is none."""
    match = _DOMAIN.fullmatch(text)
    if match is None or int(match[1]) > _LAST_DOMAIN:
        raise ValueError(f'{text!r}: not a whole number from 0 to {_LAST_DOMAIN}')
    return int(match[1])


def enforce_security() -> None:
    """
    Let rcl fail where it cannot secure what ROS_SECURITY_ENABLE asks to be secured.

    Its other strategy, the default, leaves nodes without keys unsecured and does not say so.
    Raises EnvironmentRefused where there are no keys at all.
    """
    if os.environ.get('ROS_SECURITY_ENABLE') != 'true':
        return
    if not os.environ.get('ROS_SECURITY_KEYSTORE'):
        raise EnvironmentRefused(
            'ROS_SECURITY_ENABLE=true: nothing can be secured, ROS_SECURITY_KEYSTORE is not set'
        )
    os.environ['ROS_SECURITY_STRATEGY'] = 'Enforce'


def environment_domain() -> int | None:
    """Return the user's own ROS_DOMAIN_ID, None where it is not set."""
    text = os.environ.get('ROS_DOMAIN_ID', '')
    try:
        return read_domain(text) if text else None
    except ValueError as error:
        raise EnvironmentRefused(f'ROS_DOMAIN_ID={error}') from None


def wanted_log_directory() -> str:
    """
    Return the directory that the user has chosen for rcl's log files, empty if none.

    It is found as rcl does, except that ``~/.ros/log`` is not a choice of the user's.
    """
    home = os.environ.get('ROS_HOME')
    chosen = os.environ.get('ROS_LOG_DIR') or (os.path.join(home, 'log') if home else '')
    return os.path.abspath(os.path.expanduser(chosen)) if chosen else ''


def log_directory() -> str:
    """Return `wanted_log_directory`, empty where nothing can be written there."""
    wanted = wanted_log_directory()
    try:
        if wanted:
            os.makedirs(wanted, exist_ok=True)
            tempfile.TemporaryFile(dir=wanted).close()
    except (OSError, ValueError):
        return ''
    return wanted


def environment_notes() -> list[str]:
    """Return a line for each variable that makes a run behave in an unusual way."""
    notes = []
    if server := os.environ.get('ROS_DISCOVERY_SERVER'):
        notes.append(f'ROS_DISCOVERY_SERVER={server}: nodes find each other through it only')
    if (wanted := wanted_log_directory()) and not log_directory():
        notes.append(f'{wanted}: cannot be written: no log files there (ROS_LOG_DIR, ROS_HOME)')
    return notes
