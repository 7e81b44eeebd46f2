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

"""Motions of the plant by itself: torques given, states out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.arm.plant import Plant
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import make_plant
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Torque = Callable[[float], tuple[float, float]]

COLUMNS = ('theta1', 'theta2', 'tip_x', 'tip_y', 'defl1', 'defl2')
"""Columns of a motion after the time: rad, rad, m, m, m, m."""


def no_torque(time: float) -> tuple[float, float]:
    """Return the torques of a free motion."""
    return 0.0, 0.0


def full_plant(**keys: object) -> PlantParameters:
    """Return the parameters of a full model without hub inertia, and other keys."""
    given: dict[str, object] = {'model': 'full', 'hub_inertia': (0.0, 0.0)}
    return PlantParameters(**{**given, **keys})  # type: ignore[arg-type]


def start(
    plant: PlantParameters,
    angles: tuple[float, float],
    rates: tuple[float, float] = (0.0, 0.0),
    period: float = 1e-3,
) -> Plant:
    """Return a plant with straight links at these joint angles (rad) and rates (rad/s)."""
    posed = replace(plant, initial_position=angles, initial_velocity=rates)
    return make_plant(RunConfig(run=RunParameters(control_period=period), plant=posed))


@dataclass(frozen=True)
class Case:
    """A motion: initial angles and rates, torques (N m, of time in s), seconds."""

    angles: tuple[float, float]
    duration: float
    rates: tuple[float, float] = (0.0, 0.0)
    torque: Torque = no_torque
    payload: float = 0.0


def fly(plant: PlantParameters, case: Case, every: int = 10, period: float = 1e-3) -> Array:
    """Return rows ``(t, *COLUMNS)``, one every ``every`` ticks; torques held at mid-tick."""
    arm = start(plant, case.angles, case.rates, period)
    tip = make_point(plant, sum(plant.spans), True)
    rows = []
    for tick in range(round(case.duration / period) + 1):
        if tick % every == 0:
            x, y, _, _ = tip(arm.q, arm.qd)
            rows.append((tick * period, arm.q[0], arm.q[1], x, y, *arm.deflections()[:2]))
        arm.step(*case.torque((tick + 0.5) * period))
    return np.array(rows)


@dataclass(frozen=True)
class Difference:
    """Largest differences of two motions: of the ranges, and of the tip in m."""

    angles: tuple[float, float]
    deflections: tuple[float, float]
    tip: float
    tip_of_range: float


def compare(motion: Array, reference: Array) -> Difference:
    """Compare two motions of the same times, relative to the ranges of the second."""
    error = np.abs(motion[:, 1:] - reference[:, 1:])
    spread = np.ptp(reference[:, 1:], axis=0)
    relative = error.max(axis=0) / spread
    tip = float(np.hypot(error[:, 2], error[:, 3]).max())
    return Difference(
        (float(relative[0]), float(relative[1])),
        (float(relative[4]), float(relative[5])),
        tip,
        tip / float(spread[2:4].max()),
    )
