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
Equation (14) as the paper states it: the ``eq14`` plant.

Coordinates are (theta1, theta2, modes of link 1, modes of link 2); theta2 is
measured from the tangent at the end of link 1.  At zero deformation, with
n1, n2 the normals of the links, a material point moves with::

    link 1:  (x theta1' + phi1(x) . q1') n1
    link 2:  (L1 theta1' + phi1(L1) . q1') n1
             + (xi (theta1' + phi1'(L1) . q1' + theta2') + phi2(xi) . q2') n2

where x, xi and L1 count from the joints: phi is 0 on a link's rigid hub part and continues
along the tangent on its rigid end part.  n1 . n2 = cos theta2, so that the mass matrix is
M0 + cos(theta2) M1 with all couplings.  The right-hand side holds the torques and the Coriolis
and centrifugal terms of the rigid arm, on the rows of theta1 and theta2 only, and the modal
stiffness (and damping) on the others.  Neither energy nor angular momentum is conserved, since
(14) leaves out the elastic velocity terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

from flexarm_ros.core.arm.beam import ClampedFreeModes
from flexarm_ros.core.arm.plant import choose_substeps, deflection_limits, material_damping
from flexarm_ros.core.numerics.compiled import bound, compiled, FloatArray, internal
from flexarm_ros.core.numerics.elementary import sincos
from flexarm_ros.core.numerics.linalg import largest_rate, solve_symmetric
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
from flexarm_ros.core.signals import coordinate_names
from flexarm_ros.core.timeline import Timeline
import numpy as np


class Eq14Matrices:
    """
    The constant matrices of (14) for one arm with N modes per link, n = 2 + 2 N.

    ``mass``: ``(2, n, n)``, M = mass[0] + cos(theta2) mass[1], kg m^2, kg m, kg;
    ``stiffness`` and ``damping``: ``(n,)``, diagonals; those of the joints are 0 and the
    viscous friction;
    ``end_shape``: ``(n,)``, end deflection of each modal coordinate's own link;
    ``coupling``: kg m^2, factor of the rigid Coriolis terms.
    """

    def __init__(self, plant: PlantParameters) -> None:
        count = plant.modes
        link1, link2 = (
            ClampedFreeModes(
                plant.length[i], plant.mass_density[i], plant.flexural_rigidity[i], count
            )
            for i in (0, 1)
        )
        size = 2 + 2 * count
        first = slice(2, 2 + count)
        second = slice(2 + count, size)
        elbow, tip1, turn2 = np.zeros(size), np.zeros(size), np.zeros(size)
        bend1, bend2 = link1.shape(link1.length), link2.shape(link2.length)
        tip1[0], tip1[first] = 1.0, link1.slope(link1.length)
        elbow[0], elbow[first] = plant.spans[0], bend1 + plant.end_offset[0] * tip1[first]
        turn2[0], turn2[1], turn2[first] = 1.0, 1.0, tip1[first]
        tip2, tip2_slope = plant.spans[1] * turn2, turn2.copy()
        tip2_slope[second] = link2.slope(link2.length)
        tip2[second] = bend2 + plant.end_offset[1] * tip2_slope[second]

        hub1, hub2 = plant.hub_radius
        straight = _link_mass(link1, hub1, np.eye(size)[0], first)
        straight += _link_mass(link2, hub2, turn2, second)
        mass2 = plant.mass_density[1] * link2.length
        carried = mass2 + plant.payload_mass + plant.link_end_mass
        straight += carried * np.outer(elbow, elbow)
        straight += plant.link_end_inertia * np.outer(tip1, tip1)
        straight += plant.payload_mass * np.outer(tip2, tip2)
        straight += plant.payload_inertia * np.outer(tip2_slope, tip2_slope)
        straight[0, 0] += plant.hub_inertia[0]
        straight[1, 1] += plant.hub_inertia[1]

        moment2 = (0.5 * mass2 * link2.length + mass2 * hub2) * turn2 + plant.payload_mass * tip2
        moment2[second] += link2.mean
        bent = np.outer(elbow, moment2) + np.outer(moment2, elbow)

        self.mass: FloatArray = np.ascontiguousarray(np.stack([straight, bent]))
        self.stiffness = np.zeros(size)
        self.stiffness[first], self.stiffness[second] = (
            link1.modal_stiffness,
            link2.modal_stiffness,
        )
        self.damping = np.zeros(size)
        for i, part, link in ((0, first, link1), (1, second, link2)):
            self.damping[part] = 2.0 * plant.damping_ratio * link.modal_mass * link.frequencies
            self.damping[part] += material_damping(plant, i) * link.modal_stiffness
        self.damping[:2] = plant.viscous_friction
        self.end_shape = np.zeros(size)
        self.end_shape[first], self.end_shape[second] = bend1, bend2
        self.coupling = float(elbow[0] * moment2[1])

    def mass_at(self, theta2: float) -> FloatArray:
        """Return the mass matrix ``(n, n)`` at elbow angle ``theta2``, rad."""
        return np.asarray(self.mass[0] + sincos(theta2)[1] * self.mass[1])

    def highest_rate(self) -> float:
        """
        Return the largest |s|, 1/s, of M s^2 + D s + K over all elbow angles.

        For every x the Rayleigh quotient x'Kx / x'M x is convex in cos(theta2),
        since M is linear in it, and so is its maximum: the straight and the folded arm
        are the extremes.
        """
        extremes = np.stack([self.mass[0] + self.mass[1], self.mass[0] - self.mass[1]])
        return largest_rate(extremes, self.damping, self.stiffness)


def _link_mass(link: ClampedFreeModes, hub: float, turn: FloatArray, part: slice) -> FloatArray:
    """Mass matrix of a link about its joint, ``hub`` m from its start; it rotates at turn . qd."""
    inertia = link.mass_density * (link.length * link.length * link.length) / 3.0
    inertia += link.mass_density * link.length * hub * (hub + link.length)
    modal = np.zeros(len(turn))
    modal[part] = link.first_moment + hub * link.mean
    matrix = inertia * np.outer(turn, turn) + np.outer(turn, modal) + np.outer(modal, turn)
    index = np.arange(part.start, part.stop)
    matrix[index, index] += link.modal_mass
    return np.asarray(matrix)


@internal
def eq14_terms(
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    mass: FloatArray,
    diagonals: FloatArray,
    coupling: float,
    matrix: FloatArray,
    out: FloatArray,
) -> None:
    """Fill the mass matrix of (14), lower triangle of ``matrix``, and its forces, ``out``."""
    n = q.shape[0]
    sine, cosine = sincos(q[1])
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = mass[0, i, j] + cosine * mass[1, i, j]
        out[i] = -diagonals[0, i] * q[i] - diagonals[1, i] * qd[i]
    swirl = coupling * sine
    out[0] += tau1 + swirl * qd[1] * (2.0 * qd[0] + qd[1])
    out[1] += tau2 - swirl * qd[0] * qd[0]


@internal
def _acceleration(
    q: FloatArray,
    qd: FloatArray,
    tau1: float,
    tau2: float,
    mass: FloatArray,
    diagonals: FloatArray,
    coupling: float,
    matrix: FloatArray,
    out: FloatArray,
) -> None:
    """Solve (14) for the accelerations, into ``out``."""
    eq14_terms(q, qd, tau1, tau2, mass, diagonals, coupling, matrix, out)
    solve_symmetric(matrix, out)


@compiled
def step_eq14(
    state: FloatArray,
    tau1: float,
    tau2: float,
    step: float,
    substeps: int,
    mass: FloatArray,
    diagonals: FloatArray,
    coupling: float,
    matrix: FloatArray,
    work: FloatArray,
) -> tuple[float, float, float, float]:
    """
    Advance ``state`` ``(2, n)`` (positions, rates) by ``substeps`` steps of RK4.

    The torques (N m) are held; ``step`` in s; ``diagonals`` ``(3, n)``:
    stiffness, damping, end shape.  ``matrix`` ``(n, n)`` and ``work``
    ``(5, n)`` are scratch.  Returns the end deflections and their rates.
    """
    n = state.shape[1]
    q, qd = state[0], state[1]
    trial_q, trial_qd, rate_sum, qdd = work[0], work[1], work[2], work[3]
    half, sixth = 0.5 * step, step / 6.0
    for _ in range(substeps):
        # The classical scheme for q'' = a(q, q'), the position stages written out:
        # q + h (qd + h (a1 + a2 + a3) / 6) and qd + h (a1 + 2 a2 + 2 a3 + a4) / 6.
        _acceleration(q, qd, tau1, tau2, mass, diagonals, coupling, matrix, qdd)
        for i in range(n):
            rate_sum[i] = qdd[i]
            trial_q[i] = q[i] + half * qd[i]
            trial_qd[i] = qd[i] + half * qdd[i]
        _acceleration(trial_q, trial_qd, tau1, tau2, mass, diagonals, coupling, matrix, qdd)
        for i in range(n):
            trial_q[i] = q[i] + half * trial_qd[i]
            trial_qd[i] = qd[i] + half * qdd[i]
            work[4, i] = rate_sum[i] + qdd[i]
            rate_sum[i] += 2.0 * qdd[i]
        _acceleration(trial_q, trial_qd, tau1, tau2, mass, diagonals, coupling, matrix, qdd)
        for i in range(n):
            trial_q[i] = q[i] + step * trial_qd[i]
            trial_qd[i] = qd[i] + step * qdd[i]
            work[4, i] += qdd[i]
            rate_sum[i] += 2.0 * qdd[i]
        _acceleration(trial_q, trial_qd, tau1, tau2, mass, diagonals, coupling, matrix, qdd)
        for i in range(n):
            q[i] += step * (qd[i] + sixth * work[4, i])
            qd[i] += sixth * (rate_sum[i] + qdd[i])
    return end_deflections(state, diagonals[2])


@compiled
def end_deflections(state: FloatArray, shape: FloatArray) -> tuple[float, float, float, float]:
    """Return delta1, delta2 (m) and their rates (m/s) of ``state`` ``(2, n)``."""
    n = state.shape[1]
    half = (n - 2) // 2
    delta1, delta2, rate1, rate2 = 0.0, 0.0, 0.0, 0.0
    for i in range(2, 2 + half):
        delta1 += shape[i] * state[0, i]
        rate1 += shape[i] * state[1, i]
        delta2 += shape[i + half] * state[0, i + half]
        rate2 += shape[i + half] * state[1, i + half]
    return delta1, delta2, rate1, rate2


class Eq14Record(NamedTuple):
    """The arguments of `step_eq14` beside the torques, for compiled code."""

    state: FloatArray
    step: float
    substeps: int
    mass: FloatArray
    diagonals: FloatArray
    coupling: float
    matrix: FloatArray
    work: FloatArray


class Eq14Plant:
    """The arm of (14); see `flexarm_ros.core.arm.plant.Plant`."""

    def __init__(self, config: RunConfig) -> None:
        matrices = Eq14Matrices(config.plant)
        period = Timeline.of(config.run).period
        self.names = coordinate_names(config.plant.modes)
        self.limits = deflection_limits(config.plant)
        self.substeps = choose_substeps(config.plant, period, matrices.highest_rate())
        self._step = period / self.substeps
        size = len(self.names)
        self._state = np.zeros((2, size))
        self.q, self.qd = self._state[0], self._state[1]
        self._mass, self._coupling = matrices.mass, matrices.coupling
        self._diagonals = np.ascontiguousarray(
            np.stack([matrices.stiffness, matrices.damping, matrices.end_shape])
        )
        self._matrix, self._work = np.zeros((size, size)), np.zeros((5, size))
        self._ends = (0.0, 0.0, 0.0, 0.0)
        self._torque = (0.0, 0.0)

    def step(self, tau1: float, tau2: float) -> None:
        """Advance by one tick with the joint torques, N m, held."""
        self._torque = tau1, tau2
        self._ends = self._advance(
            self._state, tau1, tau2, self._step, self.substeps, self._mass, self._diagonals,
            self._coupling, self._matrix, self._work,
        )  # fmt: skip

    @cached_property
    def _advance(self) -> Any:
        record = self.record()
        return bound(step_eq14, example=(record.state, 0.0, 0.0, *record[1:]))

    def deflections(self) -> tuple[float, float, float, float]:
        """Return delta1, delta2 (m) and their rates (m/s)."""
        return self._ends

    def set_state(self, q: Sequence[float] | FloatArray, qd: Sequence[float] | FloatArray) -> None:
        """Overwrite the state, shapes ``(2 + 2 modes,)``."""
        self.q[:] = q
        self.qd[:] = qd
        self._torque = (0.0, 0.0)
        self._ends = end_deflections(self._state, self._diagonals[2])

    def acceleration(self) -> list[float]:
        """Return q'': see `flexarm_ros.core.arm.plant.Plant`."""
        out = self._work[3]
        _acceleration(
            self.q, self.qd, *self._torque, self._mass, self._diagonals, self._coupling,
            self._matrix, out,
        )  # fmt: skip
        found: list[float] = out.tolist()
        return found

    def record(self) -> Eq14Record:
        """Return the plant for compiled code, which advances it in place."""
        return Eq14Record(
            self._state, self._step, self.substeps, self._mass, self._diagonals, self._coupling,
            self._matrix, self._work,
        )  # fmt: skip
