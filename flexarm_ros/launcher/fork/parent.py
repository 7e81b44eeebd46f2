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

"""Node processes as forks of one that has imported everything; see `launcher.fork.server`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import contextlib
import ctypes
import json
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import threading

from flexarm_ros import code_cache
from flexarm_ros.nodes.classes import MODULES

FORK_SERVER = 'flexarm_ros.launcher.fork.server'
_LIMIT_S = 300.0
"""Wall time for imports, and for compiling if the cache is empty."""

_LIBC = ctypes.CDLL(None)
_PR_SET_CHILD_SUBREAPER, _PR_GET_CHILD_SUBREAPER = 36, 37
_adopting = threading.Lock()


class NotForked(Exception):
    """Forking is not possible; the text gives the reason."""


class Adopted:
    """A child of this process forked by another one, with the methods of Popen in use."""

    def __init__(self, pid: int) -> None:
        self.pid = pid
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return the exit status, -N after signal N, None while it runs."""
        return self._wait(os.WNOHANG)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end; raises subprocess.TimeoutExpired after ``timeout`` seconds."""
        if timeout is not None and self.poll() is None:
            ended = os.pidfd_open(self.pid)  # polling would disturb the nodes
            try:
                select.select([ended], [], [], timeout)
            finally:
                os.close(ended)
            if self.poll() is None:
                raise subprocess.TimeoutExpired(f'process {self.pid}', timeout)
        status = self._wait(0)
        assert status is not None
        return status

    def _wait(self, options: int) -> int | None:
        if self.returncode is None:
            try:
                pid, status = os.waitpid(self.pid, options)
            except ChildProcessError:  # reaped elsewhere; same as in Popen
                pid, status = self.pid, 0
            if pid:
                self.returncode = os.waitstatus_to_exitcode(status)
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send a signal if the process is still running."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Kill the process."""
        self.send_signal(signal.SIGKILL)


def can_fork(commands: Mapping[str, Sequence[str]]) -> bool:
    """Whether there are several commands, all ``python -m MODULE ...`` of this interpreter."""
    alike = all(list(words[:2]) == [sys.executable, '-m'] for words in commands.values())
    return len(commands) > 1 and alike and not _traced()


def _traced() -> bool:
    """
    Whether LTTng's session daemon is running, as ``ros2 trace`` starts it.

    Its library, which rclpy links, cannot follow processes that fork.
    """
    homes = [os.environ[name] for name in ('LTTNG_HOME', 'HOME') if name in os.environ]
    folders = [Path('/var/run/lttng'), *(Path(home) / '.lttng' for home in homes)]
    return any(next(folder.glob('lttng-ust-sock-*'), None) for folder in folders)


def start(
    commands: Mapping[str, Sequence[str]],
    files: Mapping[str, tuple[int, int, int]],
    env: Mapping[str, str],
    cwd: Path | None = None,
    pass_fds: Sequence[int] = (),
    scenario: str = '',
    modules: Sequence[str] = MODULES,
) -> dict[str, Adopted]:
    """
    Start ``commands``, each in its own session, as forks of one process.

    ``files`` gives the descriptors of each one's standard input, output and error;
    ``modules`` are imported once before forking, and the compiled functions for the file
    ``scenario`` are loaded (or compiled).  Raises `NotForked` if that is not possible, before
    anything is started.
    """
    children = [
        {'name': name, 'command': list(command), 'files': files[name]}
        for name, command in commands.items()
    ]
    request = json.dumps({'modules': list(modules), 'scenario': scenario, 'children': children})
    passed = {*pass_fds, *(descriptor for three in files.values() for descriptor in three)}
    with _adopting, _subreaper(), subprocess.Popen(
        [sys.executable, '-m', FORK_SERVER], env=dict(env), cwd=cwd, text=True,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        pass_fds=sorted(passed), start_new_session=True,
    ) as server:  # fmt: skip
        try:
            told, trouble = server.communicate(request, timeout=_LIMIT_S)
        except BaseException as error:
            server.kill()
            if isinstance(error, subprocess.TimeoutExpired):
                raise NotForked(f'not within {_LIMIT_S:g} s') from None
            raise
    if server.returncode != 0:
        raise NotForked(trouble.strip() or f'exit status {server.returncode}')
    for line in trouble.splitlines():
        if line.startswith(code_cache.COMPLAINT):
            code_cache.tell(line)
    pids = json.loads(told.splitlines()[-1])  # what is imported may print
    return {name: Adopted(pid) for name, pid in pids.items()}


@contextlib.contextmanager
def _subreaper() -> Iterator[None]:
    """Make this process the parent of the processes that its children leave behind."""
    before = ctypes.c_int(0)
    _LIBC.prctl(_PR_GET_CHILD_SUBREAPER, ctypes.byref(before))
    _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, ctypes.c_ulong(1))
    try:
        yield
    finally:
        _LIBC.prctl(_PR_SET_CHILD_SUBREAPER, ctypes.c_ulong(before.value))
