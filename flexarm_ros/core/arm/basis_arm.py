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
``arm_modes``: the N shape functions per link that best represent the modes of this arm.

The first modes of the arm (N, at least four) are computed with a fine polynomial basis, at
elbow angles from straight to folded and with the joints locked, free and one of each.  From
their shapes, scaled to unit strain energy, N functions per link are selected by principal
components in the energy norm.  If the functions miss a fraction r of a mode's strain energy, its
frequency is about r / 2 too high (Rayleigh-Ritz): this is a fit of the frequencies.

With four functions or more the modes' weights, 1 / sqrt(omega) at first, are multiplied by r and
the fit is repeated, after Lawson's algorithm for fits in high norms: this reduces the largest
errors at the cost of the smallest.  One further mode has a tenth of the weight; without it the
last function would fit nothing else.  The shapes of modes of equal frequency (a folded arm of
equal links has pairs of them) are arbitrary, but their sum of squares is not: they share one
weight, from their mean r, and are included all or none.

With fewer than four functions, which cannot fit all modes, each mode is weighted by its
flexibility 1 / omega^2, in favour of the lowest.
"""

from __future__ import annotations

from functools import lru_cache
import math
from typing import NamedTuple

from flexarm_ros.core.arm.basis import Basis, identity, orthogonal_basis
from flexarm_ros.core.arm.basis_integrals import linear_integrals
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.elementary import sincos
from flexarm_ros.core.numerics.linalg import product, symmetric_eigen, weighted_gram
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np

FINE = 12
"""Polynomials per link with which the arm's modes are computed: the first four to 1e-6."""

SERVED = 4
"""Least number of modes, per pose and joint condition, that the functions are fitted to."""

NEXT_WEIGHT = 0.1
"""Weight of the first mode beyond these."""

TWINS = 1e-3
"""Modes whose omega^2 differ by less than this fraction share a weight."""

_POSES = 5
_ROUNDS = 20


class Arm(NamedTuple):
    """The quantities that the arm's modes depend on, hashable; as in ``PlantParameters``."""

    modes: int
    length: tuple[float, float]
    mass_density: tuple[float, float]
    flexural_rigidity: tuple[float, float]
    hub_inertia: tuple[float, float]
    end_mass: tuple[float, float]
    end_inertia: tuple[float, float]
    hub_radius: tuple[float, float] = (0.0, 0.0)
    end_offset: tuple[float, float] = (0.0, 0.0)


def arm_bases(plant: PlantParameters) -> tuple[Basis, Basis]:
    """Return the bases of link 1 and link 2, ``plant.modes`` functions each."""
    length, density, rigidity, hub, radius, offset = (
        (float(pair[0]), float(pair[1]))
        for pair in (
            plant.length, plant.mass_density, plant.flexural_rigidity, plant.hub_inertia,
            plant.hub_radius, plant.end_offset,
        )
    )  # fmt: skip
    masses = (plant.link_end_mass, plant.payload_mass)
    inertias = (plant.link_end_inertia, plant.payload_inertia)
    return _bases(
        Arm(plant.modes, length, density, rigidity, hub, masses, inertias, radius, offset)
    )


@lru_cache(maxsize=64)
def _bases(arm: Arm) -> tuple[Basis, Basis]:
    shapes, squares, places, groups = _mode_shapes(arm)
    even = arm.modes >= SERVED
    start = np.sqrt(np.sqrt(1.0 / squares)) if even else 1.0 / squares
    start[places >= max(SERVED, arm.modes)] *= NEXT_WEIGHT
    weights = start
    kept = [_principal(part, weights, arm.modes) for part in shapes]
    for _ in range(_ROUNDS if even else 0):
        misfit = _misfit(shapes[0], kept[0]) + _misfit(shapes[1], kept[1])
        misfit = _means(misfit, groups)
        relative = np.maximum(misfit * (len(misfit) / _total(misfit)), 1e-3)
        # The geometric mean of the old and the new weight: the plain rule oscillates.
        weights = np.sqrt(weights * start * relative)
        weights = weights * (len(weights) / _total(weights))
        kept = [_principal(part, weights, arm.modes) for part in shapes]
    first, second = (orthogonal_basis('polynomial', part) for part in kept)
    return first, second


def _total(values: FloatArray) -> float:
    return math.fsum(float(v) for v in values)


def _principal(shapes: FloatArray, weights: FloatArray, count: int) -> FloatArray:
    """Return the ``count`` strongest directions ``(count, FINE)`` of weighted rows."""
    gram = weighted_gram(weights, np.ascontiguousarray(shapes.T))
    _, vectors = symmetric_eigen(gram)
    return np.ascontiguousarray(vectors[:, ::-1][:, :count].T)


def _misfit(shapes: FloatArray, kept: FloatArray) -> FloatArray:
    """Return the squared norm of each row of ``shapes`` outside the span of ``kept``."""
    parts = product(shapes, np.ascontiguousarray(kept.T))
    rest = shapes - product(parts, kept)
    return np.array([_total(row * row) for row in rest])


def _means(values: FloatArray, groups: FloatArray) -> FloatArray:
    """Return each value's mean over those of the same group."""
    result = np.empty_like(values)
    for group in np.unique(groups):
        members = groups == group
        result[members] = _total(values[members]) / int(members.sum())
    return result


def _mode_shapes(
    arm: Arm,
) -> tuple[tuple[FloatArray, FloatArray], FloatArray, FloatArray, FloatArray]:
    """
    Return each link's part ``(modes, FINE)`` of the arm's modes, and three numbers per mode.

    These are omega^2; the index among those of its pose and joint condition, from 0, where
    twins have that of the first; and a number that twins share.  Coordinates are scaled so that
    the strain energy is half the sum of their squares; free joints, which have no stiffness,
    are eliminated exactly.
    """
    pairs = zip(arm.flexural_rigidity, arm.length, strict=True)
    scale = np.array(
        [math.sqrt(rigidity / (length * length * length)) for rigidity, length in pairs]
    )
    inverse = np.concatenate([[1.0, 1.0], np.repeat(1.0 / scale, FINE)])
    served = max(SERVED, arm.modes) + 1
    rows: list[FloatArray] = []
    squares: list[float] = []
    places: list[int] = []
    groups: list[int] = []
    for pose in range(_POSES):
        mass = straight_mass(arm, math.pi * pose / (_POSES - 1))
        mass = mass * np.multiply.outer(inverse, inverse)
        for free in ((), (0,), (1,), (0, 1)):
            values, vectors = symmetric_eigen(_without_joints(mass, free))
            found = 1.0 / values[::-1]
            first = _first_twins(found, served, arm.modes >= SERVED)
            squares.extend(found[: len(first)])
            rows.extend(vectors[:, ::-1][:, : len(first)].T)
            groups.extend(len(places) + place for place in first)
            places.extend(first)
    shapes = np.array(rows)
    links = (np.ascontiguousarray(shapes[:, :FINE]), np.ascontiguousarray(shapes[:, FINE:]))
    return links, np.array(squares), np.array(places, dtype=float), np.array(groups, dtype=float)


def _first_twins(squares: FloatArray, served: int, together: bool) -> list[int]:
    """
    Return for each mode the index of its first twin.

    For ``served`` modes, and the last one's twins; with ``together`` false, each its own.
    """
    first = [0]
    for place in range(1, len(squares) if together else served):
        twin = together and squares[place] < squares[place - 1] * (1.0 + TWINS)
        if place >= served and not twin:
            break
        first.append(first[-1] if twin else place)
    return first


def _without_joints(mass: FloatArray, free: tuple[int, ...]) -> FloatArray:
    """Return the elastic mass matrix with the ``free`` joints eliminated, the others locked."""
    result = mass
    for joint in free:
        column = result[:, joint]
        result = result - np.multiply.outer(column, column) / result[joint, joint]
    return result[2:, 2:]


@lru_cache
def _fine_basis() -> Basis:
    return Basis('polynomial', identity(FINE), np.ones(FINE))


def straight_mass(arm: Arm, theta2: float) -> FloatArray:
    """
    Return M at zero deformation in the fine basis, shape ``(2 + 2 FINE,) * 2``.

    Each velocity below is a row over the rates of (theta1, theta2, a, b): the rotation of
    link 2, the velocity of its start along and across it.
    """
    integral = linear_integrals(_fine_basis())
    size = 2 + 2 * FINE
    first, second = slice(2, 2 + FINE), slice(2 + FINE, size)
    turns = np.zeros((2, size))
    turns[0, 0] = turns[1, 0] = turns[1, 1] = 1.0
    turns[1, first] = integral.end_slope / arm.length[0]
    start = np.zeros(size)
    start[0] = arm.hub_radius[0] + arm.length[0] + arm.end_offset[0]
    start[first] = integral.end + arm.end_offset[0] * turns[1, first]
    sine, cosine = sincos(theta2)
    mass = np.zeros((size, size))
    mass[0, 0], mass[1, 1] = arm.hub_inertia
    for link, part in ((0, first), (1, second)):
        along = start * sine if link else 0.0 * start
        across = start * cosine if link else 0.0 * start
        length, total = arm.length[link], arm.mass_density[link] * arm.length[link]
        shape, slope = np.zeros(size), turns[link].copy()
        slope[part] += integral.end_slope / length
        across = across + arm.hub_radius[link] * turns[link]
        tip = across + length * turns[link]
        tip[part] += integral.end
        tip += arm.end_offset[link] * slope
        mass += total * (_square(along) + _square(across))
        mass += total * (length * length / 3.0) * _square(turns[link])
        mass += 0.5 * total * length * _cross(across, turns[link])
        shape[part] = integral.mean
        mass += total * _cross(across, shape)
        shape[part] = integral.moment
        mass += total * length * _cross(turns[link], shape)
        mass[part, part] += total * integral.mass
        mass += arm.end_mass[link] * (_square(along) + _square(tip))
        mass += arm.end_inertia[link] * _square(slope)
    return mass


def _square(row: FloatArray) -> FloatArray:
    return np.asarray(np.multiply.outer(row, row))


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    product = np.multiply.outer(first, second)
    return np.asarray(product + product.T)
