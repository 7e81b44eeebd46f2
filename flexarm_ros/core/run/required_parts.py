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

"""The parts of every run besides its sensors: plant, trajectory, controller, recorder."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import RunConfig, specs, TrajectoryParameters
from flexarm_ros.core.run.part import (
    ACCELERATION,
    Answer,
    CLOCK,
    COMMAND,
    DRIVES,
    JOINT_STATES,
    Part,
    REFERENCE,
    STATE,
    TIP,
)
from flexarm_ros.core.run.rig_parts import (
    ACTUATOR_TORQUE,
    ActuatorPart,
    DisturbancePart,
    PAYLOAD,
    WRENCH,
)
from flexarm_ros.core.sensing.imu import ImuPart
from flexarm_ros.core.sensing.strain_gauge import (
    closes_the_loop,
    deflection_scales,
    STRAIN,
    StrainGaugePart,
)
from flexarm_ros.core.signals import (
    Clock,
    coordinate_names,
    Joints,
    LINKS,
    PlanarPoint,
    Signal,
)
from flexarm_ros.core.timeline import clock_ticks, named_ns, ticks_between, Timeline

# A part's implementation is imported when the part is created: every command reads the list of
# parts before it parses its arguments.
if TYPE_CHECKING:
    from flexarm_ros.core.run.state import Four, State
    from flexarm_ros.core.sensing.channel import Delivery


PLANT_VALUES: dict[str, Callable[[Any], Sequence[float]]] = {
    DRIVES: lambda plant: plant.drives.ravel().tolist(),
    ACCELERATION: lambda plant: plant.acceleration(),
}
"""Topic of a further signal of the plant -> its values at the plant's state."""


class PlantPart(Part):
    """The arm, whose state closes the loop."""

    NAME = 'plant'
    READS = (COMMAND,)
    REPLACEABLE = False

    @classmethod
    def reads(cls, config: RunConfig) -> tuple[str, ...]:
        """
        Return the torques, those of the drives if there are any, then the disturbances.

        These are the force at the tip, and the payload if it varies.
        """
        torque = ACTUATOR_TORQUE if config.section(ActuatorPart.NAME) is not None else COMMAND
        if config.section(DisturbancePart.NAME) is None:
            return (torque,)
        varies = DisturbancePart.varies_payload(config)
        return (torque, WRENCH, PAYLOAD) if varies else (torque, WRENCH)

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """
        Return what is needed beside the state: see `PLANT_VALUES`.

        Angles and rates of drives with backlash, rad, rad/s, at the joints; for an IMU the rates
        of the coordinates' rates, rad/s^2, m/s^2.
        """
        drive, found = config.section(ActuatorPart.NAME), []
        if drive is not None and any(drive.backlash):
            found.append(Signal(DRIVES, Joints()))
        if config.section(ImuPart.NAME) is not None:
            names = tuple(f'{name}_rate' for name in coordinate_names(config.plant.modes))
            found.append(Signal(ACCELERATION, Joints(names, ('velocity',))))
        return tuple(found)

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the clock and the state with the end deflections."""
        names = (*coordinate_names(config.plant.modes), *LINKS)
        return Signal(CLOCK, Clock(), clock_ticks(config.run)), Signal(STATE, Joints(names))


class TrajectoryPart(Answer):
    """The commanded motion."""

    NAME = 'trajectory'
    AHEAD = True
    SHARED = tuple(key for key in specs(TrajectoryParameters) if key != 'delay')

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the commanded point."""
        return (Signal(REFERENCE, PlanarPoint('reference')),)

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.trajectory import Reference

        self.reference = Reference(config)
        self.answer = self.reference.command  # type: ignore[method-assign]
        self.retune = self.reference.retune  # type: ignore[method-assign]


class ControllerPart(Answer):
    """The control law."""

    NAME = 'controller'
    READS = (TIP, JOINT_STATES, STATE, REFERENCE)

    @classmethod
    def reads(cls, config: RunConfig) -> tuple[str, ...]:
        """Return the measurements and the reference, with the strain gauges if they are used."""
        return (*cls.READS, STRAIN) if closes_the_loop(config) else cls.READS

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the torques."""
        return (Signal(COMMAND, Joints(fields=('effort',))),)

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for an impossible rate, delay or source of deflections."""
        source = config.controller.deflection_source
        if source == StrainGaugePart.NAME and config.section(source) is None:
            raise ValueError(
                f'controller.deflection_source: {source}, but the scenario has no section '
                f'{source}; allowed without it: plant'
            )
        gains, period_ns = config.controller, Timeline.of(config.run).period_ns
        named_ns('controller.compute_delay', gains.compute_delay)
        every = ticks_between('controller.rate', gains.rate, period_ns)
        if every == 1:
            return
        from flexarm_ros.core.control import LAWS

        if LAWS[gains.law].EVERY_TICK:
            raise ValueError(
                f'controller.rate: {gains.rate!r} Hz, allowed with law {gains.law}, whose model '
                'advances at every tick: 0'
            )

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.control import make_law, Sample, torque_fault

        self.law = make_law(config)
        self._torque, self._sample = self.law.torque, Sample
        period_ns = Timeline.of(config.run).period_ns
        self.every = ticks_between('controller.rate', config.controller.rate, period_ns)
        """Ticks between torques."""
        delay_ns = named_ns('controller.compute_delay', config.controller.compute_delay)
        self.delay = -(-delay_ns // period_ns)
        """Ticks from a sample to its torque."""
        self.out = (0.0, 0.0)
        """The torque of the last tick, with a rate or a delay."""
        self._due = deque[tuple[float, float]]()
        if self.every > 1 or self.delay:
            self.answer = self._answer_late  # type: ignore[method-assign, assignment]
        self.fault = torque_fault  # type: ignore[method-assign, assignment]
        self._law, self._scales = config.controller.law, deflection_scales(config)
        self.retune = self.law.retune  # type: ignore[method-assign]

    def answer(
        self,
        k: int,
        tip: Four,
        encoder: Four,
        state: State,
        reference: Four,
        strain: tuple[float, float] | None = None,
    ) -> Any:
        """Return tau1, tau2, N m."""
        bends = state.ends[:2] if strain is None else self._bends(strain)
        values = (state.positions, state.rates, bends, encoder, tip, reference)
        # A call of the class takes twice as long.
        return self._torque(k, tuple.__new__(self._sample, values))

    def _answer_late(self, k: int, *inputs: Any) -> tuple[float, float]:
        """Return the newest torque that is due, N m; before the first one 0."""
        if k % self.every == 0:
            self._due.append(ControllerPart.answer(self, k, *inputs))
        if self._is_due(k):
            self.out = self._due.popleft()
        return self.out

    def _is_due(self, k: Any) -> Any:
        """Return whether the torque of ``delay`` ticks ago exists, and is due at tick ``k``."""
        return (k >= self.delay) & ((k - self.delay) % self.every == 0)

    def plan(self, first: int, count: int) -> Delivery:
        """Return which torque is new at each of ``count`` ticks; `end_plan` is to follow."""
        from flexarm_ros.core.sensing.channel import Delivery
        import numpy as np

        ticks, sent = np.arange(first, first + count), len(self._due)
        if self.every == 1 and not self.delay:  # as below, in less time
            self._rows = ticks[:0]
            return Delivery(np.empty((count, 2)), np.arange(count), ticks)
        pool = np.empty((sent + count, 2))
        pool[:sent] = np.array(self._due).reshape(-1, 2)
        computed = ticks[ticks % self.every == 0] - first + sent
        rows = np.concatenate([np.arange(sent), computed])
        picks, due = np.full(count, -1), self._is_due(ticks)
        picks[due] = rows[: np.count_nonzero(due)]
        self._rows = rows[np.count_nonzero(due) :]
        return Delivery(pool, picks, ticks)

    def end_plan(self, delivery: Delivery, out: tuple[float, float]) -> None:
        """Keep the last torque and those that are not due yet, behind ticks that were run."""
        self.out = out
        self._due = deque((a, b) for a, b in delivery.pool[self._rows].tolist())

    def _bends(self, strain: tuple[float, float]) -> tuple[float, float]:
        """Return the end deflections that the gauges' readings stand for, m."""
        assert self._scales is not None
        return strain[0] * self._scales[0], strain[1] * self._scales[1]

    @property
    def title(self) -> str:
        """Return the role and the law's name."""
        return f'{self.NAME} ({self._law})'


class RecorderPart(Part):
    """The recorder, which reads every topic and writes the bag."""

    NAME = 'recorder'
    FOR_THE_RECORD = True
    REPLACEABLE = False
