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

"""Processes that the tests have started and that still run, found by a mark that is inherited."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import signal
import threading
import time
import uuid

MARK = 'FLEXARM_TEST_SESSION'
SESSION = uuid.uuid4().hex
_STAYING = ('multiprocessing.resource_tracker', 'multiprocessing.forkserver', 'starttemplate')
"""Once started, they stay as long as pytest does."""


def expect_no_leftovers() -> None:
    """End the processes that the tests have started and that still run; fail if there are any."""
    deadline = time.monotonic() + 10.0
    left = leftovers()
    # Chromium's crash handler notices only after a moment that its browser has gone.
    while any('crashpad' in line for line in left.values()) and time.monotonic() < deadline:
        threading.Event().wait(0.05)
        left = leftovers()
    for pid in left:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    assert not left, 'left running: ' + '; '.join(f'{pid} {line}' for pid, line in left.items())


def leftovers() -> dict[int, str]:
    """
    Return ``{pid: command line}`` of the living processes that carry this session's mark.

    The mark is inherited, so that orphans are found too; pytest itself has it in `os.environ`
    only, which does not show in ``/proc``.
    """
    wanted = f'{MARK}={SESSION}'.encode()
    found = {}
    for process in Path('/proc').glob('[0-9]*'):
        try:
            if wanted not in (process / 'environ').read_bytes().split(b'\0'):
                continue
            state = (process / 'stat').read_text().rpartition(')')[2].split()[0]
            line = (process / 'cmdline').read_bytes().replace(b'\0', b' ').decode(errors='replace')
        except OSError:
            continue  # it has ended, or is somebody else's
        if any(name in line for name in _STAYING):
            continue
        if state not in 'ZX' and int(process.name) != os.getpid():
            found[int(process.name)] = line.strip()
    return found
