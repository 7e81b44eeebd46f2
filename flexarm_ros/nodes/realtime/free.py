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
The plant's side of a free-running run (``sync: free``): ticks by the wall clock.

Tick k is due at a time that follows from the first tick and the speed alone, so that delays do not
add up; the ticks after a late one catch up.  At the end of tick k the newest command that has
arrived is held over it: with all commands in time the run is that of lock-step, bit for bit.  The
newest force at the tip and payload are held likewise, if there are disturbances.  With drives the
command is theirs, ``actuator/torque``: its stamp is that of the state that the controller
answered.
"""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.core.parameters.sections import PlantParameters
from flexarm_ros.core.run.part import COMMAND
from flexarm_ros.core.run.results.real_time import LiveTiming, NO_COMMAND
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.realtime.command import CommandInput
from flexarm_ros.nodes.run_control.services import RunControl
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.topics.channels import Output, Values

RECORDER_WINDOW = 768
"""Maximum number of ticks ahead of the recorder, below the queue depth of the topics.

Larger than in lock-step, where it limits the loss in a crash: here a wait is a late tick.
"""


class FreeRun:
    """Counts and publishes the timing of the plant's ticks in a free-running run."""

    def __init__(
        self, parameters: PlantParameters, timeline: Timeline, control: RunControl,
        inputs: Sequence[CommandInput], applied: Sequence[Output], times: Output,
    ) -> None:  # fmt: skip
        """Take the newest of the ``inputs``, of which the torque is the first."""
        self._control, self._timeline = control, timeline
        self._command, *self._others = inputs
        self._applied, *self._others_applied = applied
        self._times = times
        self._hold = parameters.command_hold
        self._zero_after_loss = parameters.command_loss == 'zero'
        self.live = LiveTiming()
        self._zero: float | None = None
        self._begin = self._due = 0.0
        self._without, self._new = 0.0, False
        self.lost: str = ''
        """The missing message, while the torque is zero because no command has arrived."""

    def begin(self, tick: int, now: float) -> None:
        """Record the wall time at which ``tick`` begins."""
        control = self._control
        paced = control.rtf > 0.0 and not control.paused
        self._begin, self._due = now, min(now, control.due(tick)) if paced else now
        if self._zero is None:
            self._zero = self._due
        self.live.begun(tick, now, self._due, control.pace_s() or control.period_s())

    def poll(self, tick: int) -> None:
        """Read the commands that have arrived so far in ``tick``."""
        if self._command.poll(tick):
            self._new = True
            self.live.answered(self._command.tick, self._command.at)
        for entry in self._others:
            entry.poll(tick)

    def end(self, tick: int, now: float) -> list[Values]:
        """
        Return the values of each input that are held over ``tick``, which ends ``now``.

        Raises `RunFailed` if no command has arrived for too long.
        """
        command = self._command
        self.poll(tick)
        self.live.ended(tick, command.tick, self._new)
        self._without = 0.0 if self._new else self._without + self._lasted(now)
        if self._new:
            self.lost = ''
        self._new = False
        if self._without > self._hold:
            self._lose(tick)
        return [
            command.values if self._known else command.topic.nothing,
            *(entry.values or entry.topic.nothing for entry in self._others),
        ]

    def _lasted(self, now: float) -> float:
        """
        Return the time that a controller had for this tick, in simulated seconds.

        About 0 for a tick that catches up: this process was late, not the controller.
        """
        period = self._control.period_s()
        pace = self._control.pace_s() or period
        return min(now - self._begin, pace) * period / pace

    @property
    def _known(self) -> bool:
        return bool(self._command.values) and not self.lost

    def _lose(self, tick: int) -> None:
        name = self._command.topic.name
        way = '' if name == COMMAND else f', which follows {COMMAND},'
        owed = f'no torque on {name}{way} for {self._hold:g} s'
        if not self._zero_after_loss:
            raise RunFailed(self._command.source, f'tick {tick}: {owed}')
        self.lost = self.lost or f'{self._command.source}: tick {tick}: {owed}: zero torque'

    def tell(self, tick: int, held: Sequence[Values]) -> None:
        """Publish what was ``held`` over ``tick`` and the times of the tick, for the recorder."""
        command, timeline, zero = self._command, self._timeline, self._zero or 0.0
        known = self._known
        stamp = timeline.stamp_ns(command.tick) if known else 0
        at = command.at - zero if known else NO_COMMAND
        self._applied.send(stamp, *held[0])
        for entry, output, values in zip(
            self._others, self._others_applied, held[1:], strict=True
        ):
            output.send(timeline.stamp_ns(entry.tick) if entry.values else 0, *values)
        self._times.send(timeline.stamp_ns(tick), self._begin - zero, self._due - zero, at)
