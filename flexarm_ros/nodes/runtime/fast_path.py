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
The fast path of a node: ticks in compiled code, from the middleware's queues and back.

It serves a node that has a process of its own, a step (`flexarm_ros.wire.fused_step`) and inputs
whose messages have sequence numbers (`Input.plain`), where the addresses of rcl are known
(`flexarm_ros.nodes.runtime.topics.rcl_ports`).  Any other message is given back to the inputs,
which treat it as newly arrived.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S
from flexarm_ros.nodes.runtime.topics import rcl_ports
from flexarm_ros.nodes.runtime.topics.channels import Input
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter
from flexarm_ros.nodes.runtime.waiting import Waiting
from flexarm_ros.wire.fused_step import FusedStep, PlantStep
from flexarm_ros.wire.rcl_calls import PORT
import numpy as np

_LONGEST_NS = int(HOUSEKEEPING_S * 1e9)


class FastPath:
    """
    The compiled loop of a node with its ports.

    ``inputs`` of the step: the one that arrives last first.  Those of topics that are published
    ahead of their tick are read before it.  ``outputs``: the handles of the step's publishers.
    ``run`` is what ``bind`` of the step returns, None where nodes take every message in Python.
    """

    run: Any = None

    def __init__(
        self, step: FusedStep | PlantStep, inputs: Sequence[Input], outputs: Sequence[Any],
        waiter: Waiter | None = None,
    ) -> None:  # fmt: skip
        self._kept = step, outputs, waiter  # for their addresses
        pairs = list(zip(inputs, step.inputs, strict=True))
        pairs.sort(key=lambda pair: not pair[0].topic.ahead)
        self._entries = [entry for entry, _ in pairs]
        ports = self._ports = np.zeros(len(inputs) + len(outputs), PORT)
        link = rcl_ports.make_link(waiter.address if waiter is not None else 0, _LONGEST_NS)
        if link is None:
            return
        self._link = link
        for i, (entry, buffer) in enumerate(pairs):
            rcl_ports.open_input(ports[i : i + 1], entry.handle, buffer, self)
            ports['last'][i] = entry is inputs[0]
        for i, buffer in enumerate(step.outputs):
            at = len(inputs) + i
            rcl_ports.open_output(ports[at : at + 1], outputs[i], buffer)
        self.run = step.bind(link, ports)

    def enter(self, tick: int, since_s: float, until_s: float) -> bool:
        """
        Prepare a loop from ``tick`` on; False if its messages cannot be read here.

        ``since_s``: time of the last progress, ``until_s``: when the loop is to return, s of
        `time.monotonic`.
        """
        if self.run is None or not all(e.plain and e.tick < tick for e in self._entries):
            return False
        for i, entry in enumerate(self._entries):
            entry.lend(self._ports[i : i + 1])
        link = self._link
        for name in ('longest', 'stop', 'ticks'):
            link[name] = 0
        link['since'], link['until'] = int(since_s * 1e9), int(until_s * 1e9)
        return True

    @property
    def ticks(self) -> int:
        """Number of ticks that the loop has completed since `enter`, 0 after `leave`."""
        return int(self._link['ticks'][0]) if self.run is not None else 0

    def stop(self) -> None:
        """Let the loop return before its next tick; from any thread."""
        if self.run is not None:
            self._link['stop'] = 1

    def leave(self, tick: int, waiting: Waiting) -> None:
        """Leave the inputs where ``tick`` is next, and give back what has been read of it."""
        for i, entry in enumerate(self._entries):
            entry.take_back(self._ports[i : i + 1], tick)
        self._link['ticks'] = 0
        waiting.advanced(*(self._link[name].item() * 1e-9 for name in ('since', 'longest')))
