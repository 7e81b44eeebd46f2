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
    plants, `is_stable`, `delayed`, `read_out`, `sensed_point`, `command_at`, `transpose_law`,
    `torque_at`.  The results are equal to the bit, since no option of the compiler lets it
    reorder or fuse operations (`flexarm_ros.core.numerics.compiled`).

One state
    A block advances the `ClosedLoop` itself: the arrays of plant and delay lines in place, noise,
    held sample, torque, tick and verdict after the block.  So blocks and single ticks may
    alternate, and a live change is the loop's own `retune` between two blocks.

Records
    What a compiled function needs of a part is a record made by that part (``record()``, a
    ``NamedTuple`` or a structured array).  Records are made anew after each live change.

    Functions that take whole records are inlined: in a call, the references of every array in
    them are counted, which took a third of a tick.

Blocks
    A block ends before a live change, at the end of the run, and where the run becomes unstable.
    Noise is drawn before the block, since the generator is NumPy's.  The records are converted
    once a block, which takes as long as some ten ticks of the loop.

Which runs
    `Kernel.of` is the one predicate: it returns ``None`` for a run with anything that the kernel
    does not know (a law in Python, further sensors, another part, a subclass of a known one).
    Such a run takes single ticks.  A new feature of a known part is added to the kernel, or
    refused there; ``test/core/run/test_kernel.py`` tries every key of a scenario.

The loops for the two plants are written out, because compiled code that is kept on disk cannot
take the step function as an argument.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from flexarm_ros.core.arm.full.dynamics import step as step_full
from flexarm_ros.core.arm.full.plant import FullPlant, FullRecord
from flexarm_ros.core.arm.kinematics import sensed_point, SensedPoint
from flexarm_ros.core.arm.plant import is_stable
from flexarm_ros.core.arm.plant_eq14 import Eq14Plant, Eq14Record, step_eq14
from flexarm_ros.core.control.open_loop import OpenLoopLaw, torque_at
from flexarm_ros.core.control.pd import FlsLaw, PdLaw, SETTINGS, transpose_law
from flexarm_ros.core.numerics.compiled import compiled, FloatArray, inlined
from flexarm_ros.core.run import part, parts
from flexarm_ros.core.run.block import Block
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.state import Four
from flexarm_ros.core.sensing.delay import delayed
from flexarm_ros.core.sensing.sensors import Encoder, read_out, Readout, TipSensor
from flexarm_ros.core.timeline import T0_NS
from flexarm_ros.core.trajectory import command_at, Reference, Sides
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]
Torque = tuple[float, float]


class LawRecord(NamedTuple):
    """``table``: of law ``open_loop``, without rows for the others, which use ``settings``."""

    settings: NDArray[np.void]
    table: FloatArray
    torque_limit: float


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


class Ticks(NamedTuple):
    """
    What a block computes, one row a tick.

    ``noise`` of the sensors is drawn before: rows of two, one for each sample.  ``state``
    (n, 2 c + 4): the values of ``plant/state``; ``encoder``, ``tip``, ``reference`` (n, 4);
    ``tip_stamps`` (n,), ns; ``torque`` (n, 2), N m; ``gain`` (n,): lambda or nan.
    """

    encoder_noise: FloatArray
    tip_noise: FloatArray
    state: FloatArray
    encoder: FloatArray
    tip: FloatArray
    tip_stamps: IntArray
    reference: FloatArray
    torque: FloatArray
    gain: FloatArray


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
    encoder = _measure_joints(loop.encoder, k, q, qd, ticks.encoder_noise, i)
    tip = _measure_tip(loop, k, i, q, qd, ticks)
    reference = command_at(
        loop.sides.times, loop.sides.lines, loop.sides.lap_ns, loop.sides.smooth,
        k * loop.period_ns - loop.reference_delay_ns,
    )  # fmt: skip
    law = loop.law
    if len(law.table):
        tau1, tau2 = torque_at(law.table, k, loop.period_ns, law.torque_limit)
        gain = math.nan
    else:
        joints, deflection = (q[0], q[1], qd[0], qd[1]), (ends[0], ends[1])
        tau1, tau2, gain = transpose_law(law.settings, joints, deflection, encoder, tip, reference)
    for j in range(4):
        ticks.encoder[i, j], ticks.tip[i, j] = encoder[j], tip[j]
        ticks.reference[i, j] = reference[j]
    ticks.torque[i, 0], ticks.torque[i, 1], ticks.gain[i] = tau1, tau2, gain
    return tau1, tau2


@inlined
def _keep_state(row: FloatArray, q: FloatArray, qd: FloatArray, ends: Four) -> None:
    """Put the values of ``plant/state`` into ``row``: see `flexarm_ros.core.run.state.State`."""
    n = len(q)
    for j in range(n):
        row[j], row[n + 2 + j] = q[j], qd[j]
    row[n], row[n + 1], row[2 * n + 2], row[2 * n + 3] = ends


@inlined
def _measure_joints(
    encoder: Readout, k: int, q: FloatArray, qd: FloatArray, noise: FloatArray, i: int
) -> Four:
    """Return the joint angles and rates as measured at tick ``k``."""
    a, b, da, db = delayed(encoder.line, k, q[0], q[1], qd[0], qd[1])
    first, second = (noise[i, 0], noise[i, 1]) if len(noise) else (0.0, 0.0)
    a, b = read_out(a, b, encoder.noise_std, first, second, encoder.resolution)
    return a, b, da, db


@inlined
def _measure_tip(
    loop: LoopRecord, k: int, i: int, q: FloatArray, qd: FloatArray, ticks: Ticks
) -> Four:
    """Return the sensed point as measured at tick ``k``: a new sample, or that of row i - 1."""
    tip = loop.tip
    x, y, vx, vy = sensed_point(loop.point, q, qd)
    x, y, vx, vy = delayed(tip.line, k, x, y, vx, vy)
    if k % tip.every:
        before = max(i - 1, 0)  # row 0 holds the sample from before the block
        ticks.tip_stamps[i] = ticks.tip_stamps[before]
        row = ticks.tip[before]
        return row[0], row[1], row[2], row[3]
    ticks.tip_stamps[i] = T0_NS + k * loop.period_ns - tip.latency_ns
    sample = _samples(k, tip.every) - _samples(k - i, tip.every)
    noise = ticks.tip_noise
    first, second = (noise[sample, 0], noise[sample, 1]) if len(noise) else (0.0, 0.0)
    x, y = read_out(x, y, tip.noise_std, first, second, tip.resolution)
    return x, y, vx, vy


@compiled
def _samples(k: int, every: int) -> int:
    """Return the number of samples before tick ``k``."""
    return (k + every - 1) // every


_RUN: dict[type, Any] = {Eq14Plant: run_eq14, FullPlant: run_full}
_PARTS = (parts.EncoderPart, parts.TipSensorPart, parts.TrajectoryPart, parts.ControllerPart)
_LAWS = (PdLaw, FlsLaw, OpenLoopLaw)
_NO_TABLE, _NO_NOISE, _NO_SETTINGS = np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(1, SETTINGS)


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
        if encoder.offset is not None or encoder.channel.every > 1:
            return None
        if answering[3].every > 1 or answering[3].delay:
            return None
        # Samples with an arrival of their own, from the first tick or from a live change on.
        changed = any(change.key in ('jitter', 'dropout') for change in loop.config.changes)
        if changed or encoder.channel.scheduled or tip.channel.scheduled:
            return None
        return Kernel(loop, encoder, tip, answering[2].reference)

    def __init__(
        self, loop: ClosedLoop, encoder: Encoder, tip: TipSensor, reference: Reference
    ) -> None:
        self._loop = loop
        plant: Any = loop.plant
        self._encoder, self._tip, self._reference = encoder, tip, reference
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
        ticks = self._make_ticks(first, count)
        ends, torque = loop.plant.deflections(), loop.torque or (0.0, 0.0)
        done = self._run(self._plant_record, self._record, first, ends, torque, ticks)
        loop.plant.set_state(loop.plant.q, loop.plant.qd)  # and the deflections with it
        if done:
            self._tip.held = (ticks.tip_stamps[done - 1].item(), *ticks.tip[done - 1].tolist())
            loop.law.gain = ticks.gain[done - 1].item()
            loop.torque = tuple(ticks.torque[done - 1].tolist())
        loop.end_block(done, count)
        return self._make_block(first, done, ticks)

    def _make_record(self) -> LoopRecord:
        loop, law = self._loop, self._loop.law
        assert isinstance(law, (PdLaw, OpenLoopLaw))
        if isinstance(law, OpenLoopLaw):
            limit = loop.config.controller.torque_limit
            law_record = LawRecord(_NO_SETTINGS, law.table, limit)
        else:
            law_record = LawRecord(law.settings, _NO_TABLE, 0.0)
        return LoopRecord(
            loop.timeline.period_ns, loop.plant.limits, self._encoder.record(),
            self._tip.record(), self._tip.point.record(), self._reference.path.record,
            self._reference.delay_ns, law_record,
        )  # fmt: skip

    def _make_ticks(self, first: int, count: int) -> Ticks:
        every = self._record.tip.every
        samples = -(-(first + count) // every) + (-first // every)
        noisy = self._encoder.noise_std > 0.0, self._tip.noise_std > 0.0
        ticks = Ticks(
            self._encoder.noise.pairs(count) if noisy[0] else _NO_NOISE,
            self._tip.noise.pairs(samples) if noisy[1] else _NO_NOISE,
            np.empty((count, self._width)), np.empty((count, 4)), np.empty((count, 4)),
            np.empty(count, np.int64), np.empty((count, 4)), np.empty((count, 2)),
            np.empty(count),
        )  # fmt: skip
        if count:
            ticks.tip_stamps[0], ticks.tip[0] = self._tip.held[0], self._tip.held[1:]
        return ticks

    def _make_block(self, first: int, count: int, ticks: Ticks) -> Block:
        now = T0_NS + np.arange(first, first + count) * self._record.period_ns
        found = {
            part.CLOCK: (now, np.empty((count, 0))),
            part.STATE: (now, ticks.state),
            part.JOINT_STATES: (now - self._record.encoder.latency_ns, ticks.encoder),
            part.TIP: (ticks.tip_stamps, ticks.tip),
            part.REFERENCE: (now, ticks.reference),
            part.COMMAND: (now, ticks.torque),
        }
        columns = [found[topic] for topic in self._topics]
        return Block(
            first, tuple(stamps[:count] for stamps, _ in columns),
            tuple(values[:count] for _, values in columns),
        )  # fmt: skip
