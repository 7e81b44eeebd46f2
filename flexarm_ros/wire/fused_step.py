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
The fused node step: from the messages of a tick to the published answer, compiled.

A node of a lock-step run does little arithmetic per tick, 1 us of some 100 us.  Most of its own
time is Python between two messages: taking one with its info, decoding to Python numbers,
comparing, a dozen calls, converting numbers for a compiled function and back, encoding,
publishing.  In a process of its own this code is cold at every tick and takes several times what
a loop over it takes.  Here a compiled loop takes the messages, checks them, computes, and
publishes the answer, tick by tick, until something unusual arrives or Python's turn comes.

What it does
    Messages are copied into buffers which stay at one place (`Buffer`).  A step compares each
    message with the template of its codec (`flexarm_ros.wire.cdr`), checks stamp and finiteness,
    calls the compiled functions of the parts, and puts stamp and values into the buffer of the
    answer.  There is no formula of its own: `delayed`, `sensed_point`, `read_out`,
    `transpose_law`, `command_at`, `step_eq14`, `step` and `is_stable` are those that the parts,
    the loop in one process and `flexarm_ros.core.run.kernel` call as well, so that the bytes are
    the same.

What it does not do
    A step returns False, and has changed nothing, for anything but a plain tick: another layout,
    a wrong stamp, a value or a torque that is not finite.  The loop then ends, and the node treats
    the tick in Python, where each check is made again, and where a fault gets its text.  So the
    fast path can only accept what the Python path accepts, and reports nothing.

Which nodes
    `answer_step` and `plant_step` return None for what has no fused step: a law in Python, a
    sensor with noise, sample rate, jitter, loss or offset, several tip sensors, a delayed or
    slower controller, Coulomb friction, drives, disturbances, parts of other packages, a
    free-running run.  Such a node takes each tick in Python.  Sender and sequence number are not
    in the bytes: they are checked where messages are taken (`flexarm_ros.wire.rcl_calls`).

Alignment
    CDR aligns from the end of its header of four bytes.  A message is copied to byte 4 of a
    buffer of float64, so that its values are elements of the buffer.  The layout is compared eight
    bytes at a time, under a mask that leaves out padding, stamp and values.

Calls
    numba's dispatcher looks at the type of each argument at each call, which takes ten times as
    long as to convert them: `flexarm_ros.core.numerics.compiled.bound` calls the compiled code of
    the types that a step has.  The records of a step are made anew after a live change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import sys
from typing import Any, NamedTuple

from flexarm_ros.core.arm.full.dynamics import step as step_full
from flexarm_ros.core.arm.full.plant import FullPlant, FullRecord
from flexarm_ros.core.arm.kinematics import sensed_point, SensedPoint
from flexarm_ros.core.arm.plant import is_stable, Plant
from flexarm_ros.core.arm.plant_eq14 import Eq14Plant, Eq14Record, step_eq14
from flexarm_ros.core.control.pd import FlsLaw, PdLaw, transpose_law
from flexarm_ros.core.numerics.compiled import bound, FloatArray, internal, unlocked
from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run import part
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.parts import answering
from flexarm_ros.core.run.required_parts import ControllerPart, PlantPart, TrajectoryPart
from flexarm_ros.core.run.state import Four
from flexarm_ros.core.run.warmup import warm_up
from flexarm_ros.core.sensing.delay import delayed
from flexarm_ros.core.sensing.parts import EncoderPart, TipSensorPart
from flexarm_ros.core.sensing.sensors import Encoder, read_out, Readout, TipSensor
from flexarm_ros.core.timeline import T0_NS, Timeline
from flexarm_ros.core.trajectory import command_at, Reference, Sides
from flexarm_ros.wire.cdr import Codec
from flexarm_ros.wire.rcl_calls import (
    accept,
    collect,
    LINK,
    PORT,
    progress,
    publish,
    warm_up_blocks,
)
from flexarm_ros.wire.topics import per_tick_topics, Topic
import numpy as np
from numpy.typing import NDArray

_HEADER, _NS = 4, 1_000_000_000
_NO_POINT = SensedPoint(False, 0.0, 0.0, np.zeros((3, 1)), np.zeros((2, 0, 0)))


class Message(NamedTuple):
    """
    A message in its buffer, for compiled code.

    ``data``: the buffer, ``words`` and ``stamp``: the same bytes, and those of the stamp, as
    integers; ``layout`` ``(2, n)``: constant bytes, and the mask of them;
    ``first``, ``second``: elements of ``data`` where the codec's runs of ``count`` values begin,
    the same if it has one; ``exact``: whether the stamp is that of the tick.
    """

    data: FloatArray
    words: NDArray[np.uint64]
    stamp: NDArray[np.uint32]
    layout: NDArray[np.uint64]
    first: int
    second: int
    count: int
    exact: bool


class Buffer:
    """
    The buffer of one topic's message, and its two ends.

    ``put`` is where the bytes of a received message are copied to, at ``address``; ``bytes``
    returns those of the message in it, ``size`` bytes.
    """

    def __init__(self, topic: Topic) -> None:
        codec: Codec = topic.codec
        size = -(-(_HEADER + codec.size) // 8)
        self._data = np.zeros(size)
        layout = np.zeros((2, size), np.uint64)
        rows = layout.view(np.uint8)
        held = slice(_HEADER, _HEADER + codec.size)
        rows[0, held], rows[1, held] = np.frombuffer(codec.template, np.uint8), codec.fixed
        self.size, self.address = codec.size, self._data.ctypes.data + _HEADER
        self.put = memoryview(self._data).cast('B')[held]
        self.put[:] = codec.template
        self.bytes = self.put.tobytes
        self._decode = codec.decode
        starts = [(_HEADER + at) // 8 for at, _ in codec.runs] or [0]
        count = codec.runs[0][1] if codec.runs else 0
        self.message = Message(
            self._data, self._data.view(np.uint64), self._data.view(np.uint32)[2:4], layout,
            starts[0], starts[-1], count, not topic.late,
        )  # fmt: skip

    def decode(self) -> tuple[int, tuple[float, ...]]:
        """Return stamp (ns) and values of the message in the buffer."""
        return self._decode(self.bytes())


@internal
def is_plain(message: Message, due: int) -> bool:
    """Return whether a message has its codec's layout, a valid stamp and finite values."""
    words, stamp, differ = message.words, message.stamp, np.uint64(0)
    for i in range(len(words)):
        differ |= (words[i] ^ message.layout[0, i]) & message.layout[1, i]
    found = np.int64(np.int32(stamp[0])) * _NS + np.int64(stamp[1])
    if differ != 0 or found > due or (message.exact and found != due):
        return False
    total = 0.0
    for i in range(message.count):
        total += message.data[message.first + i] + message.data[message.second + i]
    return math.isfinite(total)


@internal
def four(message: Message) -> tuple[float, float, float, float]:
    """Return the first two values of both runs."""
    data, first, second = message.data, message.first, message.second
    return data[first], data[first + 1], data[second], data[second + 1]


@internal
def put_stamp(message: Message, stamp_ns: int) -> None:
    """Set the stamp of a message."""
    stamp = message.stamp
    stamp[0], stamp[1] = stamp_ns // _NS, stamp_ns % _NS


@internal
def put_four(message: Message, stamp_ns: int, a: float, b: float, c: float, d: float) -> None:
    """Set the stamp and the first two values of both runs; of one run, to ``c`` and ``d``."""
    put_stamp(message, stamp_ns)
    data, first, second = message.data, message.first, message.second
    data[first], data[first + 1] = a, b
    data[second], data[second + 1] = c, d


class SensorRecord(NamedTuple):
    """The encoder, ``joints``, or the tip sensor, which measures ``point``."""

    state: Message
    measured: Message
    period_ns: int
    latency_ns: int
    readout: Readout
    joints: bool
    point: SensedPoint


@internal
def measure(record: SensorRecord, k: int) -> bool:
    """Measure the state of tick ``k``."""
    state, readout = record.state, record.readout
    due = T0_NS + k * record.period_ns
    if not is_plain(state, due):
        return False
    if record.joints:
        a, b, c, d = four(state)
    else:
        n = state.count - 2  # the deflections follow the coordinates
        q = state.data[state.first : state.first + n]
        a, b, c, d = sensed_point(record.point, q, state.data[state.second : state.second + n])
    a, b, c, d = delayed(readout.line, k, a, b, c, d)
    a, b = read_out(a, b, 0.0, 0.0, 0.0, readout.resolution)
    put_four(record.measured, due - record.latency_ns, a, b, c, d)
    return True


class LawRecord(NamedTuple):
    """The laws (20) and (21) with their inputs."""

    tip: Message
    encoder: Message
    state: Message
    reference: Message
    torque: Message
    period_ns: int
    settings: NDArray[np.void]


@internal
def control(record: LawRecord, k: int) -> bool:
    """Compute the torques of tick ``k``."""
    due, state = T0_NS + k * record.period_ns, record.state
    plain = is_plain(record.tip, due) and is_plain(record.encoder, due)
    if not (plain and is_plain(state, due) and is_plain(record.reference, due)):
        return False
    ends = state.first + state.count - 2
    tau1, tau2, _ = transpose_law(
        record.settings, four(state), (state.data[ends], state.data[ends + 1]),
        four(record.encoder), four(record.tip), four(record.reference),
    )  # fmt: skip
    if not math.isfinite(tau1 + tau2):
        return False
    put_four(record.torque, due, tau1, tau2, tau1, tau2)
    return True


@unlocked
def run_sensor(
    link: Records, ports: Records, record: SensorRecord, k: int, last: int
) -> tuple[int, bool]:
    """
    Answer ticks from ``k`` on, before ``last``.

    Returns the first tick that is not answered, and whether the last answer could not be
    published.  ``ports``: inputs as `flexarm_ros.wire.rcl_calls.collect` reads them, then the
    output.
    """
    output = len(ports) - 1
    while k < last and collect(link, ports, output) and measure(record, k):
        sent = publish(link, ports, output)
        accept(ports, output)
        k += 1
        if not (progress(link) and sent):
            return k, not sent
    return k, False


@unlocked
def run_law(
    link: Records, ports: Records, record: LawRecord, k: int, last: int
) -> tuple[int, bool]:
    """Do the same as `run_sensor` for the controller."""
    output = len(ports) - 1
    while k < last and collect(link, ports, output) and control(record, k):
        sent = publish(link, ports, output)
        accept(ports, output)
        k += 1
        if not (progress(link) and sent):
            return k, not sent
    return k, False


class ReferenceRecord(NamedTuple):
    """The trajectory, ``delay_ns`` late."""

    reference: Message
    period_ns: int
    sides: Sides
    delay_ns: int


@unlocked
def run_reference(
    link: Records, ports: Records, record: ReferenceRecord, k: int, until: int
) -> int:
    """Publish the references of ticks from ``k`` on, before ``until``; as `run_sensor`."""
    sides, output = record.sides, len(ports) - 1
    while k < until:
        x, y, vx, vy = command_at(
            sides.times, sides.lines, sides.lap_ns, sides.smooth,
            k * record.period_ns - record.delay_ns,
        )  # fmt: skip
        put_four(record.reference, T0_NS + k * record.period_ns, x, y, vx, vy)
        if not publish(link, ports, output):
            return k
        k += 1
    return k


class PlantRecord(NamedTuple):
    """
    The plant's messages, and the limits of its end deflections, m.

    ``tick``: the number in the message of the plant's tick; ``every``: ticks between messages of
    the plant's tick, the state and the clock.
    """

    torque: Message
    state: Message
    clock: Message
    tick: NDArray[np.int64]
    period_ns: int
    every: tuple[int, int, int]
    limits: tuple[float, float]


SENT, DUE, UNSTABLE = 0, -1, -2
"""
How the plant's loop ends at its tick: the state is published, or is to be published in Python, or
is unstable after this tick.  A positive number is that of the port that cannot publish.
"""


@internal
def await_torque(
    link: Records, ports: Records, record: PlantRecord, k: int
) -> tuple[bool, float, float]:
    """Return whether the torques of tick ``k`` have come and are valid, and the torques, N m."""
    torque, count = record.torque, len(ports) - len(record.every)
    valid = collect(link, ports, count) and is_plain(torque, T0_NS + k * record.period_ns)
    if valid:
        accept(ports, count)
    return valid, torque.data[torque.first], torque.data[torque.first + 1]


@internal
def after_step(
    link: Records, ports: Records, record: PlantRecord, q: FloatArray, qd: FloatArray, ends: Four,
    k: int, bound: int,
) -> int:  # fmt: skip
    """Publish the state of tick ``k`` if it is stable and before ``bound``; return how that is."""
    if not is_stable(ends, record.limits, q, qd):
        return UNSTABLE
    if k >= bound or not progress(link):
        return DUE
    return send_state(link, ports, record, q, qd, ends, k)


@internal
def send_state(
    link: Records, ports: Records, record: PlantRecord, q: FloatArray, qd: FloatArray, ends: Four,
    k: int,
) -> int:  # fmt: skip
    """
    Publish state and clock of tick ``k``, before them the tick, where they are due.

    Returns `SENT`, or the number of the port that cannot publish.
    """
    stamp, n = T0_NS + k * record.period_ns, len(q)
    put_stamp(record.state, stamp)
    put_stamp(record.clock, stamp)
    data, first, second = record.state.data, record.state.first, record.state.second
    for i in range(n):
        data[first + i], data[second + i] = q[i], qd[i]
    data[first + n], data[first + n + 1], data[second + n], data[second + n + 1] = ends
    record.tick[0] = k
    for i in range(1, len(ports)):
        if k % record.every[i - 1] == 0 and not publish(link, ports, i):
            return i
    return SENT


@unlocked
def run_eq14(
    link: Records, ports: Records, record: PlantRecord, plant: Eq14Record, k: int, bound: int
) -> tuple[int, int]:
    """
    Integrate and publish from tick ``k`` on, whose state is published, to ``bound``.

    ``ports``: torque, the plant's tick, state, clock.  Returns the tick and how it ends.
    """
    q, qd = plant.state[0], plant.state[1]
    while True:
        valid, tau1, tau2 = await_torque(link, ports, record, k)
        if not valid:
            return k, SENT
        ends = step_eq14(
            plant.state, tau1, tau2, plant.step, plant.substeps, plant.mass, plant.diagonals,
            plant.coupling, plant.matrix, plant.work,
        )  # fmt: skip
        end = after_step(link, ports, record, q, qd, ends, k + 1, bound)
        k += end != UNSTABLE
        if end != SENT:
            return k, end


@unlocked
def run_full(
    link: Records, ports: Records, record: PlantRecord, plant: FullRecord, k: int, bound: int
) -> tuple[int, int]:
    """Do the same as `run_eq14`, for the other plant."""
    q, qd = plant.q, plant.qd
    while True:
        valid, tau1, tau2 = await_torque(link, ports, record, k)
        if not valid:
            return k, SENT
        ends = step_full(
            plant.constants, q, qd, tau1, tau2, plant.step, plant.substeps, plant.order, plant.work
        )  # fmt: skip
        end = after_step(link, ports, record, q, qd, ends, k + 1, bound)
        k += end != UNSTABLE
        if end != SENT:
            return k, end


class FusedStep:
    """
    The step of a node that answers or publishes ahead, with the buffers of its messages.

    ``bind(link, ports)`` returns the loop over ticks, a function of the first and the last.
    """

    def __init__(
        self, loop: Callable[..., Any], record: SensorRecord | LawRecord | ReferenceRecord,
        inputs: Sequence[Buffer], output: Buffer, sensor: Encoder | TipSensor | None = None,
    ) -> None:  # fmt: skip
        self.record, self.inputs, self.outputs = record, inputs, (output,)
        self._loop, self._sensor = loop, sensor

    def bind(self, link: Records, ports: Records) -> Callable[[int, int], Any]:
        """Return ``run(k, last)``; see `run_sensor` and `run_reference`."""
        run: Callable[[int, int], Any] = bound(
            self._loop, link, ports, self.record, example=(0, 0)
        )
        return run

    def leave(self) -> None:
        """Let the part continue, in Python, after the tick of the last answer."""
        if self._sensor is not None:
            stamp, (a, b, c, d) = self.outputs[0].decode()
            self._sensor.follow((stamp, a, b, c, d))


def answer_step(
    answer: part.Answer, reads: Sequence[Topic], writes: Sequence[Topic], period_ns: int
) -> FusedStep | None:
    """Return the step of an answering part with its topics; None if there is none."""
    if sys.byteorder != 'little' or len(writes) != 1:
        return None
    if type(answer) is TrajectoryPart:
        return reference_step(answer.reference, writes[0], period_ns)
    inputs, output = tuple(Buffer(topic) for topic in reads), Buffer(writes[0])
    said = [buffer.message for buffer in inputs]
    if type(answer) is ControllerPart and type(answer.law) in (PdLaw, FlsLaw):
        if len(reads) != len(ControllerPart.READS) or answer.every > 1 or answer.delay:
            return None
        assert isinstance(answer.law, PdLaw)
        law = LawRecord(*said, output.message, period_ns, answer.law.settings)
        return FusedStep(run_law, law, inputs, output)
    sensor = _plain_sensor(answer)
    if sensor is None:
        return None
    joints = isinstance(sensor, Encoder)
    point = _NO_POINT if isinstance(sensor, Encoder) else sensor.point.record()
    record = SensorRecord(
        said[0], output.message, period_ns, sensor.channel.ns, sensor.record(), joints, point
    )
    return FusedStep(run_sensor, record, inputs, output, sensor)


def _plain_sensor(answer: part.Answer) -> Encoder | TipSensor | None:
    """Return the sensor of a part if it has no noise and delivers each sample; else None."""
    sensor: Encoder | TipSensor
    if type(answer) is EncoderPart and answer.sensor.offset is None:
        sensor = answer.sensor
    elif type(answer) is TipSensorPart and len(answer.sensors) == 1:
        sensor = answer.sensors[0]
    else:
        return None
    channel = sensor.channel
    plain = not channel.scheduled and channel.every == 1 and sensor.noise_std == 0.0
    return sensor if plain else None


def reference_step(reference: Reference, topic: Topic, period_ns: int) -> FusedStep | None:
    """Return the step of the trajectory; None if there is none."""
    if sys.byteorder != 'little':
        return None
    output, path = Buffer(topic), reference.path.record
    record = ReferenceRecord(output.message, period_ns, path, reference.delay_ns)
    return FusedStep(run_reference, record, (), output)


class TickBuffer:
    """A ``std_msgs/UInt64`` in a buffer, as `Buffer`; ``value``: an array of its number."""

    def __init__(self) -> None:
        data = np.zeros(2, np.int64)
        data.view(np.uint8)[_HEADER : 2 * _HEADER] = 0, 1, 0, 0  # CDR, little endian
        self.size, self.address = _HEADER + 8, data.ctypes.data + _HEADER
        self.value = data[1:]


class PlantStep:
    """
    The step of the plant, which it advances in place.

    ``inputs`` and ``outputs``: the buffers of its ports, in the order of `run_eq14`.
    """

    def __init__(
        self, plant: Eq14Plant | FullPlant, record: PlantRecord, command: Buffer,
        outputs: tuple[TickBuffer, Buffer, Buffer],
    ) -> None:  # fmt: skip
        self.record, self.inputs, self.outputs = record, (command,), outputs
        self._plant = plant

    def bind(self, link: Records, ports: Records) -> Callable[[int, int], tuple[int, int]]:
        """Return ``run(k, bound)``; see `run_eq14`."""
        loop: Callable[..., Any] = run_eq14 if isinstance(self._plant, Eq14Plant) else run_full
        records = link, ports, self.record, self._plant.record()
        run: Callable[[int, int], tuple[int, int]] = bound(loop, *records, example=(0, 0))
        return run


def plant_step(
    plant: Plant, config: RunConfig, topics: Sequence[Topic], tick_every: int
) -> PlantStep | None:
    """
    Return the step of the plant with the topics of a run; None if there is none.

    ``tick_every``: ticks between two messages of the plant's tick.
    """
    plain = PlantPart.reads(config) == PlantPart.READS and not PlantPart.further_signals(config)
    known = isinstance(plant, (Eq14Plant, FullPlant))
    if sys.byteorder != 'little' or not (plain and known) or config.run.sync == 'free':
        return None
    named = {topic.name: topic for topic in topics}
    command, state, clock = (Buffer(named[n]) for n in (part.COMMAND, part.STATE, part.CLOCK))
    tick = TickBuffer()
    record = PlantRecord(
        command.message, state.message, clock.message, tick.value,
        Timeline.of(config.run).period_ns, (tick_every, 1, named[part.CLOCK].every),
        plant.limits,
    )  # fmt: skip
    return PlantStep(plant, record, command, (tick, state, clock))


def compile_loop(step: FusedStep | PlantStep) -> None:
    """Compile the loop of a step, or load it from the cache, before a tick waits for it."""
    step.bind(np.zeros(1, LINK), np.zeros(1, PORT))


def warm_up_nodes(config: RunConfig) -> None:
    """Compile what the nodes of a scenario call, loop and steps, or load it from the cache."""
    warm_up(config)
    topics, period_ns = per_tick_topics(config), Timeline.of(config.run).period_ns
    named = {topic.name: topic for topic in topics}
    steps: list[FusedStep | PlantStep | None] = [plant_step(make_plant(config), config, topics, 1)]
    for kind in answering(config):
        reads = [named[name] for name in kind.reads(config)]
        writes = [topic for topic in topics if topic.node == kind.NAME]
        steps.append(answer_step(kind(config), reads, writes, period_ns))
    for step in filter(None, steps):
        compile_loop(step)
    warm_up_blocks()
