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

"""A node that is killed and started again while the run goes on."""

from __future__ import annotations

import json
from pathlib import Path
import subprocess
import sys

from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.launcher.processes import NodeProcesses
from flexarm_ros.nodes.runtime.process.supervisor import ALIVE_FD, REPORT_FD
from flexarm_ros.scenario.suites.suite import Fault

SPARE = Path(__file__).with_name('respawn.py')


class Spare:
    """A process that is ready to become any node."""

    def __init__(self, log: Path) -> None:
        self._log = log
        with open(log, 'wb') as file:
            self.process = subprocess.Popen(
                [sys.executable, str(SPARE)], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                stderr=file, text=True,
            )  # fmt: skip
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == 'loaded\n'

    def replace(self, victim: int) -> None:
        """Become what the process ``victim`` is, but nobody's child: it has no pipes."""
        process = Path('/proc') / str(victim)
        words = process.joinpath('cmdline').read_bytes().decode().split('\0')[:-1]
        pairs = process.joinpath('environ').read_bytes().decode().split('\0')
        told = dict(pair.partition('=')[::2] for pair in pairs if pair)
        kept = {key: value for key, value in told.items() if key.startswith(('ROS_', 'RMW_'))}
        assert {REPORT_FD, ALIVE_FD} <= set(told)
        start = words.index('flexarm_ros.nodes') + 1
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({'words': words[start:], 'environment': kept}) + '\n')
        self.process.stdin.flush()

    def end(self, timeout: float) -> str:
        """Return what it said, when it has ended by itself."""
        try:
            self.process.wait(timeout)
        finally:
            self.process.kill()
            self.process.communicate()
        return self._log.read_text()


class RestartPlan(FaultPlan):
    """Kills a node as any plan, and lets the spare take its place at once."""

    spare: Spare

    def _do(self, nodes: NodeProcesses, fault: Fault, now: float) -> None:
        assert fault.node in nodes.running
        victim = nodes.running[fault.node]
        self.spare.replace(victim.pid)
        super()._do(nodes, fault, now)
