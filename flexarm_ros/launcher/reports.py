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

"""Reports of the nodes to the launcher, exits of the nodes, and the diagnosis of a failure."""

from __future__ import annotations

from collections.abc import Collection, Iterable
import contextlib
from dataclasses import dataclass, field
import errno
import json
import os
from pathlib import Path
import signal
import time
from typing import Any

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import Answer
from flexarm_ros.core.run.parts import known_parts, signals
from flexarm_ros.nodes.runtime.process.supervisor import ALIVE_FD, INTERRUPTED, REPORT_FD

_CRASHES = {signal.SIGSEGV, signal.SIGABRT, signal.SIGBUS, signal.SIGFPE, signal.SIGILL}
"""Signals that a process causes itself, possibly after printing the reason."""


@dataclass
class Report:
    """The content of all reports so far."""

    tick: int = 0
    held: int = 0
    """Tick before which the plant was last asked to hold."""
    directory: str = ''
    started_at: float | None = None
    ended_at: float | None = None
    held_at: int | None = None
    unstable: str = ''
    unstable_tick: int = -1
    failures: list[dict[str, Any]] = field(default_factory=list)
    heard: set[str] = field(default_factory=set)
    """Roles that have sent a report."""
    done: set[str] = field(default_factory=set)
    timing: str = ''
    """Timing of a free-running run so far, for the progress line."""
    remarks: list[str] = field(default_factory=list)
    """Remarks for the user, oldest first."""
    common: set[str] = field(default_factory=set)
    """Remarks that several nodes make; only the first of equal ones is passed on."""

    def take(self, line: dict[str, Any]) -> None:
        """Process one line of a node."""
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
        self.timing = line.get('timing', self.timing)
        if 'remark' in line:
            self.remarks.append(line['remark'])
        if 'common' in line and line['common'] not in self.common:
            self.common.add(line['common'])
            self.remarks.append(line['common'])


class RunWatch:
    """
    The launcher's ends of the pipes to the nodes of one run, and the nodes' reports.

    The environment of a node names its ends: as inherited descriptors (``environment``,
    ``inherited``), or as paths (``environment_by_path``) if the launcher passes none on.
    ``logs`` has the output of each node as NAME.log; ``external`` names the external nodes.
    """

    def __init__(self, logs: Path, external: Iterable[str] = ()) -> None:
        self.report = Report()
        self.external = frozenset(external)
        self.deaths: list[tuple[str, int]] = []
        self.dispensable: frozenset[str] = frozenset()
        """Nodes whose end does not end the run."""
        self._verdict = ''
        self._logs = logs
        self.ending = False
        self._heard = 0
        """Number of failure reports before the shutdown; later ones may be caused by it."""
        self._buffer = b''
        self.incoming, self._write = os.pipe()
        self._alive_read, self._alive = os.pipe()
        self._open = {self.incoming, self._write, self._alive_read, self._alive}
        os.set_blocking(self.incoming, False)
        os.set_blocking(self._write, False)  # a stopped launcher must not block the nodes

    @property
    def inherited(self) -> tuple[int, int]:
        """Descriptors that a node process inherits."""
        return self._write, self._alive_read

    @property
    def environment(self) -> dict[str, str]:
        """Environment variables for a process that inherits the descriptors."""
        return {REPORT_FD: str(self._write), ALIVE_FD: str(self._alive_read)}

    @property
    def environment_by_path(self) -> dict[str, str]:
        """Environment variables for a process that does not; valid until `close`, on Linux."""
        folder = f'/proc/{os.getpid()}/fd'
        return {name: f'{folder}/{number}' for name, number in self.environment.items()}

    def close(self, *descriptors: int) -> None:
        """Close these ends of the pipes, or all: the nodes then take the launcher as gone."""
        for descriptor in descriptors or tuple(self._open):
            self._open.remove(descriptor)
            os.close(descriptor)

    def take_reports(self) -> None:
        """Read the pending reports of the nodes."""
        while True:
            try:
                data = os.read(self.incoming, 65536)
            except BlockingIOError:
                break
            if not data:
                time.sleep(0.01)  # no writer is left: select would return at once
                break
            self._buffer += data
        *lines, self._buffer = self._buffer.split(b'\n')
        for line in lines:
            with contextlib.suppress(ValueError, KeyError, TypeError):
                self._take(json.loads(line))

    def _take(self, line: dict[str, Any]) -> None:
        if line.get('phase') == 'failed' and line.get('role') in self._dispensable:
            self.report.remarks.append(f'{line["role"]}: {line["text"]}; the run goes on')
            self.report.done.add(line['role'])
        else:
            self.report.take(line)

    @property
    def _dispensable(self) -> frozenset[str]:
        """Nodes whose end does not end the run, which has begun."""
        return frozenset() if self.report.started_at is None else self.dispensable

    def ended(self, name: str, status: int) -> None:
        """Record the end of a process, with the exit status as in `subprocess`."""
        self.take_reports()
        told = {line['role'] for line in self.report.failures} | self.report.done
        expected = bool(told) if name == 'compose' else self.ending or name in told
        if expected:
            return
        if name in self._dispensable:
            self.report.remarks.append(f'{self._obituary(name, status)}; the run goes on')
        else:
            self.deaths.append((name, status))

    def forgive(self) -> None:
        """Forget exits of external nodes after the last tick: they need not wait for the end."""
        if 'plant' in self.report.done and not self.ending:
            self.deaths = [death for death in self.deaths if death[0] not in self.external]

    @property
    def failing(self) -> bool:
        """Whether a node has died or reported a failed run."""
        return bool(self.deaths or self.report.failures)

    def never_met(self, external: Collection[str]) -> bool:
        """Whether the run did not begin because own nodes did not discover one another."""
        if self.report.started_at is not None or self.deaths:
            return False
        told = [line for line in self.report.failures if line.get('never_met')]
        return bool(told) and all(line['blame'] not in external for line in told)

    def breaking_off(self) -> None:
        """Record that the run is being broken off: later failures are a consequence."""
        self.ending = True
        self._heard = self._heard or len(self.report.failures)

    def settle(self) -> str:
        """Return the text of `blame`, which no longer changes: it is shown to the user now."""
        self._verdict = self.blame()
        return self._verdict

    def blame(self, interrupted: bool = False) -> str:
        """
        Return one line that says why the run ended: the node, the tick and the reason.

        An unstable run has its own line; empty where neither is the case.  The nodes of a run
        that the user ``interrupted`` report that too; it is not a failure.
        """
        if self._verdict:
            return self._verdict
        if self.report.unstable:
            return f'unstable at tick {self.report.unstable_tick}: {self.report.unstable}'
        if self.deaths:
            return self._obituary(*self.deaths[0])
        heard = self.report.failures[: self._heard or None]
        if interrupted:
            heard = [line for line in heard if not line['text'].startswith(INTERRUPTED)]
        verdicts = [line for line in heard if line.get('blame')]
        if verdicts:
            # A node that reports another one is not silent itself.
            speaking = {line['role'] for line in verdicts if line['blame'] != line['role']}
            silent = [line for line in verdicts if line['blame'] not in speaking]
            first = min(silent or verdicts, key=_nearness)
            return f'{first["blame"]}: {first["text"]}'
        if heard:
            return f'{heard[0]["role"]}: {heard[0]["text"]}'
        return INTERRUPTED if interrupted else ''

    def _obituary(self, name: str, status: int) -> str:
        """Return when and how a node ended unexpectedly."""
        begun = self.report.started_at is not None
        tick = max(self.report.tick, self.report.held)  # the recorder lags
        when = f'tick {tick}: ended' if begun else 'start: ended'
        if status < 0:
            number = signal.Signals(-status)
            words = self._last_words(name) if number in _CRASHES else ''
            return f'{name}: {when}, killed by {number.name}{words}'
        return f'{name}: {when} with exit status {status}{self._last_words(name)}'

    def _last_words(self, name: str) -> str:
        """Return the last line of a node's log, or that a full disk has taken none."""
        path = self._logs / f'{name}.log'
        try:
            full = os.statvfs(path).f_bavail == 0
            with open(path, 'rb') as log:
                log.seek(max(0, os.fstat(log.fileno()).st_size - 2000))
                lines = log.read().decode(errors='replace').split('\n')
        except OSError:
            return ''
        said = [line.strip() for line in lines if line.strip()]
        if not said and full:
            return f': its output is lost: {path}: {os.strerror(errno.ENOSPC)}'
        return f': {said[-1][:300]}' if said else ''


def _nearness(line: dict[str, Any]) -> int:
    """Return a sort key of verdicts: a node with more inputs makes the better diagnosis."""
    answers = {signal.name for part, signal in signals(RunConfig()) if issubclass(part, Answer)}
    known = {p.NAME: len(answers & {*p.READS}) + p.FOR_THE_RECORD for p in known_parts()}
    return -known.get(line['role'], -1)
