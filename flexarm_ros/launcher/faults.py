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
Faults of a suite's case, applied to a node's process at an exact tick.

The plant holds the run before the tick (its parameter ``hold_at``) until the fault has been
applied, so that every run is hit at the same tick.
"""

from __future__ import annotations

from collections.abc import Sequence
import signal
import time

from flexarm_ros.core.timeline import seconds_to_ns, Timeline
from flexarm_ros.launcher.processes import NodeProcesses
from flexarm_ros.scenario.suites.suite import Fault

_SIGNALS = {
    'kill': signal.SIGKILL,
    'terminate': signal.SIGTERM,
    'pause': signal.SIGSTOP,
    'delay': signal.SIGSTOP,
}


class FaultPlan:
    """The faults of one run, called by the launcher's watch loop."""

    def __init__(self, faults: Sequence[Fault], timeline: Timeline) -> None:
        self._due = sorted(
            ((-(-seconds_to_ns(fault.at) // timeline.period_ns), fault) for fault in faults),
            key=lambda pair: pair[0],
        )
        self._resume: list[tuple[float, str]] = []

    @property
    def ticks(self) -> tuple[int, ...]:
        """Ticks before which the plant has to hold."""
        return tuple(sorted({tick for tick, _ in self._due}))

    def __call__(self, nodes: NodeProcesses) -> None:
        """Apply the faults that are due and end expired delays."""
        now = time.monotonic()
        for when, node in list(self._resume):
            if now >= when:
                self._resume.remove((when, node))
                if node in nodes.running:
                    nodes.running[node].send_signal(signal.SIGCONT)
        held = nodes.report.held_at
        if held is None:
            return
        while self._due and self._due[0][0] <= held:
            self._do(nodes, self._due.pop(0)[1], now)
        nodes.release()

    def _do(self, nodes: NodeProcesses, fault: Fault, now: float) -> None:
        if fault.node not in nodes.running:
            return
        nodes.running[fault.node].send_signal(_SIGNALS[fault.action])
        if fault.action == 'delay':
            self._resume.append((now + fault.seconds, fault.node))
