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
Requests for steady timing: priority, CPU, locked memory; garbage collector, turns of threads.

Each request is made if it is allowed, and reported in any case; a run needs none of them.
Scheduling applies to one thread: `ask` leaves the other threads of the process, such as the
middleware's, unchanged, and `ask_all_threads` does not.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
import ctypes
import gc
import os
import resource
import sys

SYSTEM_KEYS = ('realtime_priority', 'realtime_cpu', 'lock_memory')
"""Parameters of the plant that `ask` takes, in the order of its arguments."""

_SWITCH_S = 1e-5
"""Time for which another Python thread keeps this one waiting, s; by default 5 ms."""

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_CAP_SYS_NICE, _CAP_IPC_LOCK = 23, 14


def ask(priority: int, cpu: int, lock: bool) -> list[str]:
    """
    Make the requests for this thread and process; return a line for each.

    ``priority``: of SCHED_FIFO, 0: none.  ``cpu``: number of the CPU to run on, -1: any.
    ``lock``: keep the memory from being paged out.
    """
    said = []
    if priority:
        said.append(_ask_priority(priority))
    if cpu >= 0:
        said.append(_ask_cpu(cpu))
    if lock:
        said.append(_ask_memory())
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    gc.disable()
    said.append('garbage collector off')
    return said


def ask_all_threads(priority: int) -> str:
    """
    Request SCHED_FIFO for every thread of this process; return what was granted.

    Without the middleware's threads a message still waits for other processes, and a thread of
    higher priority for one of these, which holds its lock and gets no CPU.
    """
    return _ask_priority(priority, map(int, os.listdir('/proc/self/task')), ', all threads')


@contextmanager
def prioritised(priority: int) -> Iterator[None]:
    """Run the body with SCHED_FIFO; OSError where that is not allowed."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def can_prioritise(priority: int) -> bool:
    """Whether this thread may have SCHED_FIFO; it is tried, and undone."""
    try:
        with prioritised(priority):
            return True
    except OSError:
        return False


def can_lock() -> bool:
    """Whether this process may lock all of its memory."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    return limit == resource.RLIM_INFINITY or has_capability(_CAP_IPC_LOCK)


def _ask_priority(priority: int, threads: Iterable[int] = (0,), whose: str = '') -> str:
    """Request it for threads (0: this one); ``whose`` names them in the returned line."""
    wanted = f'SCHED_FIFO {priority}'
    for thread in threads:
        try:
            os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(priority))
        except ProcessLookupError:
            continue  # it has ended meanwhile
        except OSError as error:
            return f'{wanted} not allowed ({error.strerror}; {priority_limit()})'
    return f'{wanted}{whose}'


def _ask_cpu(cpu: int) -> str:
    try:
        os.sched_setaffinity(0, {cpu})
    except OSError as error:
        allowed = ', '.join(map(str, sorted(os.sched_getaffinity(0))))
        return f'CPU {cpu} not allowed ({error.strerror}; allowed: {allowed})'
    return f'CPU {cpu}'


def _ask_memory() -> str:
    """Lock all memory or none: a partial lock would make later allocations fail."""
    if not can_lock():
        return f'memory not locked ({memory_limit()})'
    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        return f'memory not locked ({os.strerror(ctypes.get_errno())}; {memory_limit()})'
    return 'memory locked'


def priority_limit() -> str:
    """Return the limits of this process's scheduling requests as text."""
    limit = resource.getrlimit(resource.RLIMIT_RTPRIO)[0]
    shown = 'unlimited' if limit == resource.RLIM_INFINITY else str(limit)
    return f'RLIMIT_RTPRIO {shown}, CAP_SYS_NICE {_yes(has_capability(_CAP_SYS_NICE))}'


def memory_limit() -> str:
    """Return the limits of this process's locked memory as text."""
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    shown = 'unlimited' if limit == resource.RLIM_INFINITY else f'{limit // 1024} KiB'
    return f'RLIMIT_MEMLOCK {shown}, CAP_IPC_LOCK {_yes(has_capability(_CAP_IPC_LOCK))}'


def has_capability(number: int) -> bool:
    """Whether this process has a Linux capability (effective); see capabilities(7)."""
    try:
        with open('/proc/self/status', encoding='ascii', errors='replace') as status:
            sets = dict(line.split(':', 1) for line in status if ':' in line)
        return bool(int(sets['CapEff'], 16) >> number & 1)
    except (OSError, KeyError, ValueError):
        return False


def _yes(held: bool) -> str:
    return 'yes' if held else 'no'
