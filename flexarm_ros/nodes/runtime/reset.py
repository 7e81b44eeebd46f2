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
Starting a run again in the same graph: every node at tick 0, no old message taken.

The plant announces a new epoch by its status.  Each node then delivers what it
has sent, rebuilds its part and says so; when it sees that all have, the last
message of the old epoch is in the queues, so it empties them and is ready.
The new run's bytes are those of a fresh one.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from flexarm_ros.nodes.runtime.status import Phase, Status

if TYPE_CHECKING:
    from flexarm_ros.nodes.runtime.participant import Participant

_KEY = 'epoch'
_PLANT = 'plant'


def epoch_of(status: Status | None) -> int:
    """Return the epoch that a participant is in."""
    return int(status.extra.get(_KEY, '0')) if status is not None else 0


def plant_of(status: Status) -> str:
    """Return the identity of the plant that a participant flies with; empty while it joins."""
    return status.extra.get(_PLANT, '')


class Epochs:
    """One participant's way from epoch to epoch."""

    def __init__(self, participant: Participant) -> None:
        self._me = participant
        self.number = 0

    def extra(self, **more: str) -> dict[str, str]:
        """Return what the status says beside the phase."""
        plant = self._me.membership.status_of('plant')
        return {_KEY: str(self.number), _PLANT: plant.identity if plant else '', **more}

    def announced(self) -> bool:
        """Whether the plant is in a later epoch than this node."""
        return epoch_of(self._me.membership.status_of('plant')) > self.number

    def begin(self, number: int) -> None:
        """Leave the old epoch: deliver, rebuild, say so."""
        me = self._me
        self.number = number
        me.flush()
        me.tick, me.last_tick = 0, None
        for entry in me.inputs.values():
            entry.reset()
        me.live.restore()
        me.build()
        me.still_waiting()
        me.change_phase(Phase.RESETTING, extra=self.extra())

    def settled(self) -> bool:
        """Whether all have left the old epoch; then its last messages are thrown away."""
        me = self._me
        for role in me.membership.required():
            if role in me.membership.foreign:
                continue
            status = me.membership.status_of(role)
            if status is None or epoch_of(status) < self.number:
                return False
        for entry in [*me.inputs.values(), *me.side_inputs]:
            entry.drain()
        return True
