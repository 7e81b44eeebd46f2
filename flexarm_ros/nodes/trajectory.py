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

"""Node ``trajectory``: the commanded position and velocity of the end effector."""

from __future__ import annotations

import math
from typing import Any, ClassVar

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.trajectory import Reference
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.progress import ProgressInput
from flexarm_ros.nodes.runtime.topics.graph import TICK_EVERY, TICK_TOPIC
from flexarm_ros.wire.fused_step import reference_step

AHEAD = 64
"""Maximum number of ticks that the reference is published ahead of the plant.

It depends on time alone and need not be on the critical path of a tick: this node wakes up every
`graph.TICK_EVERY` ticks.
"""

BURST = TICK_EVERY + 2
"""Maximum number of references per report of the plant, while it does not wait for them.

The default queue of a ROS 2 subscription, and of `ros2 bag record`, holds 10 messages.
"""


def ahead_until(reached: int, published: int, ticks: int) -> int:
    """
    Return the tick up to which references are published, at most ``ticks``.

    ``reached`` is the plant's tick, ``published`` the first unpublished one.  The lead grows by
    ``BURST - TICK_EVERY`` per report; the references that the plant needs before its next report
    are always published.
    """
    until = max(reached + BURST, min(reached + AHEAD, published + BURST))
    return min(until, ticks)


class TrajectoryNode(Participant):
    """Publishes the reference of each tick, ahead of the plant."""

    ROLE: ClassVar[str] = 'trajectory'

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._reached = ProgressInput(
            self, self.membership, TICK_TOPIC, 'plant', most=lambda: self.timeline.ticks
        )
        self.side_inputs.append(self._reached)

    def build(self) -> None:
        """Create the reference."""
        self._reference = Reference(self.config)
        self._output = self.outputs['reference']
        self._prepare()

    def _prepare(self) -> None:
        """Prepare the fast path for the present delay."""
        self.fast = None
        step = None
        if self.alone:  # composed nodes hand over values
            step = reference_step(self._reference, self._output.topic, self.timeline.period_ns)
        if step is not None:
            self.fast = FastPath(step, [], [self._output.publisher.handle])

    def warm_up(self) -> None:
        """Compute one reference."""
        self._reference.command(0)

    def check_start(self, now: float) -> None:
        """Start when all nodes are ready: one in a reset would discard the first messages."""
        if self.membership.all_ready(self.epochs.number):
            self.start()
        else:
            self.waiting.check_ready(now - 1.0)  # the plant reports first

    def retune(self, config: RunConfig) -> None:
        """Apply the delay from the first unpublished tick on."""
        self._reference.retune(config)
        self._prepare()

    def advance(self) -> bool:
        """Publish references up to `AHEAD` ticks beyond the plant's, when it reports progress."""
        before, news = self._reached.ticks, self._reached.update()
        if self._reached.ticks == before < self.tick:
            return news  # woken by something else: one burst for each report of the plant
        until = ahead_until(self._reached.ticks, self.tick, self.timeline.ticks)
        if self.tick >= until:
            return news
        if self.fast is not None and self.fast.run is not None:
            self.tick = self.fast.run(self.tick, until)
        for tick in range(self.tick, until):
            self._output.send(self.timeline.stamp_ns(tick), *self._reference.command(tick))
        self.tick = until
        return True

    def check_end(self) -> None:
        """Leave when the plant has: the last references are published long before the end."""
        if self.last_tick is not None:
            self.ending.finish()

    def blocked_on(self) -> list[Any]:
        """Wait for the plant's progress."""
        return [self._reached.handle] if self.under_way else super().blocked_on()

    def waiting_for(self) -> tuple[str, str]:
        """Return the plant if it has left the graph without a final status."""
        return ('', '') if self._plant_there() else ('plant', f'no message on {TICK_TOPIC}')

    def patience_s(self) -> float:
        """No limit while the plant is alive: this node waits for progress, not for a message."""
        return math.inf if self._plant_there() else 0.5

    def _plant_there(self) -> bool:
        return bool(self._reached.handle.get_publisher_count())
