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

"""A ROS_DOMAIN_ID that no other run on this machine uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import socket
import tempfile

FIRST, LAST = 1, 101
"""Domains with ports below Linux's ephemeral range; 0, the common default, is left out."""

_PORT_BASE, _DOMAIN_GAIN, _UNICAST_OFFSET = 7400, 250, 10
"""UDP ports of a domain: DDSI-RTPS 2.5, section 9.6.2."""


class NoDomainError(RuntimeError):
    """Every domain is in use."""


@contextmanager
def reserved_domain(wanted: int | None = None) -> Iterator[int]:
    """
    Yield a domain: ``wanted`` if given, else a free one, locked meanwhile.

    A lock file for each domain separates runs of this package; a check of the domain's
    discovery ports avoids other ROS programs.  Raises NoDomainError if all are in use.
    """
    if wanted is not None:
        yield wanted
        return
    folder = Path(tempfile.gettempdir()) / f'flexarm_ros-{os.getuid()}'
    folder.mkdir(mode=0o700, exist_ok=True)
    start = os.getpid() % LAST
    for step in range(LAST - FIRST + 1):
        domain = FIRST + (start + step) % (LAST - FIRST + 1)
        lock = os.open(folder / f'domain-{domain}.lock', os.O_RDWR | os.O_CREAT, 0o600)
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            continue
        try:
            if _idle(domain):
                yield domain
                return
        finally:
            os.close(lock)
    raise NoDomainError(f'no free ROS_DOMAIN_ID between {FIRST} and {LAST}; give one by --domain')


def _idle(domain: int) -> bool:
    """Whether no process on this machine listens on the domain's first discovery ports."""
    base = _PORT_BASE + _DOMAIN_GAIN * domain
    return all(_free(port) for port in (base, base + _UNICAST_OFFSET, base + _UNICAST_OFFSET + 2))


def _free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(('', port))
        except OSError:
            return False
    return True
