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

"""When the player's next tick is due: rate, pause, single steps."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

_LOOK_S = 0.1
"""Wall time between looks at whether the player is to stop."""


class Pace:
    """
    Holds a replay to a multiple of real time; steered from other threads.

    ``stopped`` is asked often and ends every wait.  ``rate`` 0 is as fast as
    it goes.
    """

    def __init__(self, rate: float, paused: bool, stopped: Callable[[], bool]) -> None:
        self._rate, self._paused, self._stopped = rate, paused, stopped
        self._steps = 0
        self._due: float | None = None
        self._wake = threading.Condition()

    @property
    def paused(self) -> bool:
        """Whether the replay waits to be resumed."""
        return self._paused

    def pause(self, paused: bool) -> None:
        """Pause, or go on."""
        with self._wake:
            self._paused, self._steps = paused, 0
            self._wake.notify_all()

    def step(self) -> bool:
        """Let one tick go out while paused; False where it is not paused."""
        with self._wake:
            if not self._paused:
                return False
            self._steps += 1
            self._wake.notify_all()
            return True

    def set_rate(self, rate: float) -> None:
        """Go on at another multiple of real time."""
        with self._wake:
            self._rate = rate
            self._wake.notify_all()

    def wait(self, seconds: float) -> None:
        """
        Wait until a tick is due that lies ``seconds`` of simulated time behind the last.

        The first tick, and the first after a pause, are due at once.
        """
        with self._wake:
            while not self._stopped():
                if self._paused:
                    self._due = None
                    if self._steps:
                        self._steps -= 1
                        return
                    self._wake.wait(_LOOK_S)
                    continue
                now = time.monotonic()
                if self._due is None or not self._rate:
                    self._due = now
                    return
                due = self._due + seconds / self._rate
                if due <= now:
                    self._due = max(due, now - _LOOK_S)  # behind: catch up a little only
                    return
                self._wake.wait(min(due - now, _LOOK_S))
