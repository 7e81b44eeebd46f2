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
The closed loop over blocks of ticks: one compiled function for all of a tick.

`flexarm_ros.core.run.loop.ClosedLoop` calls a dozen compiled functions a tick from Python.
Each call converts every argument and result between Python objects and machine numbers, which
takes ten times as long as the arithmetic.  Here a compiled function runs a block of ticks
(plant, sensors, reference, law) and fills arrays with what the nodes would publish.

One implementation
    The kernel has no formula of its own.  It calls, in the order of `ClosedLoop.tick`, the
    compiled functions that the parts of a run call as well: `step_eq14` and `step` of the
    plants, `is_stable`, `delayed`, `read_out`, `sensed_point`, `command_at`, `transpose_law`.
    The torques of law ``open_loop`` do not depend on the state: `OpenLoopLaw.torques` gives those
    of a block beforehand.  The results are equal to the bit, since no option of the compiler lets
    it reorder or fuse operations (`flexarm_ros.core.numerics.compiled`).

One state
    A block advances the `ClosedLoop` itself: the arrays of plant and delay lines in place, noise,
    held sample, torque, tick and verdict after the block.  So blocks and single ticks may
    alternate, and a live change is the loop's own `retune` between two blocks.

Records
    What a compiled function needs of a part is a record made by that part (``record()``, a
    ``NamedTuple`` or a structured array).  Records are made anew after each live change.

    Functions that take whole records are inlined: a call would copy every array's description.

Blocks
    A block ends before a live change, at the end of the run, and where the run becomes unstable.
    The records are converted once a block, which takes as long as some ten ticks of the loop.

Channels
    What is drawn at random depends on the seed and the tick alone, so that it is known before the
    block: noise, and by latency, jitter, loss and rate which sample arrives at which tick.
    `LatencyChannel.plan`, of the channel that a node has as well, gives this; the kernel takes
    each tick's sample into a pool and reads from it the one that arrives (`Delivery`).  So does
    the controller with its rate and delay (`ControllerPart.plan`).

Which runs
    `Kernel.of` is the one predicate: it returns ``None`` for a run with anything that the kernel
    does not know (a law in Python, further sensors, another part, a subclass of a known one).
    Such a run takes single ticks.  A new feature of a known part is added to the kernel, or
    refused there; ``test/core/run/test_kernel.py`` tries every key of a scenario.

The loops for the two plants are written out, because compiled code that is kept on disk cannot
take the step function as an argument.
"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any, NamedTuple

from flexarm_ros.core.arm.full.dynamics import step as step_full
from flexarm_ros.core.arm.full.plant import FullPlant, FullRecord
from flexarm_ros.core.arm.kinematics import sensed_point, SensedPoint
from flexarm_ros.core.arm.plant import is_stable
from flexarm_ros.core.arm.plant_eq14 import Eq14Plant, Eq14Record, step_eq14
from flexarm_ros.core.control.open_loop import OpenLoopLaw
from flexarm_ros.core.control.pd import FlsLaw, PdLaw, SETTINGS, transpose_law
from flexarm_ros.core.numerics.compiled import compiled, FloatArray, inlined
from flexarm_ros.core.run import part, parts
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.required_parts import ControllerPart, TrajectoryPart
from flexarm_ros.core.run.state import Block, Four
from flexarm_ros.core.sensing.channel import Delivery
from flexarm_ros.core.sensing.delay import delayed
from flexarm_ros.core.sensing.parts import EncoderPart, TipSensorPart
from flexarm_ros.core.sensing.sensors import Encoder, read_out, Readout, TipSensor
from flexarm_ros.core.timeline import T0_NS
from flexarm_ros.core.trajectory import command_at, Reference, Sides
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
Torque = tuple[float, float]


class LawRecord(NamedTuple):
    """
    A law for compiled code.

    ``open_loop``: the torques are those of `Ticks.planned`; the other laws use ``settings``;
    ``every``: ticks between torques.
    """

    every: int
    open_loop: bool
    settings: NDArray[np.void]


class LoopRecord(NamedTuple):
    """A closed loop without its plant, for compiled code, between two live changes."""

    period_ns: int
    limits: tuple[float, float]
    encoder: Readout
    tip: Readout
    point: SensedPoint
    sides: Sides
    reference_delay_ns: int
    law: LawRecord


class Way(NamedTuple):
    """
    The transport of a part's messages to their receiver in the n ticks of a block.

    ``pool``, ``picks``: see `Delivery`; ``noise`` (n, 2): of each tick at which a sample arrives,
    or no rows; ``out`` (n, width): what the receiver has, row 0 at first that of the tick before.
    """

    pool: FloatArray
    picks: IntArray
    noise: FloatArray
    out: FloatArray


class Ticks(NamedTuple):
    """
    What a block computes, one row a tick.

    ``state`` (n, 2 c + 4): the values of ``plant/state``; ``encoder``, ``tip``: of four values,
    ``torque``, N m: of two; ``reference`` (n, 4); ``gain`` (n,): lambda or nan, row 0 at first
    that of the tick before.  ``planned`` (n, 2): the torques of law ``open_loop``, which are known
    before the block.
    """

    state: FloatArray
    encoder: Way
    tip: Way
    reference: FloatArray
    torque: Way
    gain: FloatArray
    planned: FloatArray


@compiled
def run_eq14(
    plant: Eq14Record,
    loop: LoopRecord,
    first: int,
    ends: Four,
    torque: Torque,
    ticks: Ticks,
) -> int:
    """
    Run ticks from ``first`` on, at most as many as ``ticks`` has rows; return their number.

    ``ends``: deflections of the plant's state; ``torque``: that of the tick before.  The run
    ends before a tick whose state is not stable, and after one whose torque is not finite.
    """
    q, qd = plant.state[0], plant.state[1]
    for i in range(len(ticks.gain)):
        if first + i > 0:
            ends = step_eq14(
                plant.state, torque[0], torque[1], plant.step, plant.substeps, plant.mass,
                plant.diagonals, plant.coupling, plant.matrix, plant.work,
            )  # fmt: skip
        if not is_stable(ends, loop.limits, q, qd):
            return i
        torque = _answer(loop, first, i, q, qd, ends, ticks)
        if not (math.isfinite(torque[0]) and math.isfinite(torque[1])):
            return i + 1
    return len(ticks.gain)


@compiled
def run_full(
    plant: FullRecord,
    loop: LoopRecord,
    first: int,
    ends: Four,
    torque: Torque,
    ticks: Ticks,
) -> int:
    """Do the same as `run_eq14`, for the other plant."""
    q, qd = plant.q, plant.qd
    for i in range(len(ticks.gain)):
        if first + i > 0:
            ends = step_full(
                plant.constants, q, qd, torque[0], torque[1], plant.step, plant.substeps,
                plant.order, plant.work,
            )  # fmt: skip
        if not is_stable(ends, loop.limits, q, qd):
            return i
        torque = _answer(loop, first, i, q, qd, ends, ticks)
        if not (math.isfinite(torque[0]) and math.isfinite(torque[1])):
            return i + 1
    return len(ticks.gain)


@inlined
def _answer(
    loop: LoopRecord, first: int, i: int, q: FloatArray, qd: FloatArray, ends: Four, ticks: Ticks
) -> Torque:
    """Let sensors, trajectory and controller answer the state of tick ``first + i``."""
    k = first + i
    _keep_state(ticks.state[i], q, qd, ends)
    a, b, da, db = delayed(loop.encoder.line, k, q[0], q[1], qd[0], qd[1])
    encoder = _receive(loop.encoder, ticks.encoder, i, a, b, da, db)
    x, y, vx, vy = sensed_point(loop.point, q, qd)
    x, y, vx, vy = delayed(loop.tip.line, k, x, y, vx, vy)
    tip = _receive(loop.tip, ticks.tip, i, x, y, vx, vy)
    reference = command_at(
        loop.sides.times, loop.sides.lines, loop.sides.lap_ns, loop.sides.smooth,
        k * loop.period_ns - loop.reference_delay_ns,
    )  # fmt: skip
    for j in range(4):
        ticks.reference[i, j] = reference[j]
    law, way, before = loop.law, ticks.torque, max(i - 1, 0)
    if law.every > 1 and k % law.every:
        ticks.gain[i] = ticks.gain[before]
    else:
        if law.open_loop:
            tau1, tau2, gain = ticks.planned[i, 0], ticks.planned[i, 1], math.nan
        else:
            joints, deflection = (q[0], q[1], qd[0], qd[1]), (ends[0], ends[1])
            tau1, tau2, gain = transpose_law(
                law.settings, joints, deflection, encoder, tip, reference
            )
        here = len(way.pool) - len(way.out) + i
        way.pool[here, 0], way.pool[here, 1], ticks.gain[i] = tau1, tau2, gain
    pick = way.picks[i]
    for j in range(2):
        way.out[i, j] = way.out[before, j] if pick < 0 else way.pool[pick, j]
    return way.out[i, 0], way.out[i, 1]


@inlined
def _keep_state(row: FloatArray, q: FloatArray, qd: FloatArray, ends: Four) -> None:
    """Put the values of ``plant/state`` into ``row``: see `flexarm_ros.core.run.state.State`."""
    n = len(q)
    for j in range(n):
        row[j], row[n + 2 + j] = q[j], qd[j]
    row[n], row[n + 1], row[2 * n + 2], row[2 * n + 3] = ends


@inlined
def _receive(sensor: Readout, way: Way, i: int, a: float, b: float, c: float, d: float) -> Four:
    """Take the sample of the block's tick ``i`` into the pool; return what the receiver has."""
    pool, out, pick = way.pool, way.out, way.picks[i]
    here, before = len(pool) - len(out) + i, max(i - 1, 0)
    pool[here, 0], pool[here, 1], pool[here, 2], pool[here, 3] = a, b, c, d
    if pick < 0:
        a, b, c, d = out[before, 0], out[before, 1], out[before, 2], out[before, 3]
    else:
        first, second = (way.noise[i, 0], way.noise[i, 1]) if len(way.noise) else (0.0, 0.0)
        a, b = read_out(
            pool[pick, 0], pool[pick, 1], sensor.noise_std, first, second, sensor.resolution
        )
        c, d = pool[pick, 2], pool[pick, 3]
    out[i, 0], out[i, 1], out[i, 2], out[i, 3] = a, b, c, d
    return a, b, c, d


_RUN: dict[type, Any] = {Eq14Plant: run_eq14, FullPlant: run_full}
_PARTS = (EncoderPart, TipSensorPart, TrajectoryPart, ControllerPart)
_LAWS = (PdLaw, FlsLaw, OpenLoopLaw)
_NO_NOISE, _NO_PLAN, _NO_SETTINGS = np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(1, SETTINGS)


class Kernel:
    """Runs a `ClosedLoop` in blocks; made by `Kernel.of`."""

    @staticmethod
    def of(loop: ClosedLoop) -> Kernel | None:
        """Return the kernel of ``loop``, ``None`` for one that needs single ticks."""
        answering: list[Any] = list(loop.answers.parts.values())
        known = tuple(map(type, answering)) == _PARTS and type(loop.plant) in _RUN
        if not known or type(loop.law) not in _LAWS or len(answering[1].sensors) > 1:
            return None
        encoder, tip = answering[0].sensor, answering[1].sensors[0]
        if encoder.offset is not None:
            return None
        return Kernel(loop, encoder, tip, answering[2].reference, answering[3])

    def __init__(
        self, loop: ClosedLoop, encoder: Encoder, tip: TipSensor, reference: Reference,
        controller: ControllerPart,
    ) -> None:  # fmt: skip
        self._loop = loop
        plant: Any = loop.plant
        self._encoder, self._tip, self._reference = encoder, tip, reference
        self._controller = controller
        self._topics = [signal.name for _, signal in parts.signals(loop.config)]
        self._width = 2 * len(loop.plant.names) + 4
        self._run = _RUN[type(loop.plant)]
        self._plant_record = plant.record()
        self._config, self._record = loop.config, self._make_record()

    def block(self, most: int) -> Block:
        """Run at most ``most`` ticks and return what is published in them; none at the end."""
        loop = self._loop
        first, count = loop.k, loop.begin_block(most)
        if loop.config is not self._config:
            self._config, self._record = loop.config, self._make_record()
        deliveries = self._plan(first, count)
        ticks = self._make_ticks(first, count, *deliveries)
        ends, torque = loop.plant.deflections(), loop.torque or (0.0, 0.0)
        done = self._run(self._plant_record, self._record, first, ends, torque, ticks)
        loop.plant.set_state(loop.plant.q, loop.plant.qd)  # and the deflections with it
        if done:
            loop.law.gain = ticks.gain[done - 1].item()
            loop.torque = tuple(ticks.torque.out[done - 1].tolist())
        self._controller.end_plan(deliveries[2], loop.torque or (0.0, 0.0))
        stamps = []
        sensors: tuple[Encoder | TipSensor, ...] = (self._encoder, self._tip)
        ways = ticks.encoder, ticks.tip
        for sensor, delivery, way in zip(sensors, deliveries[:2], ways, strict=True):
            sensor.channel.end_plan(delivery)
            stamps.append(_held_stamps(delivery, sensor.held[0]))
            if done:
                sensor.held = (stamps[-1][done - 1].item(), *way.out[done - 1].tolist())
        loop.end_block(done, count)
        return self._make_block(first, done, ticks, stamps)

    def _make_record(self) -> LoopRecord:
        loop, law = self._loop, self._loop.law
        assert isinstance(law, (PdLaw, OpenLoopLaw))
        open_loop = isinstance(law, OpenLoopLaw)
        settings = _NO_SETTINGS if isinstance(law, OpenLoopLaw) else law.settings
        law_record = LawRecord(self._controller.every, open_loop, settings)
        return LoopRecord(
            loop.timeline.period_ns, loop.plant.limits, self._encoder.record(),
            self._tip.record(), self._tip.point.record(), self._reference.path.record,
            self._reference.delay_ns, law_record,
        )  # fmt: skip

    def _plan(self, first: int, count: int) -> tuple[Delivery, Delivery, Delivery]:
        """Return what arrives of encoder, tip sensor and controller in the next ticks."""
        return (
            self._encoder.channel.plan(first, count), self._tip.channel.plan(first, count),
            self._controller.plan(first, count),
        )  # fmt: skip

    def _make_ticks(
        self, first: int, count: int, encoder: Delivery, tip: Delivery, torque: Delivery
    ) -> Ticks:
        law = self._loop.law
        planned = law.torques(first, count) if isinstance(law, OpenLoopLaw) else _NO_PLAN
        ticks = Ticks(
            np.empty((count, self._width)), _sensor_way(self._encoder, encoder),
            _sensor_way(self._tip, tip), np.empty((count, 4)),
            Way(torque.pool, torque.picks, _NO_NOISE, np.empty((count, 2))), np.empty(count),
            planned,
        )  # fmt: skip
        if count:
            ticks.torque.out[0], ticks.gain[0] = self._controller.out, law.gain
        return ticks

    def _make_block(
        self, first: int, count: int, ticks: Ticks, stamps: Sequence[IntArray]
    ) -> Block:
        now = T0_NS + np.arange(first, first + count) * self._record.period_ns
        found = {
            part.CLOCK: (now, np.empty((count, 0))),
            part.STATE: (now, ticks.state),
            part.JOINT_STATES: (stamps[0], ticks.encoder.out),
            part.TIP: (stamps[1], ticks.tip.out),
            part.REFERENCE: (now, ticks.reference),
            part.COMMAND: (now, ticks.torque.out),
        }
        columns = [found[topic] for topic in self._topics]
        return Block(
            first, tuple(stamps[:count] for stamps, _ in columns),
            tuple(values[:count] for _, values in columns),
        )  # fmt: skip


def _sensor_way(sensor: Encoder | TipSensor, delivery: Delivery) -> Way:
    """Return the transport of a sensor's samples in a block, with the noise of arriving ones."""
    count, arrives = len(delivery.picks), delivery.picks >= 0
    noise, out = _NO_NOISE, np.empty((count, 4))
    if sensor.noise_std > 0.0:
        noise = np.zeros((count, 2))
        noise[arrives] = sensor.noise.pairs(int(np.count_nonzero(arrives)))
    if count:
        out[0] = sensor.held[1:]
    return Way(delivery.pool, delivery.picks, noise, out)


def _held_stamps(delivery: Delivery, before: int) -> IntArray:
    """Return the stamps of what the receiver has: of the newest sample, at first ``before``."""
    if delivery.picks.min(initial=0) == 0:
        return delivery.stamps
    rows = np.where(delivery.picks >= 0, np.arange(len(delivery.picks)), -1)
    newest = np.maximum.accumulate(rows)
    return np.where(newest < 0, before, delivery.stamps[np.maximum(newest, 0)])
