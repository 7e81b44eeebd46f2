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
Constants of the full model: a link's integrals and masses, packed for the compiled code.

A link of length L, mass m = rho L and rigidity EI between two rigid massless parts, of length h
at its joint and e at its end, with a point mass and a rotary inertia at the very end, seen from
the frame at its joint (x along the tangent there): the material point s, from -h to L + e, is at

    r(s) = (h + s - 1/2 a^T G(s) a,  phi(s)^T a),   G(s) = int_0^s phi' phi'^T

with phi = 0 before the flexible part and continued along the tangent beyond it,

so that the link keeps its length to second order in the slopes.  All kinetic terms follow from
this map without further approximation; ``docs/validation.md`` has the derivation.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from flexarm_ros.core.arm.basis import Basis, identity, orthogonal_basis
from flexarm_ros.core.arm.basis_arm import arm_bases
from flexarm_ros.core.arm.basis_integrals import linear_integrals, shortening_integrals
from flexarm_ros.core.arm.plant import material_damping
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np

# Rows of ``Constants.scalars``, ``.vectors`` and ``.matrices``.
MASS, FIRST, INERTIA, LENGTH = range(4)
MEAN, MOMENT, END, END_SLOPE, STIFFNESS, DAMPING, BEND = range(7)
SPIN, MODAL, SHORT, END_SHORT = range(4)


class Constants(NamedTuple):
    """
    Both links' integrals; first axis: the link, N: ``modes``.

    ``scalars`` (2, 4): mass (kg), first moment of mass along the axis (kg m),
    moment of inertia about the joint (kg m^2), all of the straight link with
    its end mass and inertia; length with the rigid parts (m).

    ``vectors`` (2, 7, N): int rho phi (kg); int rho (h + s) phi plus the end
    inertia's slope (kg m); phi(L + e); phi'(L) (1/m); stiffness (N/m) and damping
    (N s/m) of each coordinate; phi(L).

    ``matrices`` (2, 4, N, N): int rho (phi phi^T - (h + s) G), the change of the moment of
    inertia with a (kg); int rho phi phi^T plus the end inertia's
    (kg); int rho G (kg/m); G(L + e) (1/m).

    ``cross`` (2, N, N, N): int rho phi_i G_jk (kg/m).  ``quartic``
    (2, N, N, N, N), indices i, j, k, l: int rho G_ik G_jl (kg/m^2).

    ``hub`` (2,): inertia on the rates of theta1 and theta2 (kg m^2).
    """

    scalars: FloatArray
    vectors: FloatArray
    matrices: FloatArray
    cross: FloatArray
    quartic: FloatArray
    hub: FloatArray


def link_bases(plant: PlantParameters) -> tuple[Basis, Basis]:
    """Return the shape functions of link 1 and link 2 for ``plant.basis``."""
    if plant.basis == 'arm_modes':
        return arm_bases(plant)
    basis = orthogonal_basis(plant.basis, identity(plant.modes))
    return basis, basis


@lru_cache(maxsize=16)
def make_constants(plant: PlantParameters) -> Constants:
    """Return the packed integrals of an arm; shared between callers, read only."""
    return make_constants_on(plant, link_bases(plant))


def make_constants_on(plant: PlantParameters, bases: tuple[Basis, Basis]) -> Constants:
    """Return the packed integrals of an arm with the given shape functions of each link."""
    ends = (
        (plant.link_end_mass, plant.link_end_inertia),
        (plant.payload_mass, plant.payload_inertia),
    )
    links = [_link(plant, bases[link], link, *ends[link]) for link in (0, 1)]
    scalars, vectors, matrices, cross, quartic = (
        np.ascontiguousarray(np.stack(parts)) for parts in zip(*links, strict=True)
    )
    hub = np.array(plant.hub_inertia, dtype=float)
    return Constants(scalars, vectors, matrices, cross, quartic, hub)


def _link(
    plant: PlantParameters, basis: Basis, link: int, end_mass: float, end_inertia: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    length = plant.length[link]
    mass = plant.mass_density[link] * length
    hub, beyond, span = plant.hub_radius[link], plant.end_offset[link], plant.spans[link]
    integral, short = linear_integrals(basis), shortening_integrals(basis)
    slope = integral.end_slope / length
    end = integral.end + beyond * slope
    shortening = short.end_short / length + beyond * np.multiply.outer(slope, slope)
    square = length * length
    stiffness = plant.flexural_rigidity[link] / (length * square) * basis.stiffness
    scalars = np.array(
        [
            mass + end_mass,
            0.5 * mass * length + mass * hub + end_mass * span,
            mass * square / 3.0
            + mass * hub * (hub + length)
            + end_mass * (span * span)
            + end_inertia,
            span,
        ]
    )
    vectors = np.array(
        [
            mass * integral.mean + end_mass * end,
            length * (mass * integral.moment + end_mass * end)
            + (hub * mass * integral.mean + (hub + beyond) * end_mass * end)
            + end_inertia * slope,
            end,
            slope,
            stiffness,
            2.0 * plant.damping_ratio * np.sqrt(0.25 * mass * stiffness)
            + material_damping(plant, link) * stiffness,
            integral.end,
        ]
    )
    transverse = mass * integral.mass + end_mass * np.multiply.outer(end, end)
    matrices = np.array(
        [
            transverse
            - mass * short.short_moment
            - hub * mass / length * short.short
            - end_mass * span * shortening,
            transverse + end_inertia * np.multiply.outer(slope, slope),
            mass / length * short.short + end_mass * shortening,
            shortening,
        ]
    )
    cross = mass / length * short.cross + end_mass * np.multiply.outer(end, shortening)
    quartic = mass / square * short.quartic
    quartic = quartic + end_mass * np.multiply.outer(shortening, shortening)
    return scalars, vectors, matrices, cross, np.transpose(quartic, (0, 2, 1, 3))
