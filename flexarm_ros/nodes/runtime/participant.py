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

"""What every node of a run does: join, agree on the scenario, advance, leave."""

from __future__ import annotations

import time
import traceback
from typing import Any

from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.diagnostics import Diagnostics
from flexarm_ros.nodes.runtime.errors import NeverMet, RunFailed
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import Phase, StatusBoard
from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S, Member
from flexarm_ros.nodes.runtime.parameters.declared import declare_and_load, declare_own
from flexarm_ros.nodes.runtime.parameters.live import ChangesInput, LiveParameters
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.nodes.runtime.process.supervisor import INTERRUPTED, LAUNCHER_GONE, Supervisor
from flexarm_ros.nodes.runtime.progress import ProgressInput, ProgressOutput
from flexarm_ros.nodes.runtime.reset import Epochs
from flexarm_ros.nodes.runtime.topics.channels import Input, Output
from flexarm_ros.nodes.runtime.topics.graph import reads
from flexarm_ros.wire.topics import per_tick_topics
from rclpy.duration import Duration

_JOIN_INTERVAL_S = 0.02
_STALL_S = 0.5
_FLUSH_S = 4.0
_REPAIR_S = 1.0
"""Wall time in which a node that stood still has asked for what it missed."""
_FAILED_FLUSH_S = 1.0
_INTERRUPTED_FLUSH_S = 2.0
_ACK_SLICE_S = 0.2
_SLOW_S = 1.0
"""Wall time of a tick from which on diagnostics tell what it waits for."""


def describe(error: BaseException) -> str:
    """Return an error's name and text in one line of at most 300 characters."""
    return ' '.join(f'{type(error).__name__}: {error}'.split())[:300]


class Participant(Member):
    """
    A node that takes part in a lock-step run under a role.

    A subclass names its ``ROLE``, builds its part of the core in `build` and
    does one step of its work in `advance`, which returns False when it lacks
    an input.  Which topics it reads and writes follows from the table in
    `flexarm_ros.wire.topics`.
    """

    again = False
    """Whether `advance` may have more to do at once; else a wake-up takes one call."""

    def __init__(self, argv: list[str], supervisor: Supervisor, **options: Any) -> None:
        super().__init__(self.ROLE, **options)
        self.supervisor = supervisor
        self.config = declare_and_load(self, self.ROLE, argv)
        declare_own(self, self.ROLE, OWN.get(self.ROLE, {}), argv)
        self.board = StatusBoard(self, self.ROLE)
        self.failure: RunFailed | None = None
        self.failed_run = False
        self.finished = False
        self.interrupted = 0
        self.released = False
        """Set by the launcher's SIGUSR1: what it had to do at a held tick is done."""
        self.look_interval = _JOIN_INTERVAL_S
        self.invalid = 0
        self._last_invalid_log = 0.0
        self.inputs: dict[str, Input] = {}
        self._missing: Input | None = None
        self.outputs: dict[str, Output] = {}
        self.side_inputs: list[ProgressInput | ChangesInput] = []
        self.side_outputs: list[ProgressOutput] = []
        self._make_endpoints()
        self.membership = Membership(self, self.board)
        self.epochs = Epochs(self.membership)
        self.live = LiveParameters(self, self.membership)
        self.tick = 0
        self.last_tick: int | None = None
        self._moved = self._ready_at = self._looked = time.monotonic()
        self.missing = ''
        self.longest_wait_s = 0.0
        self._closed = False
        self.crashed = ''
        """An exception in a service's callback, from the thread that serves them."""
        self.board.publish(parameters=self.membership.own_parameters())
        self.diagnostics = Diagnostics(self, self.membership)

    def _make_endpoints(self) -> None:
        """Make those that the scenario asks for and that are not there yet."""
        for topic in per_tick_topics(self.config):
            if topic.node == self.ROLE and topic.name not in self.outputs:
                self.outputs[topic.name] = Output(self, topic)
            elif reads(self.ROLE, topic) and topic.name not in self.inputs:
                self.inputs[topic.name] = Input(self, topic, self.invalid_message)

    # --- what a subclass provides -------------------------------------------------

    def build(self) -> None:
        """Make the core object of this node from ``self.config`` (agreed by all)."""
        raise NotImplementedError

    def warm_up(self) -> None:
        """Call the core once on a copy: what is not compiled yet is compiled before tick 0."""

    def advance(self) -> bool:
        """Do the work of ``self.tick`` as far as the inputs allow; True where any was done."""
        raise NotImplementedError

    def waiting_for(self) -> tuple[str, str]:
        """Return the role that has not answered ``self.tick`` and what it owes."""
        for entry in self.inputs.values():
            if entry.whole <= self.tick:
                return entry.source, f'no message on {entry.topic.name}'
        return '', ''

    def close(self) -> None:
        """Finish files; called once, however the run ends."""

    def start(self) -> None:
        """Begin the run; called when this node is ready (plant: when all are)."""
        self.change_phase(Phase.RUNNING, extra=self.epochs.extra())

    def have(self, *entries: Input) -> bool:
        """
        Whether each of these inputs has its message of ``self.tick``.

        The first that has not is what this node then sleeps on: give the one
        that comes last first, and a tick costs one wake-up.
        """
        for entry in entries:
            if not entry.fetch(self.tick):
                self._missing = entry
                return False
        self._missing = entries[0]
        return True

    # --- driven by lockstep.spin ---------------------------------------------------

    def drive(self) -> bool:
        """Advance as far as the inputs allow; True where anything was done."""
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
        except Exception as error:
            self.fail(self._failure_of(error))
        if moved:
            now = time.monotonic()
            if now - self._moved > self.longest_wait_s:
                self.longest_wait_s = now - self._moved
            self._moved = now
        return moved

    def blocked_on(self) -> list[Any]:
        """
        Return the handles to wait on: the missing input, or the peers' status.

        While a run goes on the status is looked at now and then only: a node that
        slept on it would be woken again and again by a word that it has not taken.
        """
        if self._missing is not None and self.board.going:
            return [self._missing.handle]
        return [self.board.handle]

    def max_sleep_s(self, now: float) -> float:
        """Return how long this node may sleep at the longest, in seconds."""
        return HOUSEKEEPING_S

    def poll_peers(self, now: float) -> None:
        """Look at the peers, the supervisor and the time limits."""
        if self.finished:
            return
        if now - self._looked > self.look_interval + _STALL_S:
            self._moved = now  # this process stood still: what came meanwhile is still to be read
        self._looked = now
        try:
            self.board.update()
            for endpoint in (*self.outputs.values(), *self.inputs.values()):
                endpoint.look()
            if self.crashed:
                raise RunFailed(self.ROLE, f'tick {self.tick}: in a service: {self.crashed}')
            if self.interrupted or self.supervisor.gone:
                self.interrupt()
            elif self.board.mine.phase is Phase.JOINING:
                self.board.remind(now)
                self._join(now)
            elif self.board.mine.phase is Phase.READY:
                self.board.remind(now)
                self.membership.watch(now)
                self.check_start(now)
            elif self.board.mine.phase is Phase.RESETTING:
                self._reset(now)
            else:
                self._check_running(now)
        except Exception as error:
            self.fail(self._failure_of(error))

    def _failure_of(self, error: Exception) -> RunFailed:
        """Return what ended the run; an error nobody foresaw goes to the log with its place."""
        if isinstance(error, RunFailed):
            return error
        self.get_logger().error(''.join(traceback.format_exception(error)))
        return RunFailed(self.ROLE, f'tick {self.tick}: {describe(error)}')

    def check_start(self, now: float) -> None:
        """Start as soon as ready: a node other than the plant waits for messages only."""
        self.start()

    def _join(self, now: float) -> None:
        if not self.membership.join(now):
            return
        if not self.membership.built:
            self.config = self.membership.config
            self.timeline = Timeline.of(self.config.run)
            self._make_endpoints()  # another node may have asked for more
            for topic in per_tick_topics(self.config):
                for entries in (self.inputs, self.outputs):
                    if topic.name in entries:
                        entries[topic.name].configure(topic, self.timeline)
            self.live.restore()
            self.build()
            self.warm_up()
            self.membership.built = True
        if self.membership.matched(now):
            self.membership.lock_members()
            for fault in self.membership.deaf:
                self.get_logger().warning(f'a subscription gets no messages: {fault}')
            self.change_phase(Phase.READY, extra=self.epochs.extra())
            self._moved = self._ready_at = now
            self.look_interval = _JOIN_INTERVAL_S
            self.check_start(now)

    def begin_epoch(self) -> None:
        """Leave the old epoch: deliver, rebuild, say so."""
        self.epochs.number += 1
        self.flush()
        self.tick, self.last_tick = 0, None
        for entry in self.inputs.values():
            entry.reset()
        self.live.restore()
        self.build()
        self.still_waiting()
        self.change_phase(Phase.RESETTING, extra=self.epochs.extra())

    def _reset(self, now: float) -> None:
        """Be ready for the new epoch as soon as everybody has left the old one."""
        self.membership.watch(now)
        if self.epochs.left_by_all():
            for entry in [*self.inputs.values(), *self.side_inputs]:
                entry.drain()  # the old epoch's last messages
            self.change_phase(Phase.READY, extra=self.epochs.extra())
            self._moved = self._ready_at = now
            self.check_start(now)
        else:
            self.check_patience(now)

    def still_waiting(self) -> None:
        """Let the time limits count from now on."""
        self._moved = time.monotonic()

    def check_patience(self, now: float) -> None:
        """Raise RunFailed where the peers have not been ready for too long."""
        limit = self.config.run.start_timeout
        if now - self._moved > limit:
            late = self.membership.not_ready() or ['']
            why = self.membership.waited_for(late[0])
            raise RunFailed(late[0], f'start: {", ".join(late)} not ready within {limit:g} s{why}')

    def _check_running(self, now: float) -> None:
        self.look_interval = HOUSEKEEPING_S
        if self.epochs.announced():
            self.begin_epoch()
            self.look_interval = _JOIN_INTERVAL_S
            return
        plant = self.membership.status_of('plant')
        if plant is not None and plant.last_tick >= 0:
            self.last_tick = min(plant.last_tick, self.timeline.ticks - 1)
            self.check_end()
        if self.finished:
            return
        self.membership.watch(now)
        for output in self.side_outputs:
            # Again: it was told to nobody where the reader was not connected yet.
            output.tell(self.tick)
        self.missing = ''
        paused = plant is not None and plant.phase is Phase.PAUSED
        pace = float(plant.extra.get('pace_s', '0')) if plant is not None else 0.0
        limit = self.config.run.tick_timeout + self.patience_s() + pace
        if not self._begun():
            self.board.remind(now)
            if now - self._ready_at > self.config.run.start_timeout:
                limit, why = self.config.run.start_timeout, self.membership.waited_for('plant')
                raise RunFailed('plant', f'start: not begun within {limit:g} s{why}')
            self._moved = now
        elif paused or self.board.mine.phase is Phase.PAUSED:
            self._moved = now
        else:
            self._check_answer(now - self._moved, limit)

    def _check_answer(self, idle: float, limit: float) -> None:
        """Say what a slow tick is waiting for, and end the run where it is too slow."""
        if idle <= min(_SLOW_S, limit):
            return
        blame, owed = self.waiting_for()
        self.missing = f'waiting for {blame}: {owed}' if blame else ''
        if idle > limit:
            raise RunFailed(
                blame, f'tick {self.tick}: {owed} within {self.config.run.tick_timeout:g} s'
            )

    def _begun(self) -> bool:
        """Whether tick 0 may have gone out: before, the plant waits for the slowest node."""
        if self.ROLE == 'plant' or any(entry.tick >= 0 for entry in self.inputs.values()):
            return True
        plant = self.membership.status_of('plant')
        return plant is not None and plant.phase not in (Phase.JOINING, Phase.READY)

    def patience_s(self) -> float:
        """
        Return wall time beyond the tick limit before this node gives its verdict.

        The node nearest to the missing answer speaks first: the controller
        knows which sensor is silent, the plant only that there is no torque.
        """
        return 0.5

    # --- leaving --------------------------------------------------------------------

    def change_phase(self, phase: Phase, **more: Any) -> None:
        """Enter ``phase`` and tell the peers and the supervisor."""
        self.board.publish(phase=phase, text=more.pop('text', phase.value), **more)
        self.supervisor.report(self.ROLE, phase=phase.value, text=self.board.mine.text)

    @property
    def final_tick(self) -> int:
        """Return the last tick of the run: as the plant has ended it, else as planned."""
        return self.timeline.ticks - 1 if self.last_tick is None else self.last_tick

    def check_end(self) -> None:
        """Leave if this node has done its part of a run that is over, as planned or before."""
        if self.tick > self.final_tick:
            self.finish()

    def finish(self) -> None:
        """Leave a run that is complete as far as this node goes."""
        if self.finished:
            return
        self.finished = True
        self.flush()
        try:
            self._close()
        except Exception as error:
            self.finished = False
            raise self._failure_of(error) from None
        self.change_phase(
            Phase.DONE, text=f'done after {self.tick} ticks', last_tick=self.tick - 1
        )
        self.board.flush(1.0)

    def _close(self) -> None:
        """Close once."""
        if not self._closed:
            self._closed = True
            self.close()

    def tell_invalid(self) -> None:
        """Say in the end how many messages were none of the run's."""
        if self.invalid:
            self.get_logger().warning(f'{_counted(self.invalid)} in all')

    def flush(self, limit_s: float | None = None) -> None:
        """
        Wait until every reader has this node's messages, for ``limit_s`` at the longest.

        Without one as long as a peer may take to answer, since who stands still reads
        nothing, and four seconds at least: a lost message is asked for at the next heartbeat,
        which Fast DDS sends every three seconds where it has not our settings (see
        `flexarm_ros.nodes.runtime.process.middleware`).  A user who ends the run does not wait
        that long.
        """
        if limit_s is None:
            limit_s = max(_FLUSH_S, self.config.run.tick_timeout + _REPAIR_S)
        began = time.monotonic()
        for output in [*self.outputs.values(), *self.side_outputs]:
            # In slices: a signal is heard between them.
            while not output.publisher.wait_for_all_acked(Duration(seconds=_ACK_SLICE_S)):
                if self.interrupted or self.supervisor.gone:
                    limit_s = min(limit_s, _INTERRUPTED_FLUSH_S)
                if time.monotonic() - began > limit_s:
                    return

    def interrupt(self) -> None:
        """Leave because the user or the launcher said so."""
        reason = LAUNCHER_GONE if self.supervisor.gone else INTERRUPTED
        self.fail(RunFailed(self.ROLE, f'{reason} at tick {self.tick}'))

    def fail(self, failure: RunFailed) -> None:
        """Leave a run that cannot go on, and say why."""
        if self.finished:
            return
        self.finished = True
        self.failure = failure
        told = f'ended by the {failure.reported_by}: ' if failure.reported_by else ''
        who = f'{failure.blame}: ' if failure.blame else ''
        self.get_logger().error(f'{told}{who}{failure.reason}')
        self.supervisor.report(
            self.ROLE, phase='failed', blame=failure.blame, text=failure.reason, tick=self.tick,
            never_met=isinstance(failure, NeverMet),
        )  # fmt: skip
        refused = self.membership.refused
        self.board.publish(
            phase=Phase.REFUSED if refused else Phase.FAILED,
            text=failure.reason,
            blame=failure.blame,
            extra=self.board.heard(),
        )
        try:
            self._close()
        except Exception as error:  # the run has failed already, for another reason
            self.get_logger().error(describe(error))
        self.flush(_FAILED_FLUSH_S)  # what this node has sent is to be on record
        self.diagnostics.tell()
        self.board.flush(1.0)
        self.diagnostics.flush(1.0)

    def invalid_message(self, topic: str, fault: str) -> None:
        """
        Count a message that is none of the run's, and end the run if so configured.

        Raises `RunFailed` where ``on_invalid`` is ``error``.
        """
        self.invalid += 1
        if self.config.run.on_invalid == 'error':
            raise RunFailed('', f'tick {self.tick}: invalid message on {topic}: {fault}')
        now = time.monotonic()
        if now - self._last_invalid_log >= 1.0:
            self._last_invalid_log = now
            self.get_logger().warning(f'{_counted(self.invalid)}, last on {topic}: {fault}')


def _counted(invalid: int) -> str:
    """Return a number of invalid messages in words."""
    return f'{invalid} invalid message{"" if invalid == 1 else "s"}'
