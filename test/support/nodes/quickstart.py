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
Processes of the tests that start in 20 ms: forks of one that has imported the package.

`QuickPopen` takes the place of ``subprocess.Popen`` in pytest.  ``python -m MODULE ...`` of the
package's own modules, of this interpreter and in an environment that imports the same, is forked
by `starttemplate`; it has a command line, environment, streams, directory and end of its own.
Everything else, and every process of a test that uses the fixture ``fresh_processes``, starts as
it does for a user; so do all where pytest is asked for the tests marked ``essential``.
"""

from __future__ import annotations

from collections.abc import Mapping
import contextlib
import fcntl
from importlib.machinery import PathFinder
import json
import os
from pathlib import Path
import socket
import subprocess
import sys
import threading
from typing import Any

from flexarm_ros.launcher.fork.parent import _subreaper
from flexarm_ros.nodes.runtime.process.supervisor import ALIVE_FD, REPORT_FD

Popen = subprocess.Popen
ENTRY_POINTS = (
    'flexarm_ros.cli', 'flexarm_ros.nodes', 'flexarm_ros.launcher.fork.server',
    'flexarm_ros.ros2_standin', 'faulty_node',
)  # fmt: skip
FAULTY = str(Path(__file__).with_name('faulty_node.py'))
"""A script of the tests that is forked as the module `faulty_node`."""

OWN = {ALIVE_FD, REPORT_FD, 'PYTHONPATH', 'PYTEST_CURRENT_TEST'}
"""Variables that a fork may have of its own, beside ROS's: they are read after the imports."""


class Template:
    """The process that forks, in this environment; started when it is needed first."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._environment = dict(os.environ)
        self._path = [place for place in sys.path if place]
        self._process: subprocess.Popen[bytes] | None = None

    def _start(self) -> None:
        self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            self._process = Popen(
                [sys.executable, '-m', 'starttemplate', str(theirs.fileno())],
                env={**self._environment, 'PYTHONPATH': os.pathsep.join(self._path)},
                pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL,
            )  # fmt: skip

    def fits(self, environment: Mapping[str, str]) -> bool:
        """Whether a process with this environment imports the same, and what is only there."""
        places = {*environment.get('PYTHONPATH', '').split(os.pathsep)} - {'', *self._path}
        return _fixed(environment) == _fixed(self._environment) and all(map(self._adds, places))

    def _adds(self, place: str) -> bool:
        """Whether nothing in the directory would be imported in another's place, or at start."""
        with contextlib.suppress(OSError):
            names = {entry.partition('.')[0] for entry in os.listdir(place)}
            taken = (name for name in names if PathFinder.find_spec(name, self._path))
            return not names & {'sitecustomize', 'usercustomize'} and next(taken, None) is None
        return False

    def fork(self, request: Mapping[str, Any], descriptors: list[int]) -> int:
        """Return the process id of a new child of this process."""
        with self._lock, _subreaper():
            if self._process is None:
                self._start()
            socket.send_fds(self._socket, [json.dumps(request).encode()], descriptors)
            return int(self._socket.recv(20))

    def close(self) -> None:
        """End the template."""
        if self._process is not None:
            self._socket.close()
            self._process.wait(10)


def _fixed(environment: Mapping[str, str]) -> dict[str, str]:
    return {
        name: value for name, value in environment.items()
        if name not in OWN and not name.startswith('ROS_')
    }  # fmt: skip


class QuickPopen(Popen):  # type: ignore[type-arg]
    """A process that is forked where that makes no difference."""

    template: Template

    def _execute_child(
        self, args: Any, executable: Any, preexec_fn: Any, close_fds: Any, pass_fds: Any, cwd: Any,
        env: Any, startupinfo: Any, creationflags: Any, shell: Any, *more: Any,
    ) -> None:  # fmt: skip
        pipes, (gid, gids, uid, umask) = more[:6], more[7:11]
        plain = [executable or args[0], preexec_fn, close_fds, shell, gid, gids, uid, umask]
        words = _by_module(args)
        environment = dict(os.environ if env is None else env)
        files = {n: pipes[i] if pipes[i] != -1 else n for n, i in ((0, 0), (1, 3), (2, 5))}
        if (
            plain != [sys.executable, None, True, False, None, None, None, -1]
            or not _of_ours(words)
            or not self.template.fits(environment)
            or not all(_is_plain_file(held) for held in files.values())
        ):
            return super()._execute_child(
                args, executable, preexec_fn, close_fds, pass_fds, cwd, env, startupinfo,
                creationflags, shell, *more,
            )  # type: ignore[misc]  # fmt: skip
        files.update((number, number) for number in pass_fds)
        request = {
            'command': [os.fsdecode(word) for word in words], 'environment': environment,
            'directory': os.path.abspath(cwd or os.getcwd()), 'files': [*files],
        }  # fmt: skip
        self.pid = self.template.fork(request, [*files.values()])
        self._child_created = True
        self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]
        return None


def _by_module(words: Any) -> Any:
    """Return the same command with ``-m MODULE`` in the place of the tests' own script."""
    if isinstance(words, list) and words[1:2] == [FAULTY]:
        return [words[0], '-m', 'faulty_node', *words[2:]]
    return words


def _of_ours(words: Any) -> bool:
    return (
        isinstance(words, list) and len(words) > 2 and words[1] == '-m'
        and words[2] in ENTRY_POINTS
    )  # fmt: skip


def _is_plain_file(descriptor: int) -> bool:
    """Whether a standard stream there is as it is in the template: open, and no terminal."""
    with contextlib.suppress(OSError):
        return fcntl.fcntl(descriptor, fcntl.F_GETFD) >= 0 and not os.isatty(descriptor)
    return False
