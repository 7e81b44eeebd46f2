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
The loop that drives the participants of a process through their ticks.

A participant advances when it has every input of its next tick.  The wall clock matters only for
the limits on the time that a peer may take to answer.
"""

from __future__ import annotations

from collections.abc import Sequence
import time

from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter


def spin(participants: Sequence[Participant]) -> None:
    """Drive the participants of this process until each has left its run."""
    waiter = Waiter(participants[0].context)
    if len(participants) == 1:
        _spin_alone(participants[0], waiter)
    else:
        _spin_together(participants, waiter)


def _spin_alone(participant: Participant, waiter: Waiter) -> None:
    """Drive one participant: it sleeps after each tick, since other processes answer it."""
    board, next_look = participant.board, 0.0
    while True:
        if participant.drive() and participant.run_on(waiter, next_look):
            continue
        now = time.monotonic()
        if now >= next_look:
            participant.poll_peers(now)
            next_look = now + participant.look_interval
        if participant.finished:
            return
        pause = min(next_look - now, participant.max_sleep_s(now))
        waiter.wait(participant.blocked_on(), int(pause * 1e9))
        if not board.going:
            next_look = 0.0  # an unread status of a peer would wake it again


def _spin_together(participants: Sequence[Participant], waiter: Waiter) -> None:
    """Drive several participants: the process sleeps when none of them has work."""
    next_look = 0.0
    while True:
        busy = False
        for participant in participants:
            busy |= participant.drive()
        now = time.monotonic()
        if now >= next_look:
            for participant in participants:
                participant.poll_peers(now)
            if all(p.finished for p in participants):
                return
            next_look = now + min(p.look_interval for p in participants)
        if not busy:
            waiting = [handle for p in participants for handle in p.blocked_on()]
            pause = min([max(0.0, next_look - now)] + [p.max_sleep_s(now) for p in participants])
            waiter.wait(waiting, int(pause * 1e9))
            if any(not p.under_way and not p.finished for p in participants):
                next_look = 0.0
