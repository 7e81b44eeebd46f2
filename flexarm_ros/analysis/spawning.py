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

import multiprocessing
from multiprocessing import resource_tracker
from multiprocessing.context import SpawnContext
import signal


def spawn_context() -> SpawnContext:
    """
    Return a spawn context whose resource tracker is running.

    Fork would break the parent's threads (progress).  The tracker ignores SIGINT and SIGTERM
    and must also survive a closed terminal, so it inherits a blocked SIGHUP.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGHUP})
    try:
        resource_tracker.ensure_running()
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
    return multiprocessing.get_context('spawn')
