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

"""Timing of the player's ticks: rate, pause, single steps."""

from __future__ import annotations

from collections.abc import Callable
import threading
import time

_LOOK_S = 0.1
"""Wall time between checks for a stop of the player."""


class Pace:
    """
    Paces a replay at a multiple of real time; controlled from other threads.

    ``stopped`` is called often and ends every wait.  ``rate`` 0 means as fast as possible.
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
        """Pause or resume."""
        with self._wake:
            self._paused, self._steps = paused, 0
            self._wake.notify_all()

    def step(self) -> bool:
        """Release one tick while paused; False if not paused."""
        with self._wake:
            if not self._paused:
                return False
            self._steps += 1
            self._wake.notify_all()
            return True

    def set_rate(self, rate: float) -> None:
        """Continue at another multiple of real time."""
        with self._wake:
            self._rate = rate
            self._wake.notify_all()

    def wait(self, seconds: float) -> None:
        """
        Wait for a tick that is ``seconds`` of simulated time after the last one.

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
                    self._due = max(due, now - _LOOK_S)  # late: catch up only a little
                    return
                self._wake.wait(min(due - now, _LOOK_S))
