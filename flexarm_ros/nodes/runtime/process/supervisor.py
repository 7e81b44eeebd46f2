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
Pipes to the launcher: one for reports, one whose end means that the launcher is gone.

Two environment variables name the pipe ends of a node.  The node writes one JSON object per line
to the first; the second is never written to and reads as finished once the launcher has ended in
any way.  They are inherited descriptors under `flexarm run`, and paths under `ros2 launch`, which
does not pass descriptors on.  A node started by hand has neither and sends no reports.
"""

from __future__ import annotations

import json
import os
import select
import time
from typing import Any

REPORT_FD = 'FLEXARM_REPORT_FD'
ALIVE_FD = 'FLEXARM_ALIVE_FD'
INTERRUPTED, LAUNCHER_GONE = 'interrupted', 'launcher gone'
_PATIENCE_S = 1.0


def interrupted(reason: str) -> bool:
    """Whether ``reason`` is that of a node that was asked to leave."""
    return reason.startswith((INTERRUPTED, LAUNCHER_GONE))


class Supervisor:
    """A node's end of the pipes to the launcher."""

    def __init__(self) -> None:
        self._report = _descriptor(REPORT_FD, os.O_WRONLY)
        self._alive = _descriptor(ALIVE_FD, os.O_RDONLY)

    @property
    def present(self) -> bool:
        """Whether a launcher started this process."""
        return self._alive is not None

    @property
    def gone(self) -> bool:
        """Whether there was a launcher and it has ended."""
        if self._alive is None:
            return False
        readable, _, _ = select.select([self._alive], [], [], 0)
        return bool(readable)

    def report(self, role: str, **facts: Any) -> None:
        """
        Send one line; nothing happens if the launcher is gone.

        The pipe is full while the launcher is stopped (Ctrl-Z): a line without a phase is then
        dropped, one with a phase waits for up to a second.
        """
        line = json.dumps({'role': role, 'at': time.monotonic(), **facts}) + '\n'
        deadline = time.monotonic() + (_PATIENCE_S if 'phase' in facts else 0.0)
        while self._report is not None:
            try:
                os.write(self._report, line.encode())
                return
            except BlockingIOError:
                if time.monotonic() >= deadline:
                    return
                select.select([], [self._report], [], 0.1)
            except OSError:
                self._report = None


def _descriptor(name: str, mode: int) -> int | None:
    """Return the descriptor named by the variable ``name``, None if there is none."""
    text = os.environ.get(name, '')
    try:
        if not text.isdigit():
            return os.open(text, mode | os.O_NONBLOCK)
        os.fstat(int(text))
    except OSError:
        return None
    return int(text)
