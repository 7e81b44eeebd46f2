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

"""Node ``plant``: integrates the arm and publishes the clock of the run."""

from __future__ import annotations

from collections.abc import Sequence
import copy
from typing import Any, ClassVar

from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.nodes.run_control.services import RunControl
from flexarm_ros.nodes.run_control.simulation_services import offer_standard_services
from flexarm_ros.nodes.runtime.joining.status import Phase
from flexarm_ros.nodes.runtime.parameters.own import how_to_go_on
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.progress import ProgressInput, ProgressOutput
from flexarm_ros.nodes.runtime.topics.graph import RECORDED_TOPIC, TICK_EVERY, TICK_TOPIC

RECORDER_WINDOW = 256
"""Maximum number of ticks ahead of the recorder, well below the queue depth of the topics."""

_RECORDER_WINDOW_NS = 250_000_000
"""The same in simulated time: with chunks of 0.2 s a killed recorder loses at most 0.5 s."""
_LEAST_WINDOW = 16


def recorder_window(period_ns: int) -> int:
    """Return the maximum number of ticks of ``period_ns`` ahead of the recorder."""
    return min(RECORDER_WINDOW, max(_LEAST_WINDOW, _RECORDER_WINDOW_NS // period_ns))


class PlantNode(Participant):
    """Publishes ``/clock`` and the state of tick k, waits for the torque, integrates."""

    ROLE: ClassVar[str] = 'plant'

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._recorded = ProgressInput(
            self, self.membership, RECORDED_TOPIC, 'recorder', most=lambda: self.tick + 1
        )
        self._reached = ProgressOutput(self, TICK_TOPIC)
        self.side_inputs.append(self._recorded)
        self.side_outputs.append(self._reached)
        holds = str(self.get_parameter('hold_at').value or '')
        self._holds = sorted(int(text) for text in holds.split(',') if text.strip())
        self._sent = False
        self._free = self.again = self.config.run.sync == 'free'
        self.control = RunControl(self)
        self.standard = offer_standard_services(self, self.control)
        if self._free and self.control.rtf == 0.0:
            self.control.rtf = 1.0

    def build(self) -> None:
        """Create the arm at its initial state."""
        self.plant = make_plant(self.config)
        self._command = self.inputs['joint_command']
        self._time = self.outputs['/clock']
        self._state = self.outputs['plant/state']
        self._missing = self._command
        self._window = recorder_window(self.timeline.period_ns)
        self._sent = False
        self._reported_hold = False

    def warm_up(self) -> None:
        """Integrate one step of a copy."""
        copy.deepcopy(self.plant).step(0.0, 0.0)

    def check_start(self, now: float) -> None:
        """Start when every participant is ready."""
        if self.membership.all_ready(self.epochs.number):
            self.control.begin(0)
            self._tell(Phase.PAUSED if self.control.paused else Phase.RUNNING)
            if self.control.paused:
                go_on = how_to_go_on(self.get_fully_qualified_name())
                self.get_logger().info(f'paused before tick 0; to start: {go_on}')
        else:
            self.waiting.check_ready(now)

    def advance(self) -> bool:
        """Integrate with the torque for the last published state, then publish the next state."""
        if self._free:
            return self._advance_free()
        answered = self._sent
        if answered:
            if not self.have(self._command):
                return False
            self._sent = False
            if self.tick + 1 >= self.timeline.ticks:
                self.tick += 1
                self.ending.finish()
                return False
            if not self._integrate(self._command.values):
                return False
        if self._held():
            return answered
        self._send()
        self._sent = True
        return True

    def _integrate(self, torque: Sequence[float]) -> bool:
        """Integrate to the next tick with constant torque; False if the arm is unstable there."""
        self.plant.step(torque[0], torque[1])
        trouble = instability(self.plant)
        if trouble:
            self._end_unstable(trouble)
            return False
        self.tick += 1
        return True

    def _advance_free(self) -> bool:
        """Follow the wall clock with the newest torque received, without waiting for one."""
        while self._command.tick < self.tick and self._command.fetch(self._command.tick + 1):
            pass
        last = self.timeline.ticks - 1
        if self.tick > last:
            if self._command.tick >= last:
                self.ending.finish()
            return False
        if self._held():
            return False
        self._send()
        if self.tick == last:
            self.tick += 1
            return True
        return self._integrate(self._command.values or (0.0, 0.0))

    def _send(self) -> None:
        if self.tick % TICK_EVERY == 0:
            self._reached.tell(self.tick)
        stamp = self.timeline.stamp_ns(self.tick)
        plant = self.plant
        d1, d2, rate1, rate2 = plant.deflections()
        self._state.send(stamp, *plant.q.tolist(), d1, d2, *plant.qd.tolist(), rate1, rate2)
        if self._time.topic.due(self.tick):
            self._time.send(stamp)

    def _held(self) -> bool:
        """Whether the next tick must wait for the launcher, the recorder or the wall clock."""
        if self._holds and self.tick >= self._holds[0]:
            return self._held_by_launcher()
        return self._ahead_of_recorder(self._window) or not self.control.may_begin(self.tick)

    def _ahead_of_recorder(self, ticks: int) -> bool:
        """Whether at least ``ticks`` published ticks are not recorded yet."""
        if not self.config.run.record or self.tick - self._recorded.ticks < ticks:
            return False
        self._recorded.update()
        return self.tick - self._recorded.ticks >= ticks

    def _held_by_launcher(self) -> bool:
        """Report the tick once, then wait for the launcher's SIGUSR1."""
        if not self._reported_hold:
            if self._ahead_of_recorder(1):
                return True  # all messages are recorded before the launcher acts on a node
            self._reported_hold = True
            self.released = False
            self.supervisor.report(self.ROLE, phase='held', tick=self.tick)
        self.waiting.restart()
        if not self.released:
            return True
        self._reported_hold = False
        self._holds.pop(0)
        return bool(self._holds) and self.tick >= self._holds[0]

    def _tell(self, phase: Phase) -> None:
        """Publish the phase and the intended wall time per tick."""
        extra = self.epochs.extra(pace_s=repr(self.control.pace_s()))
        self.change_phase(phase, extra=extra)

    def poll_peers(self, now: float) -> None:
        """Execute requests of the services, then act as every participant."""
        if not self.finished and self.under_way:
            if self.control.reset_wanted:
                self.phases.begin_epoch()
                self.control.reset_wanted = False
            elif self.control.paused != (self.board.mine.phase is Phase.PAUSED):
                self._tell(Phase.PAUSED if self.control.paused else Phase.RUNNING)
        super().poll_peers(now)

    def max_sleep_s(self, now: float) -> float:
        """Return the time until the next tick is due, at most."""
        if self._holds and self.tick >= self._holds[0]:
            return 0.002
        longest = super().max_sleep_s(now)
        if self._sent or not self.under_way:
            return longest
        return self.control.max_sleep_s(self.tick, now, longest)

    def blocked_on(self) -> list[Any]:
        """Wait for the torque, or for the recorder's progress if too far ahead of it."""
        if self._sent or not self.under_way:
            return super().blocked_on()
        return [self._recorded.handle] if self._ahead_of_recorder(self._window) else []

    def waiting_for(self) -> tuple[str, str]:
        """Return the recorder if the plant waits for it, else the controller."""
        if not self._sent:
            return 'recorder', 'nothing recorded'
        return 'controller', 'no torque on joint_command'

    def patience_s(self) -> float:
        """Wait 0.25 s for the controller's diagnosis; report a stalled recorder at once."""
        return 0.25 if self._sent else 0.0

    def _end_unstable(self, trouble: str) -> None:
        """End the run at this tick, which the peers complete and record."""
        self.get_logger().error(f'unstable at tick {self.tick + 1}: {trouble}')
        self.supervisor.report(self.ROLE, phase='unstable', tick=self.tick + 1, text=trouble)
        self.failed_run = True
        self.end_at(self.tick, f'unstable: {trouble}', unstable=trouble)

    def end_at(self, tick: int, why: str, **extra: str) -> None:
        """End the run with ``tick`` as its last tick."""
        self.last_tick = tick
        self.finished = True
        self.change_phase(Phase.DONE, text=why, last_tick=tick, extra=self.epochs.extra(**extra))
        self.ending.flush()
        self.board.flush(1.0)

    def interrupt(self) -> None:
        """End the run in order: the published tick is the last."""
        if self.supervisor.gone or self.board.mine.phase is not Phase.RUNNING:
            super().interrupt()
        elif self._sent and self.interrupted < 2:
            if not self._command.fetch(self.tick):
                return  # its torque is in transit; the tick limit applies
            self.end_at(self.tick, 'interrupted')
        else:
            self.end_at(self.tick - 1, 'interrupted')
