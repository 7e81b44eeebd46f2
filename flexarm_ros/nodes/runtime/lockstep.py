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

from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
import time

from flexarm_ros.core.run.parts import part_of
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter


def spin(participants: Sequence[Participant]) -> None:
    """
    Drive the participants of this process until each has left its run.

    The recorder of a free run has a thread of its own: a chunk of its bag takes some ticks to
    compress.  In lock-step, which has no deadlines, one thread is faster.
    """
    free = len(participants) > 1 and participants[0].config.run.sync == 'free'
    apart = [p for p in participants if free and part_of(p.ROLE).FOR_THE_RECORD]
    others = [p for p in participants if p not in apart]
    with ThreadPoolExecutor(len(apart) or 1) as pool:
        recording = [pool.submit(_spin_alone, participant) for participant in apart]
        if len(others) == 1:
            _spin_alone(others[0])
        else:
            _spin_together(others)
    for each in recording:
        each.result()


def _spin_alone(participant: Participant) -> None:
    """Drive one participant: it sleeps after each tick, since others answer it."""
    waiter = Waiter(participant.context)
    board, next_look = participant.board, 0.0
    while True:
        again = participant.drive() and participant.run_on(waiter, next_look)
        now = time.monotonic()
        if now >= next_look:
            participant.poll_peers(now)
            next_look = now + participant.look_interval
            again = True  # the poll may have read a message of this tick, which wakes nobody now
        if participant.finished:
            return
        if again:
            continue
        pause = min(next_look - now, participant.max_sleep_s(now))
        waiter.wait(participant.blocked_on(), int(pause * 1e9))
        if not board.going:
            next_look = 0.0  # an unread status of a peer would wake it again


def _spin_together(participants: Sequence[Participant]) -> None:
    """
    Drive several participants: the thread sleeps when none of them has work.

    They poll their peers in turn, one between two passes, so that a tick waits for one poll.
    """
    waiter = Waiter(participants[0].context)
    looks = deque((0.0, participant) for participant in participants)
    while True:
        busy = False
        for participant in participants:
            busy |= participant.drive()
        now = time.monotonic()
        if now >= looks[0][0]:
            _, due = looks.popleft()
            due.poll_peers(now)
            looks.append((now + due.look_interval, due))
            if all(p.finished for p in participants):
                return
        elif not busy:
            waiting = [handle for p in participants for handle in p.blocked_on()]
            pause = min([looks[0][0] - now] + [p.max_sleep_s(now) for p in participants])
            waiter.wait(waiting, int(pause * 1e9))
            if any(not p.under_way and not p.finished for p in participants):
                looks = deque((0.0, participant) for _, participant in looks)
