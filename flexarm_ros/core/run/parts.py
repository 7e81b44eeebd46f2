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
The parts of a run, each declared once: role, inputs, signals and the answer to a tick.

`parts_of` a scenario determines the loop in one process, the recomputation that verifies a bag,
the table of topics, the roles of the launcher and of the command line, and the answering nodes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import (
    RunConfig,
    SECTIONS,
    specs,
    TrajectoryParameters,
)
from flexarm_ros.core.run.outside import make_part
from flexarm_ros.core.run.part import (
    ACCELERATION,
    Answer,
    CLOCK,
    Column,
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
from flexarm_ros.core.sensing.channel_keys import check_channel, repeats
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
    from flexarm_ros.core.sensing.sensors import Measurement


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


class EncoderPart(Answer):
    """The joint encoders."""

    NAME = 'encoder'
    READS = (STATE,)
    LATE = True

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the measured angles and rates."""
        return (Signal(JOINT_STATES, Joints()),)

    @classmethod
    def holds(cls, config: RunConfig) -> bool:
        """Return whether a sample may be repeated: a rate, jitter or loss."""
        return repeats(config.encoder)

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys of the channel that are invalid together."""
        check_channel(cls.NAME, config.encoder, Timeline.of(config.run).period_ns)

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import Encoder

        self.sensor = Encoder(config)
        self._measure = self.sensor.measure
        self.retune = self.sensor.retune  # type: ignore[method-assign]

    def answer(self, k: int, state: State) -> Measurement:
        """Return stamp, theta1, theta2 and their rates."""
        return self._measure(k, state.positions, state.rates)

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys that the channel cannot take."""
        self.sensor.channel.check(config.encoder)


class TipSensorPart(Answer):
    """The sensor of a point of link 2, and those of ``tip_sensor.more_locations``."""

    NAME = 'tip_sensor'
    READS = (STATE,)
    LATE = True
    SHARED = ('location', 'more_locations', 'rate')

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the sensed point that the controller uses."""
        return (cls._signal(config, ''),)

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the points that are only recorded."""
        further = range(1, len(config.tip_sensor.more_locations or ()) + 1)
        return tuple(cls._signal(config, f'_{number}') for number in further)

    @classmethod
    def holds(cls, config: RunConfig) -> bool:
        """Return whether a sample may be repeated: a rate, jitter or loss."""
        return repeats(config.tip_sensor)

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys of the channel that are invalid together."""
        check_channel(cls.NAME, config.tip_sensor, Timeline.of(config.run).period_ns)

    @classmethod
    def _signal(cls, config: RunConfig, suffix: str) -> Signal:
        variance = config.tip_sensor.noise_std * config.tip_sensor.noise_std
        return Signal(TIP + suffix, PlanarPoint(f'tip_sensor{suffix}', variance))

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import further_sensors, TipSensor

        self.sensors = (TipSensor(config), *further_sensors(config))
        self._measure, self._alone = self.sensors[0].measure, len(self.sensors) == 1

    def answer(self, k: int, state: State) -> Any:
        """Return stamp, x, y, vx, vy; a tuple of such tuples with several sensors."""
        q, qd = state.q, state.qd
        if self._alone:
            return self._measure(k, q, qd)
        return tuple([sensor.measure(k, q, qd) for sensor in self.sensors])

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys that the channel cannot take."""
        self.sensors[0].channel.check(config.tip_sensor)

    def retune(self, config: RunConfig) -> None:
        """Apply latency and noise to the sensors."""
        for sensor in self.sensors:
            sensor.retune(config)


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
        """Raise ``ValueError`` for a rate, delay or source of deflections that cannot be had."""
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


PARTS: tuple[type[Part], ...] = (
    PlantPart, EncoderPart, TipSensorPart, StrainGaugePart, ImuPart, TrajectoryPart,
    ControllerPart, ActuatorPart, DisturbancePart, RecorderPart,
)  # fmt: skip
"""This package's parts, in the order in which a tick's data flow."""

PLUGINS: dict[str, type[Part]] = {}
"""Parts of other packages that have been registered, by role."""


def register_part(part: type[Part]) -> None:
    """
    Add this part to scenarios that have a section of its name.

    The class is not checked here, but where it is loaded
    (`flexarm_ros.scenario.plugins.registry`).
    """
    assert part.Parameters is not None
    PLUGINS[part.NAME] = part
    SECTIONS[part.NAME] = part.Parameters


for _part in PARTS:
    if _part.Parameters is not None:
        SECTIONS[_part.NAME] = _part.Parameters


def known_parts() -> tuple[type[Part], ...]:
    """Return every known part; those of other packages come before the recorder."""
    record = [part for part in PARTS if part.FOR_THE_RECORD]
    return (*(part for part in PARTS if part not in record), *PLUGINS.values(), *record)


def parts_of(config: RunConfig) -> tuple[type[Part], ...]:
    """
    Return the parts of a scenario, each after those that it reads; the plant closes the loop.

    Raises ``ValueError`` if no part publishes a topic that another one reads.
    """
    left = [p for p in known_parts() if p.Parameters is None or config.section(p.NAME) is not None]
    found: list[type[Part]] = []
    published: set[str] = set()
    while left:
        part = next((p for p in left if p is PlantPart or published >= {*p.reads(config)}), None)
        if part is None:
            missing = next(name for name in left[0].reads(config) if name not in published)
            raise ValueError(
                f'{left[0].NAME}: reads {missing}, which no part of this scenario publishes'
            )
        left.remove(part)
        found.append(part)
        published |= {s.name for s in (*part.signals(config), *part.further_signals(config))}
    return (*(p for p in found if not p.FOR_THE_RECORD), *(p for p in found if p.FOR_THE_RECORD))


def roles(config: RunConfig) -> tuple[str, ...]:
    """Return the roles of a scenario; the recorder is the last."""
    return tuple(part.NAME for part in parts_of(config))


def recorded_roles(config: RunConfig) -> tuple[str, ...]:
    """Return the roles whose messages are recorded."""
    return tuple(part.NAME for part in parts_of(config) if not part.FOR_THE_RECORD)


def replaceable(config: RunConfig) -> tuple[str, ...]:
    """Return the roles that an external node may fill."""
    return tuple(part.NAME for part in parts_of(config) if part.REPLACEABLE)


def answering(config: RunConfig) -> tuple[type[Answer], ...]:
    """Return the parts that answer, in the order of a tick."""
    return tuple(part for part in parts_of(config) if issubclass(part, Answer))


def part_of(role: str) -> type[Part]:
    """Return the part with this role; ``KeyError`` if there is none."""
    return {part.NAME: part for part in known_parts()}[role]


def signals(config: RunConfig) -> tuple[tuple[type[Part], Signal], ...]:
    """
    Return every signal of a run with its part, in the order of a tick in a bag.

    The signals of required parts come first, so that their positions are the same in every
    scenario; their further signals and those of optional parts follow.
    """
    parts = parts_of(config)
    required = [part for part in parts if part.Parameters is None]
    return (
        *((part, signal) for part in required for signal in part.signals(config)),
        *((part, signal) for part in required for signal in part.further_signals(config)),
        *(
            (part, signal)
            for part in parts
            if part.Parameters is not None
            for signal in (*part.signals(config), *part.further_signals(config))
        ),
    )


def place(topic: str) -> int:
    """Return the index in `signals` of a required part's topic, the same in every scenario."""
    return [signal.name for _, signal in signals(RunConfig())].index(topic)


def readers(topic: str, config: RunConfig) -> tuple[str, ...]:
    """Return the roles that read ``topic``; the recorder reads every topic."""
    return tuple(
        part.NAME
        for part in parts_of(config)
        if part.FOR_THE_RECORD or topic in part.reads(config)
    )


def columns(config: RunConfig) -> tuple[Column, ...]:
    """Return the columns of ``trajectory.csv`` that optional parts add."""
    return tuple(column for part in parts_of(config) for column in part.columns(config))


def check_parts(config: RunConfig) -> None:
    """Raise ``ValueError`` if the scenario is invalid for a part."""
    for part in parts_of(config):
        part.check(config)


Step = Callable[[int], None]


class Answers:
    """
    The answering parts of one run, connected in one process.

    ``messages`` are those of the last tick, in the order of `signals`, ``LATE`` ones with their
    stamp; the first two are the plant's: none, and the `State`.
    """

    def __init__(self, config: RunConfig) -> None:
        self.parts = {part.NAME: make_part(part, config) for part in answering(config)}
        wired = signals(config)
        self.places = place = {signal.name: i for i, (_, signal) in enumerate(wired)}
        """Topic -> index in ``messages``."""
        self.late = [part.LATE for part, _ in wired]
        """Whether each of ``messages`` has its stamp."""
        self.messages: list[Any] = [None] * len(wired)
        self._inputs: list[Any] = [None] * len(wired)
        self._state = place[STATE]
        self._steps: list[Step] = []
        for part in self.parts.values():
            writes = [i for i, (owner, _) in enumerate(wired) if owner is type(part)]
            reads = [place[name] for name in part.reads(config)]
            self._steps.append(self._step(part, reads, writes))

    def _step(self, part: Answer, reads: Sequence[int], writes: Sequence[int]) -> Step:
        """Return the function that lets ``part`` answer a tick; by number of inputs, for speed."""
        answer, messages, inputs = part.answer, self.messages, self._inputs
        first, late = writes[0], part.LATE

        def several(k: int) -> None:
            answers = answer(k, *[inputs[i] for i in reads])
            for place, message in zip(writes, answers, strict=True):
                messages[place] = message
                inputs[place] = message[1:] if late else message

        def sensor(k: int) -> None:
            messages[first] = message = answer(k, inputs[only])
            inputs[first] = message[1:]

        def late_of_some(k: int) -> None:
            messages[first] = message = answer(k, *pick(inputs))
            inputs[first] = message[1:]

        def of_some(k: int) -> None:
            messages[first] = inputs[first] = answer(k, *pick(inputs))

        def of_none(k: int) -> None:
            messages[first] = inputs[first] = answer(k)

        if len(writes) > 1:
            return several
        only = reads[0] if reads else 0
        pick = itemgetter(*reads) if len(reads) > 1 else itemgetter(slice(only, only + len(reads)))
        if late:
            return sensor if len(reads) == 1 else late_of_some
        return of_some if reads else of_none

    def tell(self, place: int, values: tuple[float, ...]) -> None:
        """Give the parts another message of the plant, before `tick`."""
        self.messages[place] = self._inputs[place] = values

    def tick(self, k: int, state: State) -> tuple[Any, ...]:
        """Let every part answer ``state`` of tick ``k``; return the messages."""
        self.messages[self._state] = self._inputs[self._state] = state
        for step in self._steps:
            step(k)
        return tuple(self.messages)

    def retune(self, config: RunConfig) -> None:
        """Apply the live parameters of ``config`` to every part."""
        for part in self.parts.values():
            part.retune(config)
