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

"""Interface of the plants, their integration steps, and the criterion of instability."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Protocol

from flexarm_ros.core.numerics.compiled import compiled, FloatArray, internal
from flexarm_ros.core.parameters.sections import PlantParameters

ACCURATE_PHASE = 0.2
"""Default phase of the highest mode in one integrator step, rad.

One step of RK4 multiplies the amplitude of an undamped mode by
1 - phase^6 / 144 and shifts it by phase^5 / 120: at 0.2 rad the fastest mode
loses 2.2e-6 of its amplitude and 1.3e-5 of its phase per radian, slower ones less.
"""

STABLE_PHASE = 2.0
"""Largest allowed phase of the highest mode in one integrator step.

RK4 is stable up to 2 sqrt(2) = 2.83 on the imaginary and 2.79 on the real axis;
the rest is a margin for nonlinear effects, which the linear estimate ignores.
"""


class Plant(Protocol):
    """
    An arm that is advanced one control tick at a time.

    ``q`` and ``qd``, shape ``(2 + 2 modes,)``, are in the order of ``names``:
    theta1, theta2 (rad), then the modal coordinates of link 1 and of link 2.
    They are views: :meth:`step` and :meth:`set_state` change them in place.
    ``limits``: largest end deflection of each link, m; see :func:`instability`.
    """

    names: tuple[str, ...]
    q: FloatArray
    qd: FloatArray
    substeps: int
    limits: tuple[float, float]

    def step(self, tau1: float, tau2: float) -> None:
        """Advance by one tick with the joint torques, N m, held."""

    def deflections(self) -> tuple[float, float, float, float]:
        """Return delta1, delta2 (m) and their rates (m/s)."""

    def acceleration(self) -> list[float]:
        """
        Return q'' at the end of the last step, with its torques; rad/s^2, m/s^2.

        After `set_state`, before any step: without torques.
        """

    def set_state(self, q: Sequence[float] | FloatArray, qd: Sequence[float] | FloatArray) -> None:
        """Overwrite the state, shapes ``(2 + 2 modes,)``."""


def deflection_limits(plant: PlantParameters) -> tuple[float, float]:
    """
    Return the end deflection of each link, m, beyond which a run is unstable.

    It is ``plant.deflection_limit``, or by default 10/9 of each length (5 m for 4.5 m).
    """
    if plant.deflection_limit is not None:
        return plant.deflection_limit
    length1, length2 = plant.length
    return 10.0 * length1 / 9.0, 10.0 * length2 / 9.0  # 5 exactly for 4.5, unlike 10 / 9 * 4.5


def material_damping(plant: PlantParameters, link: int) -> float:
    """
    Return the Kelvin-Voigt constant of ``link`` (0 or 1), s: damping per stiffness.

    The moment at the root of a link bent by an end force is 3 EI / L times the angle
    deflection / L; ``plant.link_damping`` is the same for the rate of that angle.
    """
    root = 3.0 * plant.flexural_rigidity[link] / plant.length[link]
    return plant.link_damping[link] / root


def steps_for(highest: float, period: float, phase: float) -> int:
    """Return how many steps per tick keep the phase of the highest rate, 1/s, below ``phase``."""
    return max(1, math.ceil(highest * period / phase))


def choose_substeps(plant: PlantParameters, period: float, highest: float) -> int:
    """
    Return the number of RK4 steps per tick of ``period`` s for a highest rate, 1/s.

    By default enough for :data:`ACCURATE_PHASE`; a given number is checked against
    :data:`STABLE_PHASE`, and ``ValueError`` raised if it is too small.
    """
    if plant.substeps is None:
        return steps_for(highest, period, ACCURATE_PHASE)
    least = steps_for(highest, period, STABLE_PHASE)
    if plant.substeps < least:
        raise ValueError(
            f'plant.substeps: {plant.substeps} is too few for a highest frequency of '
            f'{highest:.4g} rad/s at this control_period; allowed: {least} or more'
        )
    return plant.substeps


def instability(plant: Plant) -> str | None:
    """
    Return the reason why the plant's state is unstable, or ``None``.

    It is unstable if not finite, or if a deflection is beyond ``plant.limits``.
    """
    ends, limits = plant.deflections(), plant.limits
    # As `is_stable`, which the kernel calls: to look at tuples takes longer than to compare here.
    inside = abs(ends[0]) <= limits[0] and abs(ends[1]) <= limits[1]
    if inside and all_finite(plant.q, plant.qd):
        return None
    for name, value in zip(plant.names, plant.q, strict=True):
        if not math.isfinite(value):
            return f'{name}: {value}'
    for name, value in zip(plant.names, plant.qd, strict=True):
        if not math.isfinite(value):
            return f'rate of {name}: {value}'
    link = 0 if not abs(ends[0]) <= limits[0] else 1
    return f'deflection of link{link + 1}: {ends[link]:.6g} m, limit {limits[link]:.6g} m'


@internal
def is_stable(
    ends: tuple[float, float, float, float],
    limits: tuple[float, float],
    q: FloatArray,
    qd: FloatArray,
) -> bool:
    """Return whether the deflections are within their limits and ``q``, ``qd`` finite."""
    inside = abs(ends[0]) <= limits[0] and abs(ends[1]) <= limits[1]
    return inside and all_finite(q, qd)


@compiled
def all_finite(q: FloatArray, qd: FloatArray) -> bool:
    """Return whether every entry of both ``(n,)`` arrays is finite."""
    finite = True
    for i in range(q.shape[0]):
        finite = finite and math.isfinite(q[i]) and math.isfinite(qd[i])
    return finite
