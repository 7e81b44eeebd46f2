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

"""The closed loop in one process, in the lock-step order of the nodes."""

from __future__ import annotations

from typing import Any, NamedTuple

from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.changes import Agenda
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.answers import Answers
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.part import COMMAND, JOINT_STATES, REFERENCE, TIP
from flexarm_ros.core.run.parts import place
from flexarm_ros.core.run.required_parts import ControllerPart, PLANT_VALUES, PlantPart
from flexarm_ros.core.run.state import Four, State
from flexarm_ros.core.sensing.sensors import Measurement
from flexarm_ros.core.timeline import Timeline

_ENCODER, _TIP, _REFERENCE, _COMMAND = map(place, (JOINT_STATES, TIP, REFERENCE, COMMAND))


class TickRecord(NamedTuple):
    """
    The messages of one tick.

    ``messages``: see `flexarm_ros.core.run.answers.Answers`; ``gain``: lambda, or nan.  The
    state's arrays are the plant's own and valid until the next tick.
    """

    k: int
    state: State
    messages: tuple[Any, ...]
    gain: float

    @property
    def q(self) -> FloatArray:
        """Return the plant's coordinates, shape ``(n,)``."""
        return self.state.q

    @property
    def qd(self) -> FloatArray:
        """Return the rates of the plant's coordinates, shape ``(n,)``."""
        return self.state.qd

    @property
    def deflections(self) -> Four:
        """Return delta1, delta2 (m) and their rates (m/s)."""
        return self.state.ends

    @property
    def encoder(self) -> Measurement:
        """Return stamp_ns, angles, rates."""
        return self.messages[_ENCODER]  # type: ignore[no-any-return]

    @property
    def tip(self) -> Measurement:
        """Return stamp_ns, x, y, vx, vy of the sensed point."""
        return self.messages[_TIP]  # type: ignore[no-any-return]

    @property
    def reference(self) -> Four:
        """Return x, y, vx, vy as commanded."""
        return self.messages[_REFERENCE]  # type: ignore[no-any-return]

    @property
    def torque(self) -> tuple[float, float]:
        """Return tau1, tau2, N m."""
        return self.messages[_COMMAND]  # type: ignore[no-any-return]


class ClosedLoop:
    """
    Plant, sensors, trajectory and controller of one scenario.

    Tick k: the plant's state at t_k; sensors and trajectory answer for it; the
    controller answers them; the torque is held until t_k+1.  The state after
    the last tick is not computed, since nothing records it.

    After the run ``unstable`` is ``None``, or names the quantity that exceeded its limit, and
    ``unstable_tick`` the tick of that state, which is not part of the run.  A torque that is not
    finite ends the run after its tick; ``unstable`` then names law and tick.
    """

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.timeline = Timeline.of(config.run)
        self.plant = make_plant(config)
        self.answers = Answers(config)
        controller = self.answers.parts[ControllerPart.NAME]
        assert isinstance(controller, ControllerPart)
        self._controller, self.law = controller, controller.law
        self._fault = controller.fault
        self._tick = self.answers.tick
        self._ticks = self.timeline.ticks
        self._agenda = Agenda(config.changes)
        self.k = 0
        self.unstable: str | None = None
        self.unstable_tick: int | None = None
        self.torque: tuple[float, float] | None = None
        """That of the last tick."""
        places, inputs = self.answers.places, PlantPart.reads(config)
        self._last = self.answers.messages
        self._applied = places[inputs[0]] if inputs[0] != COMMAND else None
        self._disturbances = [places[name] for name in inputs[1:]]
        self._further = [
            (places[s.name], PLANT_VALUES[s.name]) for s in PlantPart.further_signals(config)
        ]

    def tick(self) -> TickRecord | None:
        """Run the next tick; ``None`` if the run has ended or the arm is unstable."""
        plant: Any = self.plant
        k = self.k
        if k >= self._ticks or self.unstable is not None:
            return None
        if self.torque is not None:
            if self._disturbances:
                plant.disturb(*[value for i in self._disturbances for value in self._last[i]])
            plant.step(*(self.torque if self._applied is None else self._last[self._applied]))
        trouble = instability(plant)
        if trouble is not None:
            self._end_unstable(trouble)
            return None
        if k >= self._agenda.next:
            self._retune(k)
        state = State(plant.q, plant.qd, plant.deflections())
        for index, values in self._further:
            self.answers.tell(index, tuple(values(plant)))
        messages = self._tick(k, state)
        self.torque = messages[_COMMAND]
        self._end_tick(k)
        # A call of the class takes twice as long.
        return tuple.__new__(TickRecord, (k, state, messages, self.law.gain))

    def begin_block(self, most: int) -> int:
        """Take the changes due now; return how many ticks, at most ``most``, have no other."""
        if self.unstable is not None:
            return 0
        if self.k >= self._agenda.next:
            self._retune(self.k)
        return int(min(most, self._ticks - self.k, self._agenda.next - self.k))

    def end_block(self, done: int, count: int) -> None:
        """
        Go on to the state after ``done`` of ``count`` ticks, which the kernel has run.

        With ``done`` less than ``count`` one of them ended the run.
        """
        if done:
            self._end_tick(self.k + done - 1)
        if done < count and self.unstable is None:
            trouble = instability(self.plant)
            if trouble is not None:
                self._end_unstable(trouble)

    def _end_unstable(self, trouble: str) -> None:
        """End the run with the present state, which is not part of it."""
        self.unstable, self.unstable_tick = trouble, self.k

    def _end_tick(self, k: int) -> None:
        """Go on to the next tick, and note a torque that ends the run."""
        self.k = k + 1
        fault = self._fault(k, self.torque)
        if fault is not None:
            self.unstable = f'{self._controller.title}: {fault}'
            self.unstable_tick = self.k

    def _retune(self, k: int) -> None:
        """Apply the parameter changes of tick ``k``: see ``RunConfig.changes``."""
        for change in self._agenda.due(k):
            self.config = changed(self.config, change)
        self.answers.retune(self.config)
