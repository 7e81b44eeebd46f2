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

"""Commands of a controller that may skip states, for readers that need one at each tick."""

from __future__ import annotations

from collections import deque

from flexarm_ros.nodes.runtime.topics.channels import Input, Values


class RepeatingInput(Input):
    """
    One command per tick: for a skipped state the previous command, with the state's stamp.

    Before the first command the values are zeros.  All readers repeat the same commands, because
    the stamps alone determine them.
    """

    _last: Values
    _pending: deque[bytes]

    @property
    def plain(self) -> bool:
        """False: the stamp of each message determines the repetitions before it."""
        return False

    def reset(self) -> None:
        """Expect tick 0 next."""
        super().reset()
        self._last, self._pending = (), deque()

    def _next(self, tick: int) -> bytes | None:
        """Return the next message, or a repeated one; see `Input._next`."""
        if not self._pending:
            data = super()._next(tick)
            if data is None:
                return None
            self._pending.extend([*self._repeated(data, tick), data])
        return self._pending.popleft()

    def _repeated(self, data: bytes, tick: int) -> list[bytes]:
        """Return a repetition for each tick from ``tick`` on that ``data`` skips."""
        codec, due = self.topic.codec, self._first_ns + tick * self._period_ns
        try:
            stamp, values = codec.decode_any(data)
        except ValueError:
            return []
        skipped, rest = divmod(stamp - due, self._period_ns)
        last = self._last or self.topic.nothing
        self._last = values
        if rest or not 0 < skipped <= self._most_skipped:
            return []
        return [codec.encode(due + i * self._period_ns, *last) for i in range(skipped)]

    _most_skipped = 100_000
    """Ticks; more is the stamp of another clock."""
