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

"""Spawning of Python processes that share objects with their parent."""

from __future__ import annotations

from collections.abc import Callable
import multiprocessing
from multiprocessing import forkserver, resource_tracker
from multiprocessing.context import ForkServerContext, SpawnContext
import signal

WORKERS = 'flexarm_ros.analysis.sweep.preload'
ENDING = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP}
"""Signals to a process group, as from a terminal, which the parent alone handles."""


def spawn_context() -> SpawnContext:
    """
    Return a spawn context whose resource tracker is running.

    Fork would break the parent's threads (progress).  The tracker ignores SIGINT and SIGTERM
    and must also survive a closed terminal, so it inherits a blocked SIGHUP.
    """
    _start_blocked(resource_tracker.ensure_running, {signal.SIGHUP})
    return multiprocessing.get_context('spawn')


def worker_context() -> ForkServerContext:
    """
    Return a context whose processes are forks of one that has imported what a worker needs.

    That process has no threads; it leaves the process group with `ENDING` signals blocked, which
    a worker must unblock.
    """
    spawn_context()
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload([WORKERS])
    _start_blocked(forkserver.ensure_running, ENDING)
    return context


def _start_blocked(start: Callable[[], None], signals: set[signal.Signals]) -> None:
    """Start a process that inherits the mask of blocked signals."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        start()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
