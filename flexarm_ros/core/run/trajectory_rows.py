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

The same function computes the rows of a run in one process and those of a bag, so that the two
agree bit for bit.
"""

from __future__ import annotations

from collections.abc import Collection
import math

from flexarm_ros.core.arm.kinematics import elastic_point, make_point, rigid_point
from flexarm_ros.core.control import gain_of
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.changes import Agenda
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.parts import columns
from flexarm_ros.core.timeline import NS_PER_S, Timeline
from flexarm_ros.core.trajectory import Reference

COLUMNS = (
    't', 'theta1', 'theta2', 'dtheta1', 'dtheta2', 'delta1', 'delta2', 'elbow_x', 'elbow_y',
    'tip_x', 'tip_y', 'rigid_x', 'rigid_y', 'meas_x', 'meas_y', 'ref_x', 'ref_y', 'tau1', 'tau2',
    'lambda',
)  # fmt: skip
"""Header of ``trajectory.csv`` as far as it is the same in every run: s, rad, rad/s, m, N m."""

Row = tuple[float, ...]


def header(config: RunConfig) -> tuple[str, ...]:
    """Return the header of ``trajectory.csv``: `COLUMNS`, then those of optional parts."""
    return (*COLUMNS, *(column.name for column in columns(config)))


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
        self._period_ns = Timeline.of(config.run).period_ns
        self._reference = Reference(config)
        self._lengths = config.plant.spans
        elbow = make_point(config.plant, self._lengths[0], elastic=True)
        tip = make_point(config.plant, self._lengths[0] + self._lengths[1], elastic=True)
        self._shapes = (elbow.shapes, elbow.shortening, tip.shapes, tip.shortening)

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
        if k >= self._agenda.next:  # lambda depends on kn
            for change in self._agenda.due(k):
                self.config = changed(self.config, change)
        reference = self._reference.at(k) if self._own_reference else published
        joints_and_points = outline(q, qd, *self._lengths, *self._shapes)
        th1, th2, dth1, dth2 = joints_and_points[:4]
        return (
            k * self._period_ns / NS_PER_S, th1, th2, dth1, dth2, *deflection,
            *joints_and_points[4:], *measured, reference[0], reference[1], *torque,
            gain_of(self.config, *deflection) if self._own_law else math.nan, *further,
        )  # fmt: skip


@compiled
def outline(
    q: FloatArray,
    qd: FloatArray,
    length1: float,
    length2: float,
    elbow_shapes: FloatArray,
    elbow_shortening: FloatArray,
    tip_shapes: FloatArray,
    tip_shortening: FloatArray,
) -> tuple[float, float, float, float, float, float, float, float, float, float]:
    """Return theta1, theta2, their rates, and x, y of bent elbow, bent tip and rigid tip."""
    ex, ey, _, _ = elastic_point(q, qd, elbow_shapes, elbow_shortening)
    x, y, _, _ = elastic_point(q, qd, tip_shapes, tip_shortening)
    rx, ry, _, _ = rigid_point(length1, length2, q[0], q[1], 0.0, 0.0)
    return q[0], q[1], qd[0], qd[1], ex, ey, x, y, rx, ry
