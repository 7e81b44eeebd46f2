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

"""The node of any role of a run: it joins, agrees on the scenario, advances, and leaves."""

from __future__ import annotations

import time
from typing import Any

from flexarm_ros.core.run.answers import ANY_ERROR
from flexarm_ros.core.run.parts import part_of
from flexarm_ros.nodes.realtime.system import ask_all_threads
from flexarm_ros.nodes.runtime.diagnostics import Diagnostics
from flexarm_ros.nodes.runtime.ending import Ending
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import Phase, StatusBoard
from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S, MemberNode
from flexarm_ros.nodes.runtime.parameters.declared import declare_and_load, declare_own
from flexarm_ros.nodes.runtime.parameters.live import LiveParameters
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.nodes.runtime.phases import Phases
from flexarm_ros.nodes.runtime.process.supervisor import INTERRUPTED, LAUNCHER_GONE, Supervisor
from flexarm_ros.nodes.runtime.reset import Epochs
from flexarm_ros.nodes.runtime.topics.channels import Input, Output
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter
from flexarm_ros.nodes.runtime.topics.graph import reads
from flexarm_ros.nodes.runtime.topics.repeating import RepeatingInput
from flexarm_ros.nodes.runtime.waiting import Waiting
from flexarm_ros.wire.topics import per_tick_topics, Topic


class Participant(MemberNode):
    """
    A node that takes part in a lock-step run under a role.

    A subclass sets ``ROLE``, creates its objects in `build` and does one step of its work in
    `advance`.  The topics that it reads and writes follow from `flexarm_ros.wire.topics`.
    `lockstep.spin` calls `drive`, `poll_peers`, `max_sleep_s` and `blocked_on`.
    """

    alone = True
    """Whether no other node is in this process."""

    _prioritised = False

    fast: FastPath | None = None
    """The fast path of this node with its present parameters, once it has been taken."""

    again = False
    """Whether `advance` may have more to do at once; if not, a wake-up makes one call."""

    def __init__(self, argv: list[str], supervisor: Supervisor, **options: Any) -> None:
        super().__init__(self.ROLE, **options)
        self.supervisor = supervisor
        self.config = declare_and_load(self, self.ROLE, argv)
        declare_own(self, self.ROLE, OWN.get(self.ROLE, {}), argv)
        self.board = StatusBoard(self, self.ROLE)
        self.inputs, self.outputs, self.side_inputs, self.side_outputs = {}, {}, [], []
        self._missing: Input | None = None
        self._next_invalid_log = 0.0
        self.make_endpoints()
        self.membership = Membership(self, self.board)
        self.epochs = Epochs(self.membership)
        self.live = LiveParameters(self, self.membership)
        self.waiting = Waiting(self, self.membership)
        self.ending = Ending(self, self.membership, Diagnostics(self, self.membership))
        self.phases = Phases(
            self, self.membership, self.epochs, self.live, self.waiting, self.ending
        )
        self.board.publish(parameters=self.membership.own_parameters())

    def make_endpoints(self) -> None:
        """Create the publishers and subscriptions of the configuration that do not exist yet."""
        for topic in per_tick_topics(self.config):
            if topic.node == self.ROLE and topic.name not in self.outputs:
                self.outputs[topic.name] = Output(self, topic)
            elif reads(self.ROLE, topic, self.config) and topic.name not in self.inputs:
                self.inputs[topic.name] = self.make_input(topic)

    def make_input(self, topic: Topic) -> Input:
        """Return the reading end of a topic."""
        kind = RepeatingInput if topic.repeated else Input
        return kind(self, topic, self.invalid_message)

    # --- for roles ---------------------------------------------------------------------

    def advance(self) -> bool:
        """Do the work of ``self.tick`` as far as the inputs allow; True if any was done."""
        raise NotImplementedError

    def advance_fast(self, waiter: Waiter, until: float) -> None:
        """Do `run_on` for a role that has a fused step; others have no fast path."""

    def have(self, *entries: Input) -> bool:
        """
        Whether each of these inputs has its message of ``self.tick``.

        This node then sleeps until the first missing one arrives: with the input that arrives
        last given first, a tick costs one wake-up.
        """
        for entry in entries:
            if not entry.fetch(self.tick):
                self._missing = entry
                return False
        self._missing = entries[0]
        return True

    def start(self) -> None:
        """Begin the run."""
        self.change_phase(Phase.RUNNING, extra=self.epochs.extra())

    def check_start(self, now: float) -> None:
        """Start at once: a node other than the plant and the trajectory only answers messages."""
        self.start()

    def waiting_for(self) -> tuple[str, str]:
        """Return the role whose message of ``self.tick`` is missing, and what is missing."""
        for entry in self.inputs.values():
            if entry.whole <= self.tick:
                return entry.source, f'no message on {entry.topic.name}'
        return '', ''

    def take_priority(self, priority: int) -> None:
        """
        Once, request half the plant's ``priority`` for all threads, and report the answer.

        In a process of several nodes that includes the recorder's thread: the others wait for it
        while it holds Python's lock.
        """
        behind = part_of(self.ROLE).FOR_THE_RECORD  # no tick waits for the recorder
        if self._prioritised or not priority or behind:
            return
        self._prioritised = True
        said = ask_all_threads(max(1, priority // 2))
        self.get_logger().info(f'real time: {said}')
        nodes = 'nodes but the recorder' if self.alone else 'composed nodes'
        self.supervisor.report(self.ROLE, common=f'real time, {nodes}: {said}')

    def check_end(self) -> None:
        """Leave the run if this node has completed its last tick."""
        if self.tick > self.final_tick:
            self.ending.finish()

    # --- for lockstep.spin ---------------------------------------------------------------

    def drive(self) -> bool:
        """Advance as far as the inputs allow; True if anything was done."""
        if not self.board.going:
            return False
        moved = False
        try:
            while not self.finished:
                if self.live.waiting:
                    self.live.apply()
                if not self.advance():
                    break
                moved = True
                if not self.again:
                    break
        except ANY_ERROR as error:
            self.ending.fail(self.ending.failure_of(error))
        if moved:
            self.waiting.progress()
        return moved

    def run_on(self, waiter: Waiter, until: float) -> bool:
        """
        Take the next ticks on the fast path, as long as it can handle them.

        Returns at the wall time ``until``, s of `time.monotonic`, before the last tick, and at the
        first tick that it cannot handle: a message is missing or unusual, or a parameter has
        changed. True if messages of that tick have been taken, for which `drive` need not wait.
        """
        if self.finished or self.live.waiting:
            return False
        first = self.tick
        try:
            self.advance_fast(waiter, until)
        except ANY_ERROR as error:
            self.ending.fail(self.ending.failure_of(error))
        self.fast_ticks += self.tick - first
        return any(entry.given_back for entry in self.inputs.values())

    def blocked_on(self) -> list[Any]:
        """
        Return the handles to wait on: that of the missing input, or of the peers' status.

        During a run the status is only polled: it would wake a node that does not read it.  So
        would the copies of messages that a node of this process passes directly.
        """
        if self._missing is not None and self.board.going:
            return [] if self._missing.near else [self._missing.handle]
        return [self.board.handle]

    def max_sleep_s(self, now: float) -> float:
        """Return the longest time that this node may sleep, s."""
        return HOUSEKEEPING_S

    def poll_peers(self, now: float) -> None:
        """Act on the peers' statuses, requests to leave and time limits."""
        if self.finished:
            return
        try:
            self.phases.poll(now)
        except ANY_ERROR as error:
            self.ending.fail(self.ending.failure_of(error))

    def interrupt(self) -> None:
        """Leave the run because the user interrupts it, or the launcher is gone: RunFailed."""
        reason = LAUNCHER_GONE if self.supervisor.gone else INTERRUPTED
        raise RunFailed(self.ROLE, f'{reason} at tick {self.tick}')

    @property
    def present_tick(self) -> int:
        """The tick of this node, for any thread: ``tick`` stands still on the fast path."""
        return self.tick + (self.fast.ticks if self.fast is not None else 0)

    def return_soon(self) -> None:
        """Let the fast path return to Python before its next tick; from any thread."""
        if self.fast is not None:
            self.fast.stop()

    # --- rejected messages ---------------------------------------------------------------

    def invalid_message(self, topic: str, fault: str) -> None:
        """Count a rejected message, log it at most once per second; see `Member`."""
        self.invalid += 1
        if self.config.run.on_invalid == 'error':
            raise RunFailed('', f'tick {self.tick}: invalid message on {topic}: {fault}')
        now = time.monotonic()
        if now >= self._next_invalid_log:
            self._next_invalid_log = now + 1.0
            self.get_logger().warning(f'{_counted(self.invalid)}, last on {topic}: {fault}')

    def log_totals(self) -> None:
        """Log the number of ticks on the fast path, and that of rejected messages, if any."""
        self.get_logger().debug(f'{self.fast_ticks} of {self.tick} ticks on the fast path')
        if self.invalid:
            self.get_logger().warning(f'{_counted(self.invalid)} in all')


def _counted(invalid: int) -> str:
    return f'{invalid} invalid message{"" if invalid == 1 else "s"}'
