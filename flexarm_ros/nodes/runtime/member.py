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

"""What the parts of a participant know of the node that they are parts of."""

from __future__ import annotations

from typing import ClassVar

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.joining.status import StatusBoard
from flexarm_ros.nodes.runtime.topics.channels import Input, Output
from rclpy.node import Node

HOUSEKEEPING_S = 0.1
"""Wall time between looks at the peers while a run goes on."""


class Member(Node):
    """
    A node with a role in a run: its scenario, its topics, and how far it is.

    `flexarm_ros.nodes.runtime.participant.Participant` is the one that flies.
    """

    ROLE: ClassVar[str]
    config: RunConfig
    timeline: Timeline
    board: StatusBoard
    inputs: dict[str, Input]
    outputs: dict[str, Output]
    tick: int
    last_tick: int | None
    """Last tick of the run, once the plant has told it."""
    finished: bool
    interrupted: int
    """How often somebody has asked this node to leave."""
    failed_run: bool
    invalid: int
    """Messages rejected so far."""
    missing: str
    """What a tick that takes long is waiting for, for people; set by the lock-step loop."""
    longest_wait_s: float
    """Longest wall time without progress since somebody set this to zero."""

    @property
    def under_way(self) -> bool:
        """Whether this node takes part in a run that has begun and goes on."""
        return self.board.going

    def invalid_message(self, topic: str, fault: str) -> None:
        """Count a message that is none of the run's; `RunFailed` where that ends the run."""
        raise NotImplementedError

    def check_live(self, config: RunConfig) -> None:
        """Raise ValueError where this node's part cannot take a live parameter of ``config``."""

    def retune(self, config: RunConfig) -> None:
        """Let this node's part of the core take the live parameters of ``config``."""
