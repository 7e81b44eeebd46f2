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

"""The ``full`` plant: two inextensible Euler-Bernoulli links with every inertia term."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

from flexarm_ros.core.arm.full.dynamics import (
    acceleration,
    end_deflections,
    energy,
    make_work,
    mass_and_bias,
    step,
)
from flexarm_ros.core.arm.full.model import make_constants
from flexarm_ros.core.arm.plant import (
    choose_substeps,
    deflection_limits,
    STABLE_PHASE,
    steps_for,
)
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.linalg import largest_rate
from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.numerics.runge_kutta import DOP853, RK4
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
from flexarm_ros.core.signals import coordinate_names
from flexarm_ros.core.timeline import Timeline
import numpy as np

ACCURATE_PHASE = 0.33
"""Default phase of the fastest coordinate in one integrator step, rad.

RK4 reduces an undamped mode's amplitude by phase^6 / 144 per step: 9e-6 at
0.33 rad.  The fastest coordinate of this model belongs to the discretisation
(several times the highest mode that the basis resolves) and hardly moves;
modes of a third of its frequency lose 1e-8 per step.  The energy of a free
motion then stays within 1e-6 over 5 s even after torque pulses.
"""

_CLASSICAL_STEPS = 2
"""
Most steps of RK4 per tick; beyond, DOP853 with steps of up to ``STABLE_PHASE`` rad is used.

Its 12 evaluations cost as many as three steps of RK4, and are more exact.  At 2 rad it reduces an
undamped mode's amplitude by 2.7e-5 per step, at 1.5 rad by 1.5e-6, at 1 rad by 2.4e-8; it is
stable up to 5.96 rad.
"""

_ANGLES = 25
"""Elbow angles from 0 to pi at which the highest rate is evaluated."""


class FullRecord(NamedTuple):
    """The arguments of `step` beside the torques, for compiled code."""

    constants: Records
    q: FloatArray
    qd: FloatArray
    step: float
    substeps: int
    order: int
    work: Records


class FullPlant:
    """
    The arm of :mod:`flexarm_ros.core.arm.full.model`; a ``Plant``.

    ``q`` and ``qd``, shape ``(2 + 2 modes,)``, in the order of ``names``:
    theta1, theta2 (rad), then the coordinates of link 1 and link 2 (m); views
    that :meth:`step` and :meth:`set_state` change in place.  Starts straight
    and at rest at theta1 = theta2 = 0.  Raises ``ValueError`` if ``plant.substeps`` is too
    small.
    """

    def __init__(self, config: RunConfig) -> None:
        period = Timeline.of(config.run).period
        self.names = coordinate_names(config.plant.modes)
        self.limits = deflection_limits(config.plant)
        self.constants = make_constants(config.plant)
        self.order, self.substeps = choose_integrator(config)
        self._step = period / self.substeps
        size = len(self.names)
        self.q: FloatArray = np.zeros(size)
        self.qd: FloatArray = np.zeros(size)
        self._work = make_work(config.plant.modes)
        self._ends = (0.0, 0.0, 0.0, 0.0)
        self._torque = (0.0, 0.0)

    def step(self, tau1: float, tau2: float) -> None:
        """Advance by one tick with the joint torques, N m, held."""
        self._torque = tau1, tau2
        self._ends = step(
            self.constants, self.q, self.qd, tau1, tau2, self._step, self.substeps, self.order,
            self._work,
        )  # fmt: skip

    def deflections(self) -> tuple[float, float, float, float]:
        """Return delta1, delta2 (m) and their rates (m/s)."""
        return self._ends

    def set_state(self, q: Sequence[float] | FloatArray, qd: Sequence[float] | FloatArray) -> None:
        """Overwrite the state, shapes ``(2 + 2 modes,)``."""
        self.q[:] = q
        self.qd[:] = qd
        self._torque = (0.0, 0.0)
        self._ends = end_deflections(self.constants, self.q, self.qd)

    def acceleration(self) -> list[float]:
        """Return q'': see `flexarm_ros.core.arm.plant.Plant`."""
        out = np.zeros(len(self.names))
        acceleration(self.constants, self.q, self.qd, *self._torque, self._work, out)
        found: list[float] = out.tolist()
        return found

    def record(self) -> FullRecord:
        """Return the plant for compiled code, which advances it in place."""
        return FullRecord(
            self.constants, self.q, self.qd, self._step, self.substeps, self.order, self._work
        )

    def energy(self) -> float:
        """Return the kinetic plus the elastic energy, J."""
        return float(energy(self.constants, self.q, self.qd, self._work)[0])

    def momentum(self) -> float:
        """
        Return the momentum conjugate to theta1, N m s.

        Without hub inertia this is the angular momentum about the shoulder.
        """
        return float(energy(self.constants, self.q, self.qd, self._work)[1])


def mass_matrix(plant: PlantParameters, q: FloatArray) -> FloatArray:
    """Return M(q), shape ``(2 + 2N, 2 + 2N)``, of the full model at ``q``."""
    work = make_work(plant.modes)
    at = np.array(q, dtype=float)
    mass_and_bias(make_constants(plant), at, np.zeros_like(at), work)
    lower = np.transpose(work[0].mass)
    return np.asarray(np.tril(lower) + np.transpose(np.tril(lower, -1)))


def elastic_diagonals(plant: PlantParameters) -> tuple[FloatArray, FloatArray]:
    """
    Return the diagonals of stiffness and damping, shape ``(2 + 2N,)``.

    Those of the joints are 0 and the viscous friction.
    """
    links = make_constants(plant)[0].links
    return (
        np.concatenate([np.zeros(2), links['stiffness'].ravel()]),
        np.concatenate([np.array(plant.viscous_friction), links['damping'].ravel()]),
    )


def highest_frequency(config: RunConfig, parted: tuple[float, float] = (0.0, 0.0)) -> float:
    """
    Return the largest natural rate |s| of the straight-linked arm, 1/s, over elbow angles.

    ``parted``: inertia, kg m^2, of each joint's rotor that is free within its gap.
    """
    stiffness, damping = elastic_diagonals(config.plant)
    q = np.zeros(len(stiffness))
    masses = []
    for pose in range(_ANGLES):
        q[1] = math.pi * pose / (_ANGLES - 1)
        mass = mass_matrix(config.plant, q)
        mass[0, 0] -= parted[0]
        mass[1, 1] -= parted[1]
        masses.append(mass)
    return largest_rate(np.stack(masses), damping, stiffness)


def choose_integrator(config: RunConfig) -> tuple[int, int]:
    """
    Return the order of the integrator, 4 or 8, and its steps per tick.

    The order follows from the highest frequency and the tick alone, so that more
    ``plant.substeps`` are always more exact.  Raises ``ValueError`` for too few of them.
    """
    period, highest = Timeline.of(config.run).period, highest_frequency(config)
    classical = steps_for(highest, period, ACCURATE_PHASE)
    order = RK4.order if classical <= _CLASSICAL_STEPS else DOP853.order
    if config.plant.substeps is not None:
        return order, choose_substeps(config.plant, period, highest)
    return order, classical if order == RK4.order else steps_for(highest, period, STABLE_PHASE)
