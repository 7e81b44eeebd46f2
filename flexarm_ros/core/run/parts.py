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
The parts of a run, each declared once: its role, what it reads, what it publishes, how it answers.

What a run consists of follows from `PARTS`: the loop in one process, the recomputation
that proves a bag, the table of topics, the roles of the launcher and of the command
line, and the nodes that do no more than answer.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any, ClassVar, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import (
    Clock,
    coordinate_names,
    Joints,
    LINKS,
    PlanarPoint,
    Signal,
)
from flexarm_ros.core.timeline import clock_ticks

# What a part computes with is imported when it is made: the list itself is asked for by each
# command before it has read its arguments.
if TYPE_CHECKING:
    from flexarm_ros.core.run.state import Four, State
    from flexarm_ros.core.sensing.sensors import Measurement

CLOCK, STATE = '/clock', 'plant/state'
JOINT_STATES, TIP = 'joint_states', 'tip_sensor/odometry'
REFERENCE, COMMAND = 'reference', 'joint_command'


class Part:
    """
    One role of a run.

    ``NAME`` is the role, the section of a scenario and the executable; ``READS`` are the
    topics that it needs of a tick, in the order of `answer`'s arguments, the one that comes
    last first.  ``FOR_THE_RECORD`` reads every topic.  ``REPLACEABLE``: a node of somebody
    else's may fill the role.  ``LATE``: what it publishes is as old as it says, a sensor's
    sample; otherwise the stamp is the tick's.  ``AHEAD``: it publishes before its time.
    """

    NAME: ClassVar[str]
    READS: ClassVar[tuple[str, ...]] = ()
    FOR_THE_RECORD: ClassVar[bool] = False
    REPLACEABLE: ClassVar[bool] = True
    LATE: ClassVar[bool] = False
    AHEAD: ClassVar[bool] = False

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return what this part publishes at each tick."""
        return ()

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return what it publishes beside that, behind the signals of all parts in a bag."""
        return ()


class Answer(Part):
    """A part that answers each tick's inputs, and does nothing else."""

    def __init__(self, config: RunConfig) -> None:
        raise NotImplementedError

    def answer(self, k: int, *inputs: Any) -> Any:
        """
        Return the values of tick ``k``, called once a tick, in order.

        ``inputs`` are the values of ``READS``, a `State` for ``plant/state``.  The values are a
        tuple, ``LATE`` with the stamp, ns, in front; a tuple of such where
        `further_signals` are published too.
        """
        raise NotImplementedError

    @property
    def title(self) -> str:
        """Return what it is called where it is at fault."""
        return self.NAME

    def fault(self, k: int, message: Any) -> str | None:
        """Return what is wrong with the answer of tick ``k``, so that the run cannot go on."""
        return None

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` where a live parameter of ``config`` cannot be taken."""

    def retune(self, config: RunConfig) -> None:
        """Take the live parameters of ``config`` from the next tick on."""


class PlantPart(Part):
    """The arm: its state closes the loop."""

    NAME = 'plant'
    READS = (COMMAND,)
    REPLACEABLE = False

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

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import Encoder

        self.sensor = Encoder(config)
        self._measure = self.sensor.measure
        self.retune = self.sensor.retune  # type: ignore[method-assign]

    def answer(self, k: int, state: State) -> Measurement:
        """Return stamp, theta1, theta2 and their rates."""
        return self._measure(k, state.positions, state.rates)

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for a latency beyond the history that is kept."""
        self.sensor.check_latency(config.encoder.latency)


class TipSensorPart(Answer):
    """The sensor of a point of link 2, and those at ``tip_sensor.more_locations``."""

    NAME = 'tip_sensor'
    READS = (STATE,)
    LATE = True

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the sensed point of the loop."""
        return (cls._signal(config, ''),)

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the points that are for the record only."""
        further = range(1, len(config.tip_sensor.more_locations or ()) + 1)
        return tuple(cls._signal(config, f'_{number}') for number in further)

    @classmethod
    def _signal(cls, config: RunConfig, suffix: str) -> Signal:
        variance = config.tip_sensor.noise_std * config.tip_sensor.noise_std
        return Signal(TIP + suffix, PlanarPoint(f'tip_sensor{suffix}', variance))

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import further_sensors, TipSensor

        self.sensors = (TipSensor(config), *further_sensors(config))
        self._measure, self._alone = self.sensors[0].measure, len(self.sensors) == 1

    def answer(self, k: int, state: State) -> Any:
        """Return stamp, x, y, vx, vy, of each sensor where there are several."""
        q, qd = state.q, state.qd
        if self._alone:
            return self._measure(k, q, qd)
        return tuple([sensor.measure(k, q, qd) for sensor in self.sensors])

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for a latency beyond the history that is kept."""
        self.sensors[0].check_latency(config.tip_sensor.latency)

    def retune(self, config: RunConfig) -> None:
        """Let the sensors take latency and noise."""
        for sensor in self.sensors:
            sensor.retune(config)


class TrajectoryPart(Answer):
    """The commanded motion."""

    NAME = 'trajectory'
    AHEAD = True

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
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the torques."""
        return (Signal(COMMAND, Joints(fields=('effort',))),)

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.control import make_law, Sample, torque_fault

        self.law = make_law(config)
        self._torque, self._sample = self.law.torque, Sample
        self.fault = torque_fault  # type: ignore[method-assign, assignment]
        self._law = config.controller.law
        self.retune = self.law.retune  # type: ignore[method-assign]

    def answer(self, k: int, tip: Four, encoder: Four, state: State, reference: Four) -> Any:
        """Return tau1, tau2, N m."""
        sample = self._sample(
            state.positions, state.rates, state.ends[:2], encoder, tip, reference
        )
        return self._torque(k, sample)

    @property
    def title(self) -> str:
        """Return the role and the law's name."""
        return f'{self.NAME} ({self._law})'


class RecorderPart(Part):
    """What writes the bag: it reads every topic."""

    NAME = 'recorder'
    FOR_THE_RECORD = True
    REPLACEABLE = False


PARTS: tuple[type[Part], ...] = (
    PlantPart, EncoderPart, TipSensorPart, TrajectoryPart, ControllerPart, RecorderPart,
)  # fmt: skip
"""In the order in which a tick's data flow."""

ROLES = tuple(part.NAME for part in PARTS)
RECORDED_ROLES = tuple(part.NAME for part in PARTS if not part.FOR_THE_RECORD)
REPLACEABLE = tuple(part.NAME for part in PARTS if part.REPLACEABLE)


def answering() -> tuple[type[Answer], ...]:
    """Return the parts that answer, in the order of a tick."""
    return tuple(part for part in PARTS if issubclass(part, Answer))


def answer_of(role: str) -> type[Answer]:
    """Return the answering part with this role."""
    return next(part for part in answering() if role == part.NAME)


def signals(config: RunConfig) -> tuple[tuple[type[Part], Signal], ...]:
    """Return every signal of a run with its part, in the order of a tick in a bag."""
    first = [(part, signal) for part in PARTS for signal in part.signals(config)]
    return (*first, *((p, signal) for p in PARTS for signal in p.further_signals(config)))


def readers(topic: str) -> tuple[str, ...]:
    """Return the roles that read ``topic``; any is read for the record."""
    return tuple(part.NAME for part in PARTS if topic in part.READS or part.FOR_THE_RECORD)


Step = Callable[[int], None]


class Answers:
    """
    The answering parts of one run, wired together in one process.

    ``messages`` are those of the last tick, in the order of `signals`, ``LATE`` ones with their
    stamp; the first two are the plant's: nothing, and the `State`.
    """

    def __init__(self, config: RunConfig) -> None:
        self.parts = {part.NAME: part(config) for part in answering()}
        wired = signals(config)
        place = {signal.name: i for i, (_, signal) in enumerate(wired)}
        self.late = [part.LATE for part, _ in wired]
        """Whether each of ``messages`` has its stamp."""
        self.messages: list[Any] = [None] * len(wired)
        self._inputs: list[Any] = [None] * len(wired)
        self._state = place[STATE]
        self._steps: list[Step] = []
        for part in self.parts.values():
            writes = [i for i, (owner, _) in enumerate(wired) if owner is type(part)]
            self._steps.append(self._step(part, [place[name] for name in part.READS], writes))

    def _step(self, part: Answer, reads: Sequence[int], writes: Sequence[int]) -> Step:
        """Return what lets ``part`` answer a tick; apart by number of inputs for speed."""
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

    def tick(self, k: int, state: State) -> tuple[Any, ...]:
        """Let every part answer the plant's ``state`` of tick ``k``; return the messages."""
        self.messages[self._state] = self._inputs[self._state] = state
        for step in self._steps:
            step(k)
        return tuple(self.messages)

    def retune(self, config: RunConfig) -> None:
        """Let every part take the live parameters of ``config``."""
        for part in self.parts.values():
            part.retune(config)
