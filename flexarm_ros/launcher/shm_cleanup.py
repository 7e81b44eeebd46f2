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
Removal of the shared memory that killed nodes leave behind.

Fast DDS keeps a segment and a port for each participant in ``/dev/shm`` and locks a file beside
each (``fastdds_HEX_el``, ``fastdds_portN_el``) while the participant lives.  A process killed by
SIGKILL removes nothing; a segment of half a megabyte is never used again.  The launcher
records the locks of its own nodes and, once they have ended, removes those of these files
that are no longer locked.  Files of other processes are never touched.
"""

from __future__ import annotations

from collections.abc import Iterable
import contextlib
import fcntl
import os
from pathlib import Path
import time

FOLDER = Path('/dev/shm')
LOCKS = Path('/proc/locks')
PREFIXES = ('fastdds_', 'fastrtps_')
"""Of Fast DDS 3 and of Fast DDS 2, which Jazzy uses."""
_LOCK = '_el'
_TRIES, _PAUSE_S = 5, 0.02


class SharedMemoryCleanup:
    """The shared memory of one run's nodes."""

    def __init__(self) -> None:
        self.names: set[str] = set()

    def note(self, pids: Iterable[int]) -> None:
        """Record the files locked by the living processes ``pids``, as far as known."""
        ours = set(pids)
        try:
            held = _inodes_locked_by(ours)
            with os.scandir(FOLDER) as entries:
                self.names |= {
                    entry.name.removesuffix(_LOCK)
                    for entry in entries
                    if entry.name.startswith(PREFIXES)
                    and entry.name.endswith(_LOCK)
                    and entry.inode() in held
                }
        except OSError:
            return

    def remove(self) -> list[str]:
        """Remove the files of processes that have ended; return their names."""
        gone = []
        for name in sorted(self.names):
            if _stays_in_use(FOLDER / (name + _LOCK)):
                continue
            for file in (name, name + _LOCK, f'sem.{name}_mutex'):
                with contextlib.suppress(OSError):
                    os.unlink(FOLDER / file)
                    gone.append(file)
        self.names.clear()
        return gone


def _stays_in_use(lock: Path) -> bool:
    """Whether ``lock`` is held for longer than Fast DDS holds it for a check of a port."""
    for _ in range(_TRIES):
        if not in_use(lock):
            return False
        time.sleep(_PAUSE_S)
    return True


def _inodes_locked_by(pids: set[int]) -> set[int]:
    """Return the inodes of the files that ``pids`` hold a ``flock`` on."""
    found = set()
    for line in LOCKS.read_text(encoding='ascii', errors='replace').splitlines():
        words = line.split()
        if len(words) >= 6 and words[1] == 'FLOCK' and words[4].isdigit():
            inode = words[5].rpartition(':')[2]
            if int(words[4]) in pids and inode.isdigit():
                found.add(int(inode))
    return found


def in_use(lock: Path) -> bool:
    """Whether a living process holds ``lock``; a lock that cannot be tried counts as held."""
    try:
        descriptor = os.open(lock, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except FileNotFoundError:
        return False
    except OSError:
        return True
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return True
    finally:
        os.close(descriptor)
    return False
