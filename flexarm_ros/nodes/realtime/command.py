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

"""The commands of a free-running run: the newest counts, and when it arrived."""

from __future__ import annotations

import time
from typing import Any

from flexarm_ros.core.run.results.real_time import NO_COMMAND
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.topics.channels import Input, Values
from flexarm_ros.wire.topics import Topic

_MOST_MESSAGES = 200
"""Messages taken at once: a flood of them must not hold a tick up."""


class CommandInput(Input):
    """
    The newest command, of a controller that need not answer each tick.

    ``tick`` is the tick that it answers, -1 for none, ``at`` the wall time of its arrival, s.
    Its stamp is that of the tick, or 0 for a controller that has no stamp to give: then it
    answers the tick during which it arrives.
    """

    at = NO_COMMAND

    def reset(self) -> None:
        """Forget the last command."""
        super().reset()
        self.at = NO_COMMAND

    def poll(self, tick: int) -> bool:
        """
        Take what has arrived during ``tick`` or before; True where anything valid has.

        Raises `RunFailed` on a message that is none of the run's, unless ``on_invalid`` says
        to pass over it.
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
        """Take one message: arrival, stamp, values and what is wrong with it; None without one."""
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
        """Make this the newest command, or say what is wrong with it."""
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
    Return when a message arrived, s of the monotonic clock; ``now`` where that is not told.

    The middleware's thread stamps it by the system's clock, before this thread takes it.
    """
    received = info.get('received_timestamp') or 0
    waited = 1e-9 * (time.time_ns() - received)
    return now - waited if received > 0 and 0.0 <= waited < 60.0 else now


class AppliedInput(Input):
    """The commands that the plant has held, one a tick, in the place of ``topic``'s own."""

    def configure(self, topic: Topic, timeline: Timeline) -> None:
        """Keep the topic: what is agreed on is the controller's, with the same content."""
        super().configure(self.topic, timeline)
