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

"""The node processes of one run: start, supervision, shutdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
import ctypes
import math
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import time
from types import MappingProxyType

from flexarm_ros.launcher.fork.parent import Adopted, can_fork, NotForked
from flexarm_ros.launcher.fork.parent import start as start_forked
from flexarm_ros.launcher.reports import RunWatch
from flexarm_ros.launcher.shm_cleanup import SharedMemoryCleanup

END_GRACE_S = 3.0
"""Wall time for the nodes to leave by themselves once a run is broken off."""

_NOTE_EVERY_S = 0.5

Process = subprocess.Popen[bytes] | Adopted


class NodeProcesses(RunWatch):
    """
    The processes of a run; a context manager that leaves none running.

    They start in the directory ``logs``, since Python imports from the working directory and
    Fast DDS reads its settings there, and the user's may not be trusted.  Several are forks
    of one process, which loads the compiled functions for the file ``scenario``; if forking
    fails, each is started separately, after a call of ``compile_here``.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        env: dict[str, str],
        logs: Path,
        external: Mapping[str, Sequence[str]] = MappingProxyType({}),
        scenario: str = '',
        compile_here: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(logs, external)
        self._shared_memory = SharedMemoryCleanup()
        self._noted_at = 0.0
        environment = {**env, **self.environment}
        self.running: dict[str, Process] = {}
        self.exits: dict[str, int] = {}
        logs.mkdir(parents=True, exist_ok=True)
        try:
            if can_fork(commands):
                with contextlib.suppress(NotForked):
                    self.running.update(
                        _fork(commands, environment, logs, self.inherited, scenario)
                    )
            if not self.running:
                compile_here()  # once, before all processes do it at the same time
                for name, command in commands.items():
                    with open(logs / f'{name}.log', 'wb') as log:
                        self.running[name] = subprocess.Popen(
                            command, env=environment, cwd=logs, stdin=subprocess.DEVNULL,
                            stdout=log, stderr=subprocess.STDOUT, pass_fds=self.inherited,
                            start_new_session=True,
                        )  # fmt: skip
            for name, command in external.items():
                self.running[name] = _start_external(command, env, logs / f'{name}.log')
        except BaseException:
            self.kill()
            raise
        finally:
            self.close(*self.inherited)

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self.close()

    def poll(self, timeout_s: float) -> None:
        """Read reports for up to ``timeout_s`` and check for processes that have ended."""
        readable, _, _ = select.select([self.incoming], [], [], timeout_s)
        if readable:
            self.take_reports()
        if time.monotonic() - self._noted_at > _NOTE_EVERY_S:
            self._note_memory()
        for name, process in list(self.running.items()):
            status = process.poll()
            if status is None:
                continue
            del self.running[name]
            self.exits[name] = status
            self.ended(name, status)
        self.forgive()

    @property
    def ours(self) -> list[str]:
        """Names of the running nodes that are not external: these end by themselves."""
        return [name for name in self.running if name not in self.external]

    @property
    def busy(self) -> list[str]:
        """Names of own nodes that have not reported the end of the run."""
        report = self.report
        composed_done = report.heard <= report.done
        return [
            name for name in self.ours
            if not (composed_done if name == 'compose' else name in report.done)
        ]  # fmt: skip

    def _note_memory(self) -> None:
        """Record the shared memory of running nodes; it is all created at their start."""
        self._shared_memory.note(process.pid for process in self.running.values())
        self._noted_at = time.monotonic() if self.report.started_at is None else math.inf

    def release(self) -> None:
        """Release a plant that waits at a held tick."""
        self.report.held_at = None
        if 'plant' in self.running:
            self.running['plant'].send_signal(signal.SIGUSR1)

    def interrupt_run(self, times: int = 1) -> None:
        """Ask the plant to end the run in order; without a run or a plant, ask all nodes."""
        self.breaking_off()
        for name in ('plant', 'compose'):
            if name in self.running and self.report.started_at is not None:
                for _ in range(times):
                    self.running[name].send_signal(signal.SIGINT)
                    time.sleep(0.02)  # equal pending signals merge into one
                return
        for process in self.running.values():
            process.send_signal(signal.SIGTERM)

    def end(self, grace_s: float = END_GRACE_S) -> None:
        """
        Wait for the nodes to leave; terminate, then kill, those that do not.

        A stopped one is continued: it then leaves, and removes its shared memory.  It is also
        asked to leave, since it may have missed the end of the run (Fast DDS drops shared
        memory messages to a participant that has not read for a second).
        """
        self.ending = True
        for process in self.running.values():
            stopped = process.poll() is None and _is_stopped(process.pid)
            process.send_signal(signal.SIGCONT)
            if stopped:
                process.send_signal(signal.SIGTERM)
        for number, patience in ((None, grace_s), (signal.SIGTERM, 1.0), (signal.SIGKILL, 1.0)):
            if number is not None:
                for process in self.running.values():
                    process.send_signal(number)
            deadline = time.monotonic() + patience
            while self.running and time.monotonic() < deadline:
                self.poll(0.05)

    def kill(self) -> None:
        """Kill all remaining processes, and remove their shared memory."""
        for process in self.running.values():
            process.kill()
        for name, process in list(self.running.items()):
            self.exits[name] = process.wait()
        self.running.clear()
        self._shared_memory.remove()


def _is_stopped(pid: int) -> bool:
    """Whether an own process is stopped by a signal such as SIGSTOP; see proc(5)."""
    stat = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8', errors='replace')
    return stat.rpartition(')')[2].split()[0] == 'T'


_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1
"""prctl(2): the signal that a process gets when the thread that started it has ended."""


def _end_with_launcher() -> None:
    """Request, in the new process, SIGTERM from the kernel when the launcher dies."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _fork(
    commands: Mapping[str, Sequence[str]],
    env: dict[str, str],
    logs: Path,
    pass_fds: Sequence[int],
    scenario: str,
) -> dict[str, Adopted]:
    """Start own nodes as forks of one process; logs and raises `NotForked`."""
    with contextlib.ExitStack() as stack:
        nothing = stack.enter_context(open(os.devnull, 'rb')).fileno()
        files = {}
        for name in commands:
            log = stack.enter_context(open(logs / f'{name}.log', 'wb')).fileno()
            files[name] = (nothing, log, log)
        try:
            return start_forked(commands, files, env, logs, pass_fds, scenario)
        except NotForked as error:
            (logs / 'start.log').write_text(f'not forked: {error}\n', encoding='utf-8')
            raise


def _start_external(
    command: Sequence[str], env: Mapping[str, str], log_file: Path
) -> subprocess.Popen[bytes]:
    """Start an external node, in the user's directory and with the user's Python path."""
    env = {key: value for key, value in env.items() if key != 'PYTHONPATH'}
    if 'PYTHONPATH' in os.environ:
        env['PYTHONPATH'] = os.environ['PYTHONPATH']
    env['ROS_LOG_DIR'] = env.get('ROS_LOG_DIR') or str(log_file.parent.absolute())
    with open(log_file, 'wb') as log:
        return subprocess.Popen(
            command, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            start_new_session=True, preexec_fn=_end_with_launcher,
        )  # fmt: skip


def node_command(role: str, arguments: list[str], composed: Sequence[str] = ()) -> list[str]:
    """Return the command line of a node process, or of one that is ``composed`` of several."""
    command = [sys.executable, '-m', 'flexarm_ros.nodes', role, *composed]
    return [*command, '--ros-args', *arguments]
