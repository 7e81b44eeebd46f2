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
Rows of ``trajectory.csv``, one per tick, from the recorded messages of that tick.

The same compiled function computes the rows of a run in one process and those of a bag, so that
the two agree bit for bit.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
import math
from typing import NamedTuple

from flexarm_ros.core.arm.kinematics import elastic_point, make_point, rigid_point
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.changes import Agenda
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.part import COMMAND, REFERENCE, STATE, TIP
from flexarm_ros.core.run.parts import columns, signals
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.run.state import Block
from flexarm_ros.core.sensing.strain_gauge import deflection_scales, STRAIN
from flexarm_ros.core.timeline import NS_PER_S, Timeline
from flexarm_ros.core.trajectory import make_path, point_at, Sides
import numpy as np
from numpy.typing import ArrayLike

_REFERENCE = COLUMNS.index('ref_x')

Row = tuple[float, ...]


class RowRecord(NamedTuple):
    """
    What rows need of a scenario, for compiled code.

    ``sides``: of the trajectory; the last four: see `elastic_point`, of elbow and of tip.
    """

    period_ns: int
    sides: Sides
    length1: float
    length2: float
    elbow_shapes: FloatArray
    elbow_shortening: FloatArray
    tip_shapes: FloatArray
    tip_shortening: FloatArray


class Rows:
    """
    Computes the rows of one run.

    ``external``: roles of external nodes.  Lambda is nan with an external controller; the
    reference is that of an external trajectory as published.
    """

    def __init__(self, config: RunConfig, external: Collection[str] = ()) -> None:
        self.config = config
        self._own_law = 'controller' not in external
        self._own_reference = 'trajectory' not in external
        self._agenda = Agenda(config.changes)
        self._places = {signal.name: i for i, (_, signal) in enumerate(signals(config))}
        self._columns = columns(config)
        self._scales = deflection_scales(config)
        self._strains = [i for i, column in enumerate(self._columns) if column.topic == STRAIN]
        length1, length2 = config.plant.spans
        elbow = make_point(config.plant, length1, elastic=True)
        tip = make_point(config.plant, length1 + length2, elastic=True)
        self._record = RowRecord(
            Timeline.of(config.run).period_ns, make_path(config).record, length1, length2,
            elbow.shapes, elbow.shortening, tip.shapes, tip.shortening,
        )  # fmt: skip

    def table(self, block: Block) -> FloatArray:
        """Return the rows of a block, one a tick, in the order of `header`."""
        values = [block.values[self._places[t]] for t in (STATE, TIP, REFERENCE, COMMAND)]
        further = [block.values[self._places[c.topic]][:, c.place] for c in self._columns]
        return self._fill(block.first, values, further)

    def row(
        self,
        k: int,
        q: FloatArray,
        qd: FloatArray,
        deflection: tuple[float, float],
        measured: tuple[float, float],
        torque: tuple[float, float],
        published: tuple[float, float] = (math.nan, math.nan),
        further: tuple[float, ...] = (),
    ) -> Row:
        """
        Return the row of tick ``k`` in the order of `header`.

        ``q``, ``qd`` ``(n,)``: plant coordinates and rates; ``deflection``:
        delta1, delta2 (m); ``measured``: x, y of the sensed point as delivered
        (m); ``torque``: tau1, tau2 (N m); ``published``: x, y of the reference as
        recorded, used if the trajectory is external; ``further``: the values of the
        optional parts' columns.
        """
        state = np.array([[*q, *deflection, *qd, 0.0, 0.0]])  # rates of deflections: no column
        points = [np.array([values], float) for values in (measured, published, torque)]
        row: list[float] = self._fill(k, [state, *points], further)[0].tolist()
        return tuple(row)

    def _fill(
        self, first: int, values: Sequence[FloatArray], further: Sequence[ArrayLike]
    ) -> FloatArray:
        """Return rows from ``first`` on, from the values of state, tip, reference and command."""
        state, measured, published, torque = values
        count = len(state)
        bends = self._bends(state, further)
        table = np.empty((count, len(COLUMNS) + len(further)))
        done = 0
        while done < count:
            if first + done >= self._agenda.next:  # lambda depends on kn
                for change in self._agenda.due(first + done):
                    self.config = changed(self.config, change)
            end = int(min(count, self._agenda.next - first))
            law = self.config.controller
            fill_rows(
                self._record, first + done, state[done:end], bends[done:end],
                measured[done:end], torque[done:end],
                law.kn if self._own_law and law.law == 'fls' else 0.0, table[done:end],
            )  # fmt: skip
            done = end
        if not self._own_reference:
            table[:, _REFERENCE : _REFERENCE + 2] = published[:, :2]
        for i, column in enumerate(further, len(COLUMNS)):
            table[:, i] = column
        return table

    def _bends(self, state: FloatArray, further: Sequence[ArrayLike]) -> FloatArray:
        """Return the end deflections that the law used, m, (n, 2)."""
        if self._scales is None:
            place = state.shape[1] // 2 - 2
            return state[:, place : place + 2]
        readings = np.array([further[i] for i in self._strains], float).reshape(2, -1).T
        return np.asarray(readings * np.array(self._scales))


@compiled
def fill_rows(
    run: RowRecord, first: int, state: FloatArray, bends: FloatArray, measured: FloatArray,
    torque: FloatArray, kn: float, table: FloatArray,
) -> None:  # fmt: skip
    """
    Fill the `COLUMNS` of ``table`` (n, 20 or more), ticks from ``first`` on.

    ``state`` (n, 2 c + 4), ``measured`` (n, 2 or more), ``torque`` (n, 2): values of the
    messages; ``bends`` (n, 2): end deflections that the law used, m; ``kn``: of the fuzzy law, 0
    where lambda is nan.
    """
    n = state.shape[1] // 2 - 2
    for i in range(len(state)):
        k, row = first + i, table[i]
        q, qd = state[i, :n], state[i, n + 2 : -2]
        delta1, delta2 = state[i, n], state[i, n + 1]
        elbow = elastic_point(q, qd, run.elbow_shapes, run.elbow_shortening)
        tip = elastic_point(q, qd, run.tip_shapes, run.tip_shortening)
        rigid = rigid_point(run.length1, run.length2, q[0], q[1], 0.0, 0.0)
        path = run.sides
        reference = point_at(path.times, path.lines, path.lap_ns, path.smooth, k * run.period_ns)
        row[0] = k * run.period_ns / NS_PER_S
        row[1], row[2], row[3], row[4], row[5], row[6] = q[0], q[1], qd[0], qd[1], delta1, delta2
        row[7], row[8], row[9], row[10] = elbow[0], elbow[1], tip[0], tip[1]
        row[11], row[12], row[13], row[14] = rigid[0], rigid[1], measured[i, 0], measured[i, 1]
        row[15], row[16], row[17], row[18] = reference[0], reference[1], torque[i, 0], torque[i, 1]
        row[19] = fls_lambda(bends[i, 0] / kn, bends[i, 1] / kn) if kn > 0.0 else math.nan
