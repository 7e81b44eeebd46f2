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
from itertools import chain
import time
from typing import Any, ClassVar

from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.required_parts import PLANT_VALUES, PlantPart
from flexarm_ros.core.run.results.real_time import flat, shown
from flexarm_ros.core.run.rig_parts import PAYLOAD
from flexarm_ros.nodes.realtime.command import CommandInput
from flexarm_ros.nodes.realtime.free import FreeRun
from flexarm_ros.nodes.realtime.free import RECORDER_WINDOW as RECORDER_WINDOW_FREE
from flexarm_ros.nodes.realtime.system import ask, SYSTEM_KEYS
from flexarm_ros.nodes.run_control.services import RunControl
from flexarm_ros.nodes.run_control.simulation_services import offer_standard_services
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.joining.status import Phase, PRIORITY
from flexarm_ros.nodes.runtime.parameters.own import how_to_go_on
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.progress import ProgressInput, ProgressOutput
from flexarm_ros.nodes.runtime.topics.channels import Input, Output
from flexarm_ros.nodes.runtime.topics.endpoints import Waiter
from flexarm_ros.nodes.runtime.topics.graph import RECORDED_TOPIC, TICK_EVERY, TICK_TOPIC
from flexarm_ros.wire.fused_step import compile_loop, plant_step, PlantStep, SENT, UNSTABLE
from flexarm_ros.wire.topics import applied, per_tick_topics, TIMING, Topic

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
        self.again = self.config.run.sync == 'free'
        self._free: FreeRun | None = None
        self._asked, self._told, self._said_lost = False, 0.0, ''
        self.epochs.constant[PRIORITY] = str(self.get_parameter('realtime_priority').value)
        self.board.publish(extra=dict(self.epochs.constant))
        self.control = RunControl(self)
        self.standard = offer_standard_services(self, self.control)
        if self.again and self.control.rtf == 0.0:
            self.control.rtf = 1.0

    def make_endpoints(self) -> None:
        """Create the endpoints; a free-running run has more, for the inputs that were held."""
        super().make_endpoints()
        for topic in self.inputs.copy().values():
            name = topic.topic.recorded_from
            if name and name not in self.outputs:
                self.outputs[name] = Output(self, applied(topic.topic))

    def make_input(self, topic: Topic) -> Input:
        """Return the input of a topic; that of a free-running run takes the newest."""
        kind = CommandInput if topic.recorded_from else Input
        return kind(self, topic, self.invalid_message)

    def build(self) -> None:
        """Create the arm at its initial state."""
        self.plant: Any = make_plant(self.config)
        self._read = [self.inputs[name] for name in PlantPart.reads(self.config)]
        self._command = self._read[0]
        self._time = self.outputs['/clock']
        self._state = self.outputs['plant/state']
        self._further = [
            (self.outputs[s.name], PLANT_VALUES[s.name])
            for s in PlantPart.further_signals(self.config)
        ]
        self._missing = self._command
        self._window = recorder_window(self.timeline.period_ns)
        self._free = self._free_run()
        self._fused: PlantStep | None = None
        if self.alone:
            topics = per_tick_topics(self.config)
            self._fused = plant_step(self.plant, self.config, topics, TICK_EVERY)
            if self._fused is not None:
                compile_loop(self._fused)
        self.fast = None
        self._sent = self._behind = False
        self._reported_hold = False

    def _free_run(self) -> FreeRun | None:
        inputs = [entry for entry in self._read if isinstance(entry, CommandInput)]
        if not inputs:
            return None
        self._window = RECORDER_WINDOW_FREE
        outputs = [self.outputs[entry.topic.recorded_from] for entry in inputs]
        for entry, output in zip(inputs, outputs, strict=True):
            output.configure(applied(entry.topic), self.timeline)
        return FreeRun(
            self.config.plant, self.timeline, self.control, inputs, outputs, self.outputs[TIMING]
        )

    def warm_up(self) -> None:
        """Integrate one step of a copy, after a grasp if the payload varies."""
        plant = copy.deepcopy(self.plant)
        if PAYLOAD in self.inputs:
            plant.disturb(0.0, 0.0, self.config.plant.payload_mass + 1.0)
        plant.step(0.0, 0.0)
        instability(plant)

    def check_start(self, now: float) -> None:
        """Start when every participant is ready."""
        if self.membership.all_ready(self.epochs.number):
            if self._free is not None:
                self._ask_system()
            self._tell(Phase.PAUSED if self.control.paused else Phase.RUNNING)
            self.control.begin(0)
            if self.control.paused:
                go_on = how_to_go_on(self.get_fully_qualified_name())
                self.get_logger().info(f'paused before tick 0; to start: {go_on}')
        else:
            self.waiting.check_ready(now)

    def _ask_system(self) -> None:
        """Request real-time scheduling of the system, once, and report what was granted."""
        if self._asked:
            return
        self._asked = True
        pace = (self.get_parameter(key).value for key in SYSTEM_KEYS)
        said = '; '.join(ask(*pace))
        self.get_logger().info(f'real time: {said}')
        self.supervisor.report(self.ROLE, remark=f'real time: {said}')

    def advance(self) -> bool:
        """Integrate with the torque for the last published state, then publish the next state."""
        if self._free is not None:
            return self._advance_free(self._free)
        answered = self._sent
        if answered:
            if not self.have(*self._read):
                return False
            self._sent = False
            if self.tick + 1 >= self.timeline.ticks:
                self.tick += 1
                self._finish()
                return False
            if not self._integrate([entry.values for entry in self._read]):
                return False
        if self._held(self.tick):
            return answered
        self._send()
        self._sent = True
        return True

    def advance_fast(self, waiter: Waiter, until: float) -> None:
        """Integrate and publish by the fused step."""
        if self._fused is None or not self._sent:
            return
        if self.fast is None:
            publishers = (each.publisher for each in (self._reached, self._state, self._time))
            handles = [publisher.handle for publisher in publishers]
            self.fast = FastPath(self._fused, self._read, handles, waiter)
        while self._run_fused(self.fast, self._fused, until) and time.monotonic() < until:
            pass

    def _run_fused(self, fast: FastPath, fused: PlantStep, until: float) -> bool:
        """Integrate and publish up to a tick that is left to Python; whether it is published."""
        if self.tick >= self.final_tick or not fast.enter(self.tick, self.waiting.since, until):
            return False
        self.tick, end = fast.run(self.tick, self._bound())
        self._sent = end >= SENT
        self.plant.set_state(self.plant.q, self.plant.qd)  # and the deflections with it
        fast.leave(self.tick + (end == UNSTABLE), self.waiting)
        if end == UNSTABLE:
            self._end_unstable(instability(self.plant) or '')
        elif end > SENT:
            self._send_again(end, fused)
        elif not self._sent and not self._held(self.tick):
            self._send()
            self._sent = True
            return True
        return False

    def _bound(self) -> int:
        """Return the tick that the fast path integrates to, which it leaves to Python."""
        if self.live.waiting or not self.control.unlimited:
            return self.tick + 1
        ticks = [self.final_tick, *self._holds[:1]]
        if self.config.run.record:
            ticks.append(self._recorded.ticks + self._window)
        return max(self.tick + 1, min(ticks))

    def _send_again(self, failed: int, fused: PlantStep) -> None:
        """Publish by rclpy, which raises the reason, what `send_state` has not; see there."""
        tick, (_, state, clock) = self.tick, fused.outputs
        if failed == 1:
            self._reached.tell(tick)
        if failed <= 2:
            self._state.publish(state.bytes())
        if self._time.topic.due(tick):
            self._time.publish(clock.bytes())

    def _integrate(self, held: Sequence[Sequence[float]]) -> bool:
        """Integrate to the next tick with constant inputs; False if the arm is unstable there."""
        trouble = self._step(held)
        if trouble:
            self._end_unstable(trouble)
            return False
        self.tick += 1
        return True

    def _step(self, held: Sequence[Sequence[float]]) -> str:
        """
        Integrate over a tick with torque and force; return the reason of instability after it.

        Empty if the arm is stable.
        """
        if len(held) > 1:
            self._disturb(held[1:])
        self.plant.step(*held[0])
        return instability(self.plant) or ''

    def _disturb(self, held: Sequence[Sequence[float]]) -> None:
        try:
            self.plant.disturb(*chain.from_iterable(held))
        except ValueError as error:
            raise RunFailed(self._read[-1].source, f'tick {self.tick}: {error}') from None

    def _advance_free(self, free: FreeRun) -> bool:
        """Begin the next tick if it is due, with the newest inputs held over the last one."""
        if self._sent:
            free.poll(self.tick)
        if self._held(self._following):
            return False
        now = time.monotonic()
        if not self._sent:
            if not self.control.paused:
                self.control.begin(self.tick)  # all deadlines count from the first tick
            now = time.monotonic()
            self._send()
            self._sent = True
        else:
            held = free.end(self.tick, now)
            last = self._following == self.timeline.ticks
            trouble = '' if last else self._step(held)
            if trouble or last:
                free.tell(self.tick, held)
                self._end_free(trouble)
                return False
            self.tick += 1
            self._send()  # messages that other nodes wait for come first
            free.tell(self.tick - 1, held)
        free.begin(self.tick, now)
        return True

    def _end_free(self, trouble: str) -> None:
        if trouble:
            self._end_unstable(trouble)
        else:
            self.tick += 1
            self._finish()

    @property
    def _following(self) -> int:
        """Return the tick to publish next; in lock-step the last one must be answered."""
        return self.tick + (self._sent and self._free is not None)

    def _send(self) -> None:
        if self.tick % TICK_EVERY == 0:
            self._reached.tell(self.tick)
        stamp = self.timeline.stamp_ns(self.tick)
        plant = self.plant
        d1, d2, rate1, rate2 = plant.deflections()
        for output, values in self._further:
            output.send(stamp, *values(plant))
        self._state.send(stamp, *plant.q.tolist(), d1, d2, *plant.qd.tolist(), rate1, rate2)
        if self._time.topic.due(self.tick):
            self._time.send(stamp)

    def _held(self, tick: int) -> bool:
        """Whether ``tick`` must wait for the launcher, the recorder or the wall clock."""
        if self._holds and tick >= self._holds[0]:
            return self._held_by_launcher()
        self._behind = self._ahead_of_recorder(self._window)
        return self._behind or not self.control.may_begin(tick)

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

    def _finish(self) -> None:
        """Leave a run that is complete; report if the requested speed could not be held."""
        if self._free is not None:
            self._tell_loss(self._free)
        if shortfall := self.control.shortfall(self.tick):
            self._remark(shortfall)
        self.ending.finish()

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
        if self._free is not None:
            self._tell_loss(self._free)
            self.missing = self.missing or self._free.lost
            if now - self._told >= 1.0:
                self._told = now
                self.supervisor.report(self.ROLE, timing=shown(self._free.live.values()))

    def _tell_loss(self, free: FreeRun) -> None:
        if free.lost != self._said_lost:
            self._said_lost = free.lost
            self._remark(free.lost or 'torques arrive again')

    def _remark(self, text: str) -> None:
        """Log a remark and report it to the launcher."""
        self.get_logger().warning(text)
        self.supervisor.report(self.ROLE, remark=text)

    def further_diagnostics(self) -> dict[str, str]:
        """Return the timing of a free-running run so far."""
        return {} if self._free is None else flat(self._free.live.values())

    def max_sleep_s(self, now: float) -> float:
        """Return the time until the next tick is due, at most."""
        if self._holds and self._following >= self._holds[0]:
            return 0.002
        longest = super().max_sleep_s(now)
        if not self.under_way or (self._sent and self._free is None):
            return longest
        if self._behind:
            return longest  # the recorder's progress wakes this node
        return self.control.max_sleep_s(self._following, now, longest)

    def blocked_on(self) -> list[Any]:
        """Wait for the torque, or for the recorder's progress if too far ahead of it."""
        if not self.under_way or (self._sent and self._free is None):
            return super().blocked_on()
        return [self._recorded.handle] if self._behind else []

    def waiting_for(self) -> tuple[str, str]:
        """Return the recorder if the plant waits for it, else the controller."""
        if not self._sent or self._free is not None:
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
        elif self._sent and self._free is not None:
            self._free.tell(self.tick, self._free.end(self.tick, time.monotonic()))
            self.end_at(self.tick, 'interrupted')
        elif self._sent and self.interrupted < 2:
            if not self._command.fetch(self.tick):
                return  # its torque is in transit; the tick limit applies
            self.end_at(self.tick, 'interrupted')
        else:
            self.end_at(self.tick - 1, 'interrupted')
