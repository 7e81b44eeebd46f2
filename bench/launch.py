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

"""Starting the processes that are measured, and what they cost."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
from dataclasses import dataclass, field
import json
import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.launcher.domains import reserved_domain
from flexarm_ros.launcher.fork import parent as forked
from flexarm_ros.launcher.shm_cleanup import SharedMemoryCleanup

ROLES = roles(RunConfig())

PLAIN = 'FLEXARM_BENCH_PLAIN'
"""In the environment of `bench.traced`: nothing is to be timed but the whole."""

LIMIT_S = 180.0
"""Wall time after which a measurement is given up."""

_LEAVING_S = 10.0


@dataclass
class Cost:
    """What one run took: wall time and processor time of a tick, first to last, in us."""

    wall_us: float
    cpu_us: float
    parts: dict[str, float] = field(default_factory=dict)
    """Part -> us of processor time a tick, all processes together."""
    roles: dict[str, float] = field(default_factory=dict)
    """Process -> us of processor time a tick."""

    def rtf(self, period_s: float = 0.001) -> float:
        """Return the real-time factor."""
        return period_s * 1e6 / self.wall_us


class MeasurementFailed(Exception):
    """A run that was to be measured did not end well."""


@contextlib.contextmanager
def processes(
    commands: dict[str, list[str]], apart: bool = False, **options: Any
) -> Iterator[tuple[dict[str, Any], dict[str, str]]]:
    """
    Start commands in a domain of their own; none is left when the block ends.

    Several are forks of one process, as `flexarm run` has them, unless they are to start
    ``apart``.  ``env`` in ``options`` is added to their environment.  Yields the processes and
    the environment.
    """
    with reserved_domain() as domain, contextlib.ExitStack() as stack:
        environment = {
            **os.environ,
            'ROS_DOMAIN_ID': str(domain),
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
            **options.pop('env', {}),
        }
        started: dict[str, Any] = {}
        shared_memory = SharedMemoryCleanup()

        def end() -> None:
            left = [process for process in started.values() if process.poll() is None]
            shared_memory.note(process.pid for process in left)
            for process in left:
                process.kill()
                process.wait()
            shared_memory.remove()

        try:
            if len(commands) > 1 and not apart:
                started.update(_forks(commands, environment, stack, **options))
            else:
                for name, command in commands.items():
                    started[name] = stack.enter_context(
                        subprocess.Popen(command, env=environment, text=True, **options)
                    )
            yield started, environment
        finally:
            end()  # before the stack: it waits for each process without a limit


def _forks(
    commands: dict[str, list[str]], env: dict[str, str], stack: contextlib.ExitStack, **how: int
) -> dict[str, Any]:
    """Start ``commands`` as forks of one process, with standard files as Popen has them."""
    theirs: dict[str, tuple[int, ...]] = {}
    ours: dict[str, dict[str, Any]] = {}
    with contextlib.ExitStack() as until_started:

        def keep(descriptor: int) -> int:
            until_started.callback(os.close, descriptor)
            return descriptor

        nothing = keep(os.open(os.devnull, os.O_RDWR))
        errors = keep(os.dup(sys.stderr.fileno()))
        for name in commands:
            files = [nothing, nothing, errors]
            ours[name] = {}
            for number, file in enumerate(('stdin', 'stdout', 'stderr')):
                if how.get(file) == subprocess.PIPE:
                    read, write = os.pipe()
                    mine, files[number] = (read, write) if number else (write, read)
                    keep(files[number])
                    ours[name][file] = stack.enter_context(open(mine, 'r' if number else 'w'))
                elif how.get(file) == subprocess.DEVNULL:
                    files[number] = nothing
            theirs[name] = tuple(files)
        started = forked.start(commands, theirs, env)
    for name, process in started.items():
        vars(process).update(ours[name])
    return started


def floor(ticks: int, mode: str = 'raw') -> Cost:
    """Run the floor; see `bench.floor`."""
    commands = {
        role: [sys.executable, '-m', 'bench.floor', role, str(ticks), mode] for role in ROLES
    }
    with processes(commands, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as (started, _):
        for name, process in started.items():
            if process.stdout.readline() != 'ready\n':
                raise MeasurementFailed(f'floor: {name} did not start')
        for process in reversed(started.values()):  # the plant comes last: it makes the first move
            process.stdin.write('go\n')
            process.stdin.flush()
        lines = {name: process.stdout.readline() for name, process in started.items()}
        for process in started.values():
            with contextlib.suppress(BrokenPipeError):
                process.stdin.close()
        with contextlib.suppress(subprocess.TimeoutExpired):  # it has told what was asked
            for process in started.values():
                process.wait(_LEAVING_S)
    try:
        facts = {name: json.loads(line) for name, line in lines.items()}
    except ValueError:
        raise MeasurementFailed(f'floor ({mode}): a process did not finish') from None
    roles = {name: fact['cpu_s'] / ticks * 1e6 for name, fact in facts.items()}
    return Cost(facts['plant']['wall_s'] / ticks * 1e6, sum(roles.values()), {}, roles)


def nodes(ticks: int, traced: bool = False, compose: bool = False, apart: bool = False) -> Cost:
    """Run the real nodes, recorder included, with their costs told by themselves."""
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        there = Path(folder)
        params = there / 'scenario.yaml'
        params.write_text(_scenario(ticks), encoding='utf-8')
        out = there / 'run'
        names = ['compose'] if compose else list(ROLES)
        commands = {
            name: [
                sys.executable, '-m', 'bench.traced', name, str(there / f'{name}.json'),
                '--ros-args', '--params-file', str(params),
                *(['-p', f'recorder:output:={out}'] if name in ('recorder', 'compose') else []),
            ]
            for name in names
        }  # fmt: skip
        quiet = {'stdout': subprocess.DEVNULL, 'stderr': subprocess.DEVNULL}
        plain = {} if traced else {PLAIN: '1'}
        with processes(commands, apart, env=plain, **quiet) as (started, _):
            deadline = time.monotonic() + LIMIT_S
            for process in started.values():
                process.wait(max(0.0, deadline - time.monotonic()))
        facts = {}
        for name in names:
            told = there / f'{name}.json'
            if not told.exists():
                raise MeasurementFailed(f'{name} did not finish')
            facts[name] = json.loads(told.read_text(encoding='utf-8'))
    lead = facts['plant' if not compose else 'compose']
    roles = {name: fact['cpu_s'] / ticks * 1e6 for name, fact in facts.items()}
    return Cost(lead['wall_s'] / ticks * 1e6, sum(roles.values()), _parts(facts, ticks), roles)


def _parts(facts: dict[str, dict], ticks: int) -> dict[str, float]:
    """Return the parts of all processes, in us of processor time a tick."""
    total: dict[str, float] = {}
    for fact in facts.values():
        for part, seconds in fact['parts'].items():
            total[part] = total.get(part, 0.0) + seconds
        rest = fact['thread_s'] - sum(fact['parts'].values())
        total['Python'] = total.get('Python', 0.0) + rest
        threads = fact['cpu_s'] - fact['thread_s']
        total['DDS threads'] = total.get('DDS threads', 0.0) + threads
    return {part: seconds / ticks * 1e6 for part, seconds in total.items()}


def _scenario(ticks: int) -> str:
    return scenario.dump(scenario.load('fls_tip', [f'duration={ticks / 1000!r}']))
