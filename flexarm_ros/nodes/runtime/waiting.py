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

"""Time limits of a participant: how long it waits for its peers, and which one it blames."""

from __future__ import annotations

import time

from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.membership import Membership
from flexarm_ros.nodes.runtime.joining.status import PACE, Phase, Status
from flexarm_ros.nodes.runtime.member import Member

_STALL_S = 0.5
"""A poll that comes this much late means that the process itself was stopped, s."""
_SLOW_S = 1.0
"""Wall time of a tick from which on ``/diagnostics`` says what it is waiting for, s."""


class Waiting:
    """
    Wall time since the last progress of a participant, and the limits on it.

    Times are those of `time.monotonic`, in s.  The limits are ``start_timeout`` before tick 0
    and after a reset, ``tick_timeout`` afterwards.
    """

    def __init__(self, me: Member, membership: Membership) -> None:
        self._me, self._membership = me, membership
        self._since = self._ready_at = self._polled = time.monotonic()

    def progress(self) -> float:
        """Record that this node has advanced; return the time."""
        now = time.monotonic()
        if now - self._since > self._me.longest_wait_s:
            self._me.longest_wait_s = now - self._since
        self._since = now
        return now

    @property
    def since(self) -> float:
        """Time of the last progress."""
        return self._since

    def advanced(self, since: float, longest: float) -> None:
        """Record progress up to ``since``, with the longest wait between two ticks, s."""
        self._since = max(self._since, since)
        self._me.longest_wait_s = max(self._me.longest_wait_s, longest)

    def restart(self) -> None:
        """Count the limits from now on."""
        self._since = time.monotonic()

    def ready(self, now: float) -> None:
        """Count the limits from ``now`` on, when this node has become ready."""
        self._since = self._ready_at = now

    def poll(self, now: float) -> None:
        """Restart the limits if this process was stopped: its queues have not been read yet."""
        if now - self._polled > self._me.look_interval + _STALL_S:
            self._since = now
        self._polled = now

    def check_ready(self, now: float) -> None:
        """Raise RunFailed if the peers have not been ready for ``start_timeout``."""
        limit = self._me.config.run.start_timeout
        if now - self._since > limit:
            late = self._membership.not_ready() or ['']
            why = self._membership.waited_for(late[0])
            raise RunFailed(late[0], f'start: {", ".join(late)} not ready within {limit:g} s{why}')

    def check_running(self, now: float) -> None:
        """
        Raise RunFailed if tick 0 has not begun, or a tick has not been answered, in time.

        A paused run has no limit, and the plant's pace is added to that of a tick.  Sets
        ``missing`` of the member if a tick is slow.
        """
        me, plant = self._me, self._membership.status_of('plant')
        me.missing = ''
        paused = me.board.mine.phase is Phase.PAUSED
        if not self._begun(plant):
            me.board.remind(now)
            self._check_begun(now)
            self._since = now
        elif paused or (plant is not None and plant.phase is Phase.PAUSED):
            self._since = now
        else:
            pace = float(plant.extra.get(PACE, '0')) if plant is not None else 0.0
            limit = me.config.run.tick_timeout + me.patience_s() + pace
            self._check_answer(now - self._since, limit)

    def _begun(self, plant: Status | None) -> bool:
        """Whether tick 0 may have been published: the plant waits for the slowest node."""
        if self._me.ROLE == 'plant' or any(i.tick >= 0 for i in self._me.inputs.values()):
            return True
        return plant is not None and plant.phase not in (Phase.JOINING, Phase.READY)

    def _check_begun(self, now: float) -> None:
        limit = self._me.config.run.start_timeout
        if now - self._ready_at > limit:
            why = self._membership.waited_for('plant')
            raise RunFailed('plant', f'start: not begun within {limit:g} s{why}')

    def _check_answer(self, idle: float, limit: float) -> None:
        if idle <= min(_SLOW_S, limit):
            return
        me = self._me
        blame, missing = me.waiting_for()
        me.missing = f'waiting for {blame}: {missing}' if blame else ''
        if idle > limit:
            raise RunFailed(
                blame, f'tick {me.tick}: {missing} within {me.config.run.tick_timeout:g} s'
            )
