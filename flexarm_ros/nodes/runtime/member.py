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

"""The state of a participant, as the objects that it is made of share it."""

from __future__ import annotations

from typing import ClassVar, Protocol

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.status import Phase, StatusBoard
from flexarm_ros.nodes.runtime.process.supervisor import Supervisor
from flexarm_ros.nodes.runtime.topics.channels import Input, Output
from rclpy.node import Node

HOUSEKEEPING_S = 0.1
"""Wall time between polls of the peers during a run, s."""

JOIN_INTERVAL_S = 0.02
"""Wall time between polls of the peers before a run and during a reset, s."""


class SideInput(Protocol):
    """A subscription outside the per-tick topics."""

    def drain(self) -> None:
        """Discard the messages of the run before a reset."""


class SideOutput(Protocol):
    """A publisher outside the per-tick topics."""

    publisher: object

    def tell(self, ticks: int) -> None:
        """Publish a number of ticks."""


class Member:
    """
    State of a participant and the calls that its role may override.

    `flexarm_ros.nodes.runtime.participant.Participant` is the node.  `Phases`, `Waiting` and
    `Ending` take a `Member` and need nothing else of the node but ``get_logger``.
    """

    ROLE: ClassVar[str]
    config: RunConfig
    timeline: Timeline
    supervisor: Supervisor
    board: StatusBoard
    inputs: dict[str, Input]
    outputs: dict[str, Output]
    side_inputs: list[SideInput]
    side_outputs: list[SideOutput]
    look_interval: float = JOIN_INTERVAL_S
    """Wall time between polls of the peers, s."""
    tick: int = 0
    last_tick: int | None = None
    """Last tick of the run, once the plant has announced it."""
    finished: bool = False
    """Whether this node has left the run."""
    failure: RunFailed | None = None
    failed_run: bool = False
    """Whether the run has ended because the arm became unstable."""
    interrupted: int = 0
    """Number of requests to leave: signals, or the services of run control."""
    released: bool = False
    """Set by the launcher's SIGUSR1 while the plant waits at a tick of ``hold_at``."""
    crashed: str = ''
    """An exception in a service's callback, reported by the thread that serves them."""
    fast_ticks: int = 0
    """Number of ticks answered on the fast path (`flexarm_ros.nodes.runtime.fast_path`)."""
    invalid: int = 0
    """Number of rejected messages."""
    missing: str = ''
    """What a slow tick is waiting for, as text for ``/diagnostics``."""
    longest_wait_s: float = 0.0
    """Longest wall time without progress since the last report on ``/diagnostics``, s."""

    @property
    def under_way(self) -> bool:
        """Whether this node takes part in a run that has begun and has not ended."""
        return self.board.going

    @property
    def final_tick(self) -> int:
        """Return the last tick of the run: as announced by the plant, else as configured."""
        return self.timeline.ticks - 1 if self.last_tick is None else self.last_tick

    def change_phase(self, phase: Phase, **more: object) -> None:
        """Enter ``phase``; publish it to the peers and report it to the launcher."""
        self.board.publish(phase=phase, text=more.pop('text', phase.value), **more)
        self.supervisor.report(self.ROLE, phase=phase.value, text=self.board.mine.text)

    @property
    def present_tick(self) -> int:
        """The tick of this node, for any thread: ``tick`` stands still on the fast path."""
        return self.tick

    def return_soon(self) -> None:
        """Let the fast path return to Python before its next tick; from any thread."""

    # --- overridden by roles -----------------------------------------------------------

    def build(self) -> None:
        """Create the role's objects from ``self.config``, on which all nodes agree."""
        raise NotImplementedError

    def warm_up(self) -> None:
        """Call the role's objects once on a copy, so that all code is compiled before tick 0."""

    def check_start(self, now: float) -> None:
        """Start the run if this node may; called when it is ready."""
        raise NotImplementedError

    def check_end(self) -> None:
        """Leave the run if this node has completed its last tick."""
        raise NotImplementedError

    def waiting_for(self) -> tuple[str, str]:
        """Return the role whose message of ``self.tick`` is missing, and what is missing."""
        raise NotImplementedError

    def patience_s(self) -> float:
        """
        Return the wall time beyond the tick limit after which this node ends the run, s.

        The node next to the missing message reports first: the controller knows which sensor is
        silent, the plant only that there is no torque.
        """
        return 0.5

    def close(self) -> None:
        """Complete the role's files; called once, however the run ends."""

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError if the role cannot take a live parameter of ``config``."""

    def retune(self, config: RunConfig) -> None:
        """Take the live parameters of ``config``."""

    def take_priority(self, priority: int) -> None:
        """Follow the plant, which requests this SCHED_FIFO ``priority``, 0: none."""

    def further_diagnostics(self) -> dict[str, str]:
        """Return what this node reports on itself in addition to what every node does."""
        return {}

    # --- of the node ---------------------------------------------------------------------

    def make_endpoints(self) -> None:
        """Create the publishers and subscriptions of the configuration that do not exist yet."""
        raise NotImplementedError

    def interrupt(self) -> None:
        """Leave the run at the request of the user or the launcher."""
        raise NotImplementedError

    def invalid_message(self, topic: str, fault: str) -> None:
        """Count a rejected message; raises RunFailed if ``on_invalid`` is ``error``."""
        raise NotImplementedError


class MemberNode(Member, Node):
    """A `Member` that is a ROS node: for what needs the graph, publishers or parameters."""
