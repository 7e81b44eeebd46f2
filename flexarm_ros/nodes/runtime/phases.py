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

"""The phases of a participant: joining, ready, running, resetting, and the way between them."""

from __future__ import annotations

from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.ending import Ending
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import Phase, PRIORITY
from flexarm_ros.nodes.runtime.member import HOUSEKEEPING_S, JOIN_INTERVAL_S, Member
from flexarm_ros.nodes.runtime.parameters.live import LiveParameters
from flexarm_ros.nodes.runtime.reset import Epochs
from flexarm_ros.nodes.runtime.waiting import Waiting
from flexarm_ros.wire.topics import per_tick_topics


class Phases:
    """Takes one participant from phase to phase; `poll` is called every ``look_interval``."""

    def __init__(
        self, me: Member, membership: Membership, epochs: Epochs, live: LiveParameters,
        waiting: Waiting, ending: Ending,
    ) -> None:  # fmt: skip
        self._me, self._membership, self._epochs, self._live = me, membership, epochs, live
        self._waiting, self._ending = waiting, ending
        self._steps = {
            Phase.JOINING: self._join,
            Phase.READY: self._start,
            Phase.RESETTING: self._reset,
        }

    def poll(self, now: float) -> None:
        """
        Read the peers' statuses, and act on them, on requests to leave and on time limits.

        Raises RunFailed if the run cannot continue.
        """
        me = self._me
        self._waiting.poll(now)
        me.board.update()
        for endpoint in (*me.outputs.values(), *me.inputs.values()):
            endpoint.look()
        if me.crashed:
            raise RunFailed(me.ROLE, f'tick {me.tick}: in a service: {me.crashed}')
        if me.interrupted or me.supervisor.gone:
            me.interrupt()
        else:
            self._steps.get(me.board.mine.phase, self._run)(now)

    def begin_epoch(self) -> None:
        """Leave the current run for a new one: deliver all messages, then build anew."""
        me = self._me
        self._epochs.number += 1
        self._ending.flush()
        me.tick, me.last_tick = 0, None
        for entry in me.inputs.values():
            entry.reset()
        self._live.restore()
        me.build()
        self._waiting.restart()
        me.change_phase(Phase.RESETTING, extra=self._epochs.extra())

    def _join(self, now: float) -> None:
        me, membership = self._me, self._membership
        me.board.remind(now)
        if not membership.join(now):
            return
        if not membership.built:
            self._build()
        if membership.matched(now):
            membership.lock_members()
            for fault in membership.deaf:
                me.get_logger().warning(f'a subscription gets no messages: {fault}')
            self._enter_ready(now)

    def _build(self) -> None:
        """Create what depends on the scenario, now that all nodes agree on it."""
        me = self._me
        me.config = self._membership.config
        me.timeline = Timeline.of(me.config.run)
        me.make_endpoints()  # another node's section may require more of them
        for topic in per_tick_topics(me.config):
            for entries in (me.inputs, me.outputs):
                if topic.name in entries:
                    entries[topic.name].configure(topic, me.timeline)
        self._live.restore()
        me.build()
        me.warm_up()
        for entry in me.inputs.values():
            if entry.source in self._membership.external:
                entry.topic.codec.prepare_any()  # else it makes tick 0 late in a free-running run
        self._membership.built = True

    def _enter_ready(self, now: float) -> None:
        me = self._me
        plant = self._membership.status_of('plant')
        if plant is not None and me.config.run.sync == 'free':
            me.take_priority(int(plant.extra.get(PRIORITY, '0')))
        me.change_phase(Phase.READY, extra=self._epochs.extra())
        self._waiting.ready(now)
        me.check_start(now)

    def _start(self, now: float) -> None:
        self._me.board.remind(now)
        self._membership.watch()
        self._me.check_start(now)

    def _reset(self, now: float) -> None:
        """Become ready as soon as every node has left the run before."""
        self._membership.watch()
        if self._epochs.left_by_all():
            for entry in [*self._me.inputs.values(), *self._me.side_inputs]:
                entry.drain()  # the last messages of the run before
            self._enter_ready(now)
        else:
            self._waiting.check_ready(now)

    def _run(self, now: float) -> None:
        me = self._me
        me.look_interval = HOUSEKEEPING_S
        if self._epochs.announced():
            self.begin_epoch()
            me.look_interval = JOIN_INTERVAL_S
            return
        plant = self._membership.status_of('plant')
        if plant is not None and plant.last_tick >= 0:
            me.last_tick = min(plant.last_tick, me.timeline.ticks - 1)
            me.check_end()
        if me.finished:
            return
        self._membership.watch()
        for output in me.side_outputs:
            output.tell(me.tick)  # again: the reader may not have been connected before
        self._waiting.check_running(now)
