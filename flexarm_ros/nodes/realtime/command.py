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

"""The commands of a free-running run: the newest one and its time of arrival."""

from __future__ import annotations

import time
from typing import Any

from flexarm_ros.core.run.results.real_time import NO_COMMAND
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.topics.channels import Input, Values
from flexarm_ros.wire.topics import Topic

_MOST_MESSAGES = 200
"""Messages read per poll, so that a flood of them does not delay a tick."""


class CommandInput(Input):
    """
    The newest command of a controller that need not answer every tick.

    ``tick`` is the tick that it answers, -1 for none, ``at`` the wall time of its arrival, s.
    The stamp of a command is that of the tick that it answers; one with
    stamp 0 answers the tick during which it arrives.
    """

    at = NO_COMMAND

    def reset(self) -> None:
        """Forget the last command."""
        super().reset()
        self.at = NO_COMMAND

    def poll(self, tick: int) -> bool:
        """
        Read the commands that have arrived up to now in ``tick``; True if one was valid.

        Raises `RunFailed` for an invalid message, unless ``on_invalid`` is ``ignore``.
        """
        news = False
        for _ in range(_MOST_MESSAGES):
            taken = self._take_newer()
            if taken is None:
                break
            at, stamp, values, fault = taken
            fault = fault or self._newer(tick, stamp, values)
            if fault:
                self._complain(fault)
            else:
                news, self.at = True, at
        return news

    def _take_newer(self) -> tuple[float, int, Values, str] | None:
        """Read one message: arrival, stamp, values and fault; None if there is none."""
        now = time.monotonic()
        if self.near:
            if not self.arrived:
                return None
            _, stamp, values = self.arrived.popleft()
            return now, stamp, values, ''
        taken = self._take(self._type, True)
        if taken is None:
            return None
        data, info = taken
        if not self._ours(info):
            return now, 0, (), self._unwanted
        at = arrival(info, now)
        try:
            return at, *self.topic.codec.decode_any(data), ''
        except ValueError as error:
            return at, 0, (), str(error)[:200]

    def _newer(self, tick: int, stamp: int, values: Values) -> str:
        """Accept this as the newest command, or return its fault."""
        answers, rest = divmod(stamp - self._first_ns, self._period_ns)
        if stamp == 0:
            answers, rest = tick, 0
        if rest or not self.tick <= answers <= tick:
            return f'stamp {stamp} ns, of no tick from {max(0, self.tick)} to {tick}'
        fault = self._not_finite(values)
        if fault:
            return f'{fault} at tick {tick}'
        self.tick, self.values = answers, values
        self.accepted = self.accepted or self._sender
        return ''


def arrival(info: dict[str, Any], now: float) -> float:
    """
    Return the time of arrival, s of the monotonic clock; ``now`` if it is unknown.

    The middleware stamps a message by the system clock when it is received.
    """
    received = info.get('received_timestamp') or 0
    waited = 1e-9 * (time.time_ns() - received)
    return now - waited if received > 0 and 0.0 <= waited < 60.0 else now


class AppliedInput(Input):
    """The commands that the plant has held, one per tick, in place of those on ``topic``."""

    def configure(self, topic: Topic, timeline: Timeline) -> None:
        """Keep the own topic: ``topic`` is that of the controller, with the same content."""
        super().configure(self.topic, timeline)
