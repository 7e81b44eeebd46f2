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

"""The node processes of one run: start, watch, end, and who was to blame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import contextlib
import ctypes
from dataclasses import dataclass, field
import json
import math
import os
from pathlib import Path
import select
import signal
import subprocess
import sys
import time
from types import MappingProxyType
from typing import Any

from flexarm_ros.launcher.forked import Adopted, can_fork, NotForked
from flexarm_ros.launcher.forked import start as start_forked
from flexarm_ros.launcher.litter import Litter
from flexarm_ros.nodes.supervisor import ALIVE_FD, INTERRUPTED, REPORT_FD

END_GRACE_S = 3.0
"""Wall time that the nodes have to leave by themselves once a run is broken off."""

_NOTE_EVERY_S = 0.5

Process = subprocess.Popen[bytes] | Adopted


@dataclass
class Report:
    """What the nodes have told so far."""

    tick: int = 0
    held: int = 0
    """Tick before which the plant was last told to hold."""
    directory: str = ''
    started_at: float | None = None
    ended_at: float | None = None
    held_at: int | None = None
    unstable: str = ''
    unstable_tick: int = -1
    failures: list[dict[str, Any]] = field(default_factory=list)
    heard: set[str] = field(default_factory=set)
    """Roles that have told anything."""
    done: set[str] = field(default_factory=set)

    def take(self, line: dict[str, Any]) -> None:
        """Add one line of a node."""
        phase, role = line.get('phase'), line.get('role', '')
        self.heard.add(role)
        if role == 'recorder' and 'tick' in line:
            self.tick, self.ended_at = int(line['tick']), float(line['at'])
        if role == 'plant' and phase == 'running':
            self.started_at = float(line['at'])
        if phase == 'held':
            self.held_at = self.held = int(line['tick'])
        if phase == 'unstable':
            self.unstable, self.unstable_tick = line['text'], int(line['tick'])
        if phase == 'failed':
            self.failures.append(line)
        if phase == 'done':
            self.done.add(role)


class NodeProcesses:
    """
    The processes of a run; a context manager that leaves none behind.

    They start in the directory ``logs``: Python imports from the one it is started in, and Fast
    DDS reads its settings there; the user's may be a stranger's.  Several are forks of one
    process, which loads what is compiled for the file ``scenario``; where that cannot be done
    each is started by itself, after a call of ``compile_here``.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        env: dict[str, str],
        logs: Path,
        foreign: Mapping[str, Sequence[str]] = MappingProxyType({}),
        scenario: str = '',
        compile_here: Callable[[], None] = lambda: None,
    ) -> None:
        self.report = Report()
        self.foreign = frozenset(foreign)
        self._logs = logs
        self._litter = Litter()
        self._noted_at = 0.0
        self._buffer = b''
        self._read, write = os.pipe()
        alive_read, self._alive = os.pipe()
        os.set_blocking(self._read, False)
        os.set_blocking(write, False)  # a launcher that is stopped must not stop the nodes
        environment = {**env, REPORT_FD: str(write), ALIVE_FD: str(alive_read)}
        self.running: dict[str, Process] = {}
        self.exits: dict[str, int] = {}
        self.deaths: list[tuple[str, int]] = []
        self._ending = False
        self._heard = 0
        """Verdicts before the run was broken off; who is told to leave may complain too."""
        logs.mkdir(parents=True, exist_ok=True)
        try:
            if can_fork(commands):
                with contextlib.suppress(NotForked):
                    self.running.update(
                        _fork(commands, environment, logs, (write, alive_read), scenario)
                    )
            if not self.running:
                compile_here()  # once, not in every process at once
                for name, command in commands.items():
                    with open(logs / f'{name}.log', 'wb') as log:
                        self.running[name] = subprocess.Popen(
                            command, env=environment, cwd=logs, stdin=subprocess.DEVNULL,
                            stdout=log, stderr=subprocess.STDOUT, pass_fds=(write, alive_read),
                            start_new_session=True,
                        )  # fmt: skip
            for name, command in foreign.items():
                self.running[name] = _start_foreign(command, env, logs / f'{name}.log')
        except BaseException:
            self.kill()
            raise
        finally:
            os.close(write)
            os.close(alive_read)

    def __enter__(self) -> NodeProcesses:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        for descriptor in (self._read, self._alive):
            os.close(descriptor)

    def poll(self, timeout_s: float) -> None:
        """Take reports for up to ``timeout_s`` and notice who has ended."""
        readable, _, _ = select.select([self._read], [], [], timeout_s)
        if readable:
            self._take_reports()
        if time.monotonic() - self._noted_at > _NOTE_EVERY_S:
            self._note_memory()
        for name, process in list(self.running.items()):
            status = process.poll()
            if status is None:
                continue
            del self.running[name]
            self._take_reports()
            self.exits[name] = status
            told = {line['role'] for line in self.report.failures} | self.report.done
            expected = bool(told) if name == 'compose' else self._ending or name in told
            if not expected:
                self.deaths.append((name, status))
        if 'plant' in self.report.done and not self._ending:
            # Somebody else's nodes may leave behind the last tick.
            self.deaths = [death for death in self.deaths if death[0] not in self.foreign]

    @property
    def ours(self) -> list[str]:
        """Names of the running nodes that are not somebody else's: those end by themselves."""
        return [name for name in self.running if name not in self.foreign]

    @property
    def busy(self) -> list[str]:
        """Names of ours that have not said that they are done with the run."""
        report = self.report
        composed_done = report.heard <= report.done
        return [
            name for name in self.ours
            if not (composed_done if name == 'compose' else name in report.done)
        ]  # fmt: skip

    def _take_reports(self) -> None:
        while True:
            try:
                data = os.read(self._read, 65536)
            except BlockingIOError:
                break
            if not data:
                time.sleep(0.01)  # every writer has gone: select would return at once
                break
            self._buffer += data
        *lines, self._buffer = self._buffer.split(b'\n')
        for line in lines:
            with contextlib.suppress(ValueError, KeyError, TypeError):
                self.report.take(json.loads(line))

    def _note_memory(self) -> None:
        """Note the shared memory of the nodes while they live; it is all made by their start."""
        self._litter.note(process.pid for process in self.running.values())
        self._noted_at = time.monotonic() if self.report.started_at is None else math.inf

    def release(self) -> None:
        """Let a plant that waits at a held tick go on."""
        self.report.held_at = None
        if 'plant' in self.running:
            self.running['plant'].send_signal(signal.SIGUSR1)

    def interrupt_run(self, times: int = 1) -> None:
        """Ask the plant to end the run in good order; without a run or a plant, everybody."""
        self._ending = True
        self._heard = self._heard or len(self.report.failures)
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
        Wait for the nodes to leave; those that do not are told to, then killed.

        One that was stopped is woken: it then leaves, and removes its shared memory.  It may
        not have heard that the run is over (Fast DDS drops what goes through shared memory to
        somebody who has not read for a second), so it is told.
        """
        self._ending = True
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
        """End whatever still runs, at once, and remove the shared memory of those killed."""
        for process in self.running.values():
            process.kill()
        for name, process in list(self.running.items()):
            self.exits[name] = process.wait()
        self.running.clear()
        self._litter.remove()

    def blame(self, interrupted: bool = False) -> str:
        """
        Return one line naming who ended the run, the tick and why; empty if nobody.

        Where the user ``interrupted`` it, the nodes say so too: that is no fault of theirs.
        """
        if self.deaths:
            return self._obituary(*self.deaths[0])
        heard = self.report.failures[: self._heard or None]
        if interrupted:
            heard = [line for line in heard if not line['text'].startswith(INTERRUPTED)]
        verdicts = [line for line in heard if line.get('blame')]
        if verdicts:
            # Who blames another is not silent itself.
            speaking = {line['role'] for line in verdicts if line['blame'] != line['role']}
            silent = [line for line in verdicts if line['blame'] not in speaking]
            first = min(silent or verdicts, key=_nearness)
            return f'{first["blame"]}: {first["text"]}'
        if heard:
            return f'{heard[0]["role"]}: {heard[0]["text"]}'
        return INTERRUPTED if interrupted else ''

    def _obituary(self, name: str, status: int) -> str:
        """Say when and how a node ended that should not have."""
        begun = self.report.started_at is not None
        tick = max(self.report.tick, self.report.held)  # the recorder reports late
        when = f'tick {tick}: ended' if begun else 'start: ended'
        if status < 0:
            return f'{name}: {when}, killed by {signal.Signals(-status).name}'
        return f'{name}: {when} with exit status {status}{self._last_words(name)}'

    def _last_words(self, name: str) -> str:
        """Return the last line of a node's log, where there is one."""
        try:
            with open(self._logs / f'{name}.log', 'rb') as log:
                log.seek(max(0, os.fstat(log.fileno()).st_size - 2000))
                lines = log.read().decode(errors='replace').split('\n')
        except OSError:
            return ''
        said = [line.strip() for line in lines if line.strip()]
        return f': {said[-1][:300]}' if said else ''


def _is_stopped(pid: int) -> bool:
    """Whether a process of ours stands still by a signal, as with SIGSTOP; see proc(5)."""
    stat = Path(f'/proc/{pid}/stat').read_text(encoding='utf-8', errors='replace')
    return stat.rpartition(')')[2].split()[0] == 'T'


def _nearness(line: dict[str, Any]) -> int:
    """Order verdicts: the controller knows its sensors, the plant the controller."""
    order = ('controller', 'plant', 'recorder', 'trajectory', 'encoder', 'tip_sensor')
    return order.index(line['role']) if line['role'] in order else len(order)


_LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1
"""prctl(2): the signal that a process gets when the thread that started it has ended."""


def _end_with_launcher() -> None:
    """Ask the kernel, in the new process, for SIGTERM when the launcher is no more."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _fork(
    commands: Mapping[str, Sequence[str]],
    env: dict[str, str],
    logs: Path,
    pass_fds: Sequence[int],
    scenario: str,
) -> dict[str, Adopted]:
    """Start our nodes as forks of one process; raises `NotForked`, and says so in a log."""
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


def _start_foreign(
    command: Sequence[str], env: Mapping[str, str], log_file: Path
) -> subprocess.Popen[bytes]:
    """Start somebody else's node: where and with what Python path the user stands."""
    env = {key: value for key, value in env.items() if key != 'PYTHONPATH'}
    if 'PYTHONPATH' in os.environ:
        env['PYTHONPATH'] = os.environ['PYTHONPATH']
    with open(log_file, 'wb') as log:
        return subprocess.Popen(
            command, env=env, stdin=subprocess.DEVNULL, stdout=log, stderr=subprocess.STDOUT,
            start_new_session=True, preexec_fn=_end_with_launcher,
        )  # fmt: skip


def node_command(role: str, arguments: list[str], composed: Sequence[str] = ()) -> list[str]:
    """Return the command line of a node process, or of one that is ``composed`` of several."""
    command = [sys.executable, '-m', 'flexarm_ros.nodes', role, *composed]
    return [*command, '--ros-args', *arguments]
