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


"""The plant with friction and drives: either model, integrated between located events."""

from __future__ import annotations

from collections.abc import Sequence
import math

from flexarm_ros.core.arm.driven.dynamics import (
    end_acceleration,
    impulse,
    make_scratch,
    Rig,
    settle,
    step_driven,
)
from flexarm_ros.core.arm.driven.terms import make_terms
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.arm.plant import choose_substeps, deflection_limits, steps_for
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.parameters.rig import ActuatorParameters, DisturbanceParameters
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
from flexarm_ros.core.signals import coordinate_names
from flexarm_ros.core.timeline import Timeline
import numpy as np

MOST_PAYLOAD = 1e6
"""kg, as ``plant.payload_mass``."""

FULL_PHASE = 0.33
"""As ``ACCURATE_PHASE``, for the full model, whose fastest coordinates hardly move."""


class DrivenPlant:
    """
    An arm with friction and drives; see `flexarm_ros.core.arm.plant.Plant`.

    ``highest``: its highest rate, 1/s.  ``drives`` ``(2, 2)``: angles and rates of the drives,
    rad, rad/s, seen at the joints; a view.  Those of joints without backlash turn with them, the
    others are the rotors of `ActuatorParameters.rotors`.  Raises ``ValueError`` if
    ``plant.substeps`` is too small.
    """

    def __init__(self, config: RunConfig, highest: float) -> None:
        actuator = config.section('actuator') or ActuatorParameters()
        disturbance = config.section('disturbance') or DisturbanceParameters()
        plant, period = config.plant, Timeline.of(config.run).period
        self.names = coordinate_names(plant.modes)
        self.limits = deflection_limits(plant)
        self.substeps = driven_steps(plant, period, highest)
        self._step = period / self.substeps
        size = len(self.names)
        state = np.zeros((2, size + 2))
        self._pos, self._vel = state
        self.q: FloatArray = self._pos[:size]
        self.qd: FloatArray = self._vel[:size]
        self.drives: FloatArray = state[:, size:]
        self._lightest = disturbance.lightest(plant.payload_mass)
        self._mass = disturbance.payload_at(-period, plant.payload_mass)
        masses = disturbance.payload_masses or ()
        self._loads = {m: make_terms(plant, m) for m in {self._mass, *masses}}
        self._parameters, self._terms = plant, self._loads[self._mass]
        self._rig = _rig(plant, actuator)
        self._scratch = make_scratch(size)
        self._torque, self._target = np.zeros(2), np.zeros(2)
        self._bends = _bends(plant)
        self._moved = False

    def step(
        self, tau1: float, tau2: float, target1: float | None = None, target2: float | None = None
    ) -> None:
        """
        Advance by one tick with the drives' torques, N m.

        They are held, or with targets at the start of the tick, from where they approach the
        targets with the drives' bandwidth.
        """
        self._torque[0], self._torque[1] = tau1, tau2
        self._target[0] = tau1 if target1 is None else target1
        self._target[1] = tau2 if target2 is None else target2
        step_driven(
            self._terms, self._rig, self._pos, self._vel, self._torque, self._target, self._step,
            self.substeps, self._scratch,
        )  # fmt: skip
        self._moved = True

    @property
    def events(self) -> int:
        """Return the number of events in the last tick."""
        return int(self._scratch.modes[4])

    def disturb(self, fx: float, fy: float, payload: float | None = None) -> None:
        """
        Set the force at the tip, N in ``base``, and the payload, kg, before `step`.

        A body that is released leaves with the tip's velocity and changes no rate.  One that is
        grasped was at rest: a plastic impact, in which the momenta of all coordinates stay.
        Raises ``ValueError`` for a payload that is lighter than the steps are chosen for.
        """
        self._scratch.push[0], self._scratch.push[1] = fx, fy
        if payload is None or payload == self._mass:
            return
        if not self._lightest <= payload <= MOST_PAYLOAD:
            raise ValueError(
                f'payload {payload!r} kg; allowed: {self._lightest!r} to {MOST_PAYLOAD!r} kg'
            )
        terms = self._loads.get(payload) or make_terms(self._parameters, payload)
        if payload > self._mass:
            impulse(self._terms, terms, self._rig, self._pos, self._vel, self._scratch)
        self._mass, self._terms = payload, terms

    def deflections(self) -> tuple[float, float, float, float]:
        """Return delta1, delta2 (m) and their rates (m/s)."""
        found: tuple[float, float, float, float] = _deflections(self._bends, self.q, self.qd)
        return found

    def set_state(self, q: Sequence[float] | FloatArray, qd: Sequence[float] | FloatArray) -> None:
        """Overwrite the state, shapes ``(2 + 2 modes,)``; centre the drives in their gaps."""
        self.q[:] = q
        self.qd[:] = qd
        self.drives[0], self.drives[1] = self.q[:2], self.qd[:2]
        self._moved = False

    def acceleration(self) -> list[float]:
        """Return q'': see `flexarm_ros.core.arm.plant.Plant`."""
        found = end_acceleration(self._scratch)
        if not self._moved:
            pos, vel = self._pos.copy(), self._vel.copy()
            settle(self._terms, self._rig, pos, vel, np.zeros(2), found, self._scratch)
        result: list[float] = found[: len(self.names)].tolist()
        return result


def driven_steps(plant: PlantParameters, period: float, highest: float) -> int:
    """Return the steps per tick; raises ``ValueError`` if ``plant.substeps`` is too small."""
    if plant.substeps is None and plant.model == 'full':
        return steps_for(highest, period, FULL_PHASE)
    return choose_substeps(plant, period, highest)


def _rig(plant: PlantParameters, drive: ActuatorParameters) -> Rig:
    negative = plant.coulomb_friction_negative or plant.coulomb_friction
    tip = make_point(plant, plant.spans[0] + plant.spans[1], elastic=True)
    return Rig(
        np.array([plant.coulomb_friction, negative], dtype=float).T.copy(),
        np.array(drive.rotors(plant.hub_inertia)),
        0.5 * np.array(drive.backlash, dtype=float),
        2.0 * math.pi * np.array(drive.bandwidth, dtype=float),
        tip.shapes,
        tip.shortening,
    )


@compiled
def _deflections(
    bends: FloatArray, q: FloatArray, qd: FloatArray
) -> tuple[float, float, float, float]:
    """Return delta1, delta2 (m) and their rates (m/s)."""
    first, second, first_rate, second_rate = 0.0, 0.0, 0.0, 0.0
    count = bends.shape[1]
    for i in range(count):
        first += bends[0, i] * q[2 + i]
        second += bends[1, i] * q[2 + count + i]
        first_rate += bends[0, i] * qd[2 + i]
        second_rate += bends[1, i] * qd[2 + count + i]
    return first, second, first_rate, second_rate


def _bends(plant: PlantParameters) -> FloatArray:
    """Return the end deflections per unit of each link's coordinates, ``(2, modes)``."""
    if plant.model == 'full':
        from flexarm_ros.core.arm.full.model import make_constants

        rows = make_constants(plant)[0].links['flexible_end']
    else:
        from flexarm_ros.core.arm.plant_eq14 import Eq14Matrices

        rows = Eq14Matrices(plant).end_shape[2:].reshape(2, plant.modes)
    return np.ascontiguousarray(rows)
