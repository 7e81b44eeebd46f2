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

"""Helpers of the tests that start nodes: commands, processes, waiting on conditions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import contextlib
import io
import os
from pathlib import Path
import re
import subprocess
import sys
import threading
import time

from flexarm_ros.bag.checks.digest import digest_of
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.cli import main
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import PARTS, roles
from repository import ROOT

ROLES = roles(RunConfig())
NUMBERED = 'unnumbered' not in os.environ.get('FLEXARM_TEST_MESSAGE_INFO', '')
"""Whether messages have sequence numbers, without which no node is on the fast path."""
EXECUTABLES = {*(part.NAME for part in PARTS), 'node', 'player', 'viewer'}


def flexarm(*words: str | Path, timeout: float = 120.0) -> subprocess.CompletedProcess[str]:
    """Run the command line to its end."""
    return subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', *map(str, words)],
        capture_output=True, text=True, timeout=timeout, cwd=ROOT, check=False,
    )  # fmt: skip


def flexarm_here(*words: str | Path) -> subprocess.CompletedProcess[str]:
    """
    Run the command line in this process, which has everything imported: 1.3 s less of CPU time.

    Not for a test of what a process has to itself: its environment (nodes get its ``sys.path``),
    its streams, its end.
    """
    out, errors, place = io.StringIO(), io.StringIO(), Path.cwd()
    os.chdir(ROOT)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(errors):
            status = main([*map(str, words)])
    finally:
        os.chdir(place)
    return subprocess.CompletedProcess(words, status, out.getvalue(), errors.getvalue())


def check_every_way(case: str, settings: Sequence[str], directory: Path) -> None:
    """See that nodes, composed or not, give the bytes of a simulation, verified and replayed."""
    words = [word for text in settings for word in ('--set', text)]
    for way in (['simulate'], ['run'], ['run', '--compose']):
        out = directory / way[-1]
        done = flexarm_here(*way, case, *words, '--no-pictures', '--out', out)
        assert done.returncode == 0, done.stderr
    digests = {way: digest_of(directory / way) for way in ('simulate', 'run', '--compose')}
    assert len(set(digests.values())) == 1, digests
    verdict = verify(directory / 'run')
    assert verdict.same, verdict.first
    done = flexarm('replay', directory / 'run', '--rate', '4')
    assert done.returncode == 0, done.stderr


def start_node(role: str, parameters: Path, *words: str) -> subprocess.Popen[str]:
    """Start one node by hand, as a user does in a terminal of its own."""
    command = [sys.executable, '-m', 'flexarm_ros.nodes', role, '--ros-args']
    return subprocess.Popen(
        [*command, '--params-file', str(parameters), *words],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip


def finish(processes: Sequence[subprocess.Popen[str]], timeout: float = 90.0) -> list[str]:
    """Wait until all have ended and return what each printed; kill them past the deadline."""
    deadline = time.monotonic() + timeout
    texts = []
    try:
        for process in processes:
            texts.append(process.communicate(timeout=max(0.1, deadline - time.monotonic()))[0])
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()
    return texts


def fast_ticks(text: str) -> tuple[int, int]:
    """Return the ticks on the fast path and all ticks, as a node logs them at its end."""
    (said,) = re.findall(r'(\d+) of (\d+) ticks on the fast path', text)
    return int(said[0]), int(said[1])


def wait_for(condition: Callable[[], bool], timeout: float, what: str) -> None:
    """Poll until ``condition`` holds; fail with ``what`` at the deadline."""
    deadline = time.monotonic() + timeout
    tick = threading.Event()
    while not condition():
        assert time.monotonic() < deadline, f'not within {timeout:g} s: {what}'
        tick.wait(0.02)


def burners(count: int) -> list[subprocess.Popen[bytes]]:
    """Start processes that keep a core busy each, for a minute at the longest."""
    code = 'import time\nend = time.time() + 60\nwhile time.time() < end: pass'
    return [subprocess.Popen([sys.executable, '-c', code], env=os.environ) for _ in range(count)]


def write_scenario(path: Path, name: str, *overrides: str) -> Path:
    """Write a shipped scenario with overrides as a file of its own."""
    from flexarm_ros import scenario

    path.write_text(scenario.dump(scenario.load(name, list(overrides))), encoding='utf-8')
    return path


class Asker:
    """Sets parameters of a run's nodes and steps the plant."""

    def __init__(self, node, executor) -> None:
        self.node, self.executor = node, executor

    def call(self, kind, name: str, **request: object):
        client = self.node.create_client(kind, name)
        assert client.wait_for_service(60), name
        future = client.call_async(kind.Request(**request))
        self.executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done(), name
        return future.result()

    def assign(self, node: str, key: str, value: object):
        from rcl_interfaces.srv import SetParameters
        from rclpy.parameter import Parameter

        wanted = [Parameter(key, value=value).to_parameter_msg()]
        name = f'/{node}/set_parameters'
        return self.call(SetParameters, name, parameters=wanted).results[0]

    def get(self, node: str, key: str) -> float:
        from rcl_interfaces.srv import GetParameters

        answer = self.call(GetParameters, f'/{node}/get_parameters', names=[key])
        return answer.values[0].double_value

    def state(self) -> str:
        from std_srvs.srv import Trigger

        return self.call(Trigger, '/plant/state').message

    def tick(self) -> int:
        return int(self.state().split('tick ')[1].split(',')[0])

    def pause(self, wanted: bool) -> None:
        from std_srvs.srv import SetBool

        assert self.call(SetBool, '/plant/pause', data=wanted).success
        if wanted:
            wait_for(lambda: self.state().startswith('paused'), 60, 'the plant is paused')
