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
The standard action SimulateSteps: ticks of a paused run, with feedback and cancellation.

``execute`` is a coroutine on the services' thread, which serves other requests, such as a cancel
request, between two checks of the run.
"""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

if TYPE_CHECKING:
    from flexarm_ros.nodes.run_control.services import RunControl

NAME = 'simulate_steps'
_LOOK_S = 0.005
"""Wall time between two checks of the run."""


class StepAction:
    """``kind`` is SimulateSteps, ``codes`` the package's Result."""

    def __init__(self, node: Node, control: RunControl, kind: Any, codes: Any) -> None:
        self._node, self._control = node, control
        self._kind, self._codes = kind, codes
        self._busy = False
        self._look: Future | None = None
        self.server = ActionServer(
            node, kind, NAME, self.execute, goal_callback=self.accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )  # fmt: skip

    def accept(self, _: Any) -> GoalResponse:
        """Accept one goal at a time."""
        if self._busy:
            return GoalResponse.REJECT
        self._busy = True
        return GoalResponse.ACCEPT

    async def execute(self, goal: Any) -> Any:
        """Execute the steps; return the result with any error."""
        # Not the node's own clock: simulated time stands still while the run is paused.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self._node.create_timer(_LOOK_S, self._wake, clock=steady)
        try:
            problem = await self._follow(goal, int(goal.request.steps))
        finally:
            self._node.destroy_timer(timer)
            self._busy = False
        result = self._kind.Result()
        result.result.error_message = problem
        result.result.result = self._codes.RESULT_OK
        if problem:
            result.result.result = self._codes.RESULT_OPERATION_FAILED
        if not problem:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result

    async def _follow(self, goal: Any, steps: int) -> str:
        control, reported = self._control, 0
        if not control.step(steps):
            return 'not paused: pause first'
        order = control.orders
        while True:
            done = max(0, steps - control.steps_left)
            if order != control.orders:
                return f'another request came after {reported} steps'
            for count in range(reported + 1, done + 1):
                reported = count
                self._tell(goal, count, steps - count)
            if reported >= steps:
                return ''
            if control.over:
                return f'the run ended after {reported} steps'
            if goal.is_cancel_requested:
                control.pause(True)
                return f'cancelled after {reported} steps'
            self._look = Future()
            await self._look

    def _wake(self) -> None:
        if self._look is not None and not self._look.done():
            self._look.set_result(None)

    def _tell(self, goal: Any, done: int, left: int) -> None:
        feedback = self._kind.Feedback()
        feedback.completed_steps, feedback.remaining_steps = done, left
        goal.publish_feedback(feedback)
