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
Run control as in simulators: pause, step, reset, speed, state.

The services are in the plant, which alone decides when a tick begins: ``~/pause``
(std_srvs/SetBool), ``~/step``, ``~/reset`` and ``~/state`` (std_srvs/Trigger).  The number of
ticks per step and the speed are the plant's parameters ``step_ticks`` and ``real_time_factor``.
If the package simulation_interfaces is installed, its standard services are offered too: see
`flexarm_ros.nodes.run_control.simulation_services`.

Services run on the thread of the parameter services; the lock-step loop reads their settings
between two ticks, under a lock.
"""

from __future__ import annotations

from collections.abc import Callable
import threading
import time
from typing import Any

from flexarm_ros.nodes.runtime.member import MemberNode
from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

WAIT_S = 60.0
"""Longest wall time of a service call."""

_HELD, _NOTABLE_S = 0.99, 0.05
"""A requested speed counts as held from this share on, or if the run is less late than this."""


class RunControl:
    """Requests of the services to the plant; `may_begin` is called before each tick."""

    def __init__(self, plant: MemberNode) -> None:
        self._plant = plant
        self._lock = threading.Lock()
        self.paused = bool(plant.get_parameter('start_paused').value)
        self._resting = False
        """Paused, and the last published tick has been answered and integrated."""
        self._steps = 0
        self.orders = 0
        """Number of pauses, resumes and resets so far."""
        self._reset_asked = False
        self.reset_wanted = False
        self.rtf = float(plant.get_parameter('real_time_factor').value or 0.0)
        self._anchor = (0.0, 0)
        plant.create_service(SetBool, '~/pause', self._pause)
        plant.create_service(Trigger, '~/step', self._step)
        plant.create_service(Trigger, '~/reset', self._reset)
        plant.create_service(Trigger, '~/state', self._state)
        plant.add_on_set_parameters_callback(self._changed)

    # --- called by the lock-step loop --------------------------------------------------

    def begin(self, tick: int) -> None:
        """Start timing by the wall clock at ``tick``."""
        self._anchor = (time.monotonic(), tick)

    def may_begin(self, tick: int) -> bool:
        """Whether ``tick`` may be published now: not paused, and due at the requested speed."""
        if self._reset_asked:
            # The previous tick is answered: no message of an external node is in transit.
            self.reset_wanted = True
            self._reset_asked = False
        if self.reset_wanted:
            return False
        if self.paused:
            with self._lock:
                self._resting = not self._steps
                if self._resting:
                    return False
                self._steps -= 1
            self.begin(tick)
            return True
        return self.rtf <= 0.0 or time.monotonic() >= self.due(tick)

    @property
    def unlimited(self) -> bool:
        """Whether ticks may begin as fast as possible."""
        return not (self.paused or self._reset_asked or self.reset_wanted or self.rtf > 0.0)

    def due(self, tick: int) -> float:
        """Return the wall time of ``tick`` at the requested speed."""
        start, first = self._anchor
        return start + (tick - first) * self.period_s() / self.rtf

    def period_s(self) -> float:
        """Return the control period, s."""
        return self._plant.timeline.period_ns * 1e-9

    def pace_s(self) -> float:
        """Return the wall time per tick at the requested speed, 0 without a limit."""
        return self.period_s() / self.rtf if self.rtf > 0.0 else 0.0

    def shortfall(self, tick: int) -> str:
        """Return a text if the speed up to ``tick`` is below the requested one; else empty."""
        start, first = self._anchor
        wall = time.monotonic() - start
        if self.paused or self.rtf <= 0.0 or tick <= first:
            return ''
        reached = (tick - first) * self.period_s() / wall
        late = wall - (tick - first) * self.pace_s()
        if reached >= _HELD * self.rtf or late < _NOTABLE_S:
            return ''
        return (
            f'{self.rtf:g} times real time could not be held: {reached:.3g} reached, '
            f'{late:.3g} s behind at tick {tick}'
        )

    def max_sleep_s(self, tick: int, now: float, longest: float) -> float:
        """Return how long the plant may sleep before the next check."""
        if self.paused or self.rtf <= 0.0:
            return min(longest, 0.01) if self.paused else longest
        return max(0.0, min(longest, self.due(tick) - now))

    # --- called by services --------------------------------------------------------------

    def pause(self, wanted: bool) -> None:
        """Pause the run before its next tick, or resume it."""
        with self._lock:
            self._resting = self._resting and wanted
            self.paused = wanted
            self._steps = 0
            self.orders += 1
            self.begin(self._plant.present_tick)
        self._plant.return_soon()

    def step(self, ticks: int) -> bool:
        """Let a paused run advance by ``ticks``; False if it is not paused."""
        with self._lock:
            if not self.paused:
                return False
            self._steps += ticks
            self._resting = False
        return True

    def reset(self) -> str:
        """Restart the run at tick 0; return when that is done, with the reason of a failure."""
        plant = self._plant
        if not self.going:
            return f'no run in progress ({plant.board.mine.phase.value})'
        self.orders += 1
        self._reset_asked = True
        plant.return_soon()
        if self._wait(lambda: not (self._reset_asked or self.reset_wanted) and self.going):
            return ''
        return f'not done within {WAIT_S:g} s, or the run has ended'

    def _wait(self, done: Callable[[], bool]) -> bool:
        """Wait on the services' thread, while the run continues, until ``done``."""
        deadline = time.monotonic() + WAIT_S
        while not done():
            if self._plant.finished or time.monotonic() > deadline:
                return False
            time.sleep(0.001)
        return True

    def finish_steps(self) -> bool:
        """Wait until the requested ticks are done; False if they cannot be."""
        return self._wait(lambda: not self.stepping)

    @property
    def over(self) -> bool:
        """Whether the plant has left its run."""
        return self._plant.finished

    def end(self) -> None:
        """End the run in order, as Ctrl-C does."""
        self._plant.interrupted += 1

    @property
    def going(self) -> bool:
        """Whether the plant is in a run, paused or not."""
        return not self._plant.finished and self._plant.under_way

    @property
    def stepping(self) -> bool:
        """Whether a paused run has ticks to finish: requested ones, or the one in progress."""
        return self.paused and not self._resting

    @property
    def steps_left(self) -> int:
        """Return the number of unfinished steps of a paused run, including one in progress."""
        with self._lock:
            return self._steps + (not self._resting)

    def _pause(self, request: Any, response: Any) -> Any:
        self.pause(bool(request.data))
        response.success, response.message = True, 'paused' if request.data else 'running'
        return response

    def _step(self, _: Any, response: Any) -> Any:
        ticks = int(self._plant.get_parameter('step_ticks').value or 1)
        response.success = self.step(ticks)
        response.message = f'{ticks} ticks' if response.success else 'not paused: pause first'
        return response

    def _reset(self, _: Any, response: Any) -> Any:
        problem = self.reset()
        response.success, response.message = not problem, problem or 'started again at tick 0'
        return response

    def _state(self, _: Any, response: Any) -> Any:
        response.success, response.message = True, self.describe()
        return response

    def describe(self) -> str:
        """Return the state in one line."""
        plant = self._plant
        word = plant.board.mine.phase.value
        if self.paused:
            word = 'stepping' if self.stepping else 'paused'
        speed = f'{self.rtf:g} times real time' if self.rtf > 0.0 else 'as fast as possible'
        return f'{word} at tick {plant.present_tick}, {speed}'

    def _changed(self, parameters: list[Parameter]) -> SetParametersResult:
        """Apply a new speed; rclpy has checked it against the declared range."""
        for parameter in parameters:
            if parameter.name == 'real_time_factor':
                self.rtf = float(parameter.value)
                self.begin(self._plant.present_tick)
                self._plant.return_soon()
        return SetParametersResult(successful=True)
