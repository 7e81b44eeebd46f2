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
from typing import Any, Protocol

from flexarm_ros.core.arm.basis import Basis, identity, orthogonal_basis
from flexarm_ros.core.arm.basis_arm import arm_bases
from flexarm_ros.core.arm.basis_integrals import linear_integrals, shortening_integrals
from flexarm_ros.core.arm.plant import material_damping
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.records import record_type, Records
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np

SCALARS = ('mass', 'first', 'inertia', 'length')
VECTORS = ('mass_shape', 'moment', 'end', 'end_slope', 'stiffness', 'damping', 'flexible_end')
MATRICES = ('spin', 'modal', 'short', 'end_short')


class Link(Protocol):
    """
    Integrals of one link as a record; N: ``modes``, P = N (N + 1) / 2 pairs i >= j.

    The shapes are part of the record's type, so that the compiler knows N and unrolls the loops.

    ``mass`` (kg), ``first`` moment of mass along the axis (kg m), ``inertia`` about the joint
    (kg m^2), all of the straight link with its end mass and inertia; ``length`` with the rigid
    parts (m).

    (N,) ``mass_shape``: int rho phi (kg); ``moment``: int rho (h + s) phi plus the end inertia's
    slope (kg m); ``end``: phi(L + e); ``end_slope``: phi'(L) (1/m); ``stiffness`` (N/m) and
    ``damping`` (N s/m) of each coordinate; ``flexible_end``: phi(L).

    (N, N) ``spin``: int rho (phi phi^T - (h + s) G), the change of the moment of inertia with a
    (kg); ``modal``: int rho phi phi^T plus the end inertia's (kg); ``short``: int rho G (kg/m);
    ``end_short``: G(L + e) (1/m).

    ``cross`` (N, N, N), indices k, i, j: int rho phi_i G_jk (kg/m).  With sums over j and k as
    sums over pairs, ``(j, k)`` and ``(k, j)`` added: ``cross_pairs`` (P, N), from a pair to i.
    Of H_ijkl = int rho G_ij G_kl (kg/m^2): ``stretch`` (P, P), from the pair (k, l) to (i, j):
    H_ikjl; ``bend`` (P, P), from the pair (k, l) to (i, j): H_ijkl.
    """

    mass: float
    first: float
    inertia: float
    length: float
    mass_shape: FloatArray
    moment: FloatArray
    end: FloatArray
    end_slope: FloatArray
    stiffness: FloatArray
    damping: FloatArray
    flexible_end: FloatArray
    spin: FloatArray
    modal: FloatArray
    short: FloatArray
    end_short: FloatArray
    cross: FloatArray
    cross_pairs: FloatArray
    stretch: FloatArray
    bend: FloatArray


class Constants(Protocol):
    """
    Both links' integrals and the hubs as a record of floats only.

    ``hub`` (2,): inertia on the rates of theta1 and theta2 (kg m^2).  ``links`` (2,): the
    :class:`Link` records.
    """

    hub: FloatArray
    links: Any


@lru_cache
def constants_type(modes: int) -> Any:
    """Return the dtype of :class:`Constants` for ``modes`` assumed modes."""
    pairs = modes * (modes + 1) // 2
    link = record_type(
        [
            *((name, float) for name in SCALARS),
            *((name, float, (modes,)) for name in VECTORS),
            *((name, float, (modes, modes)) for name in MATRICES),
            ('cross', float, (modes, modes, modes)),
            ('cross_pairs', float, (pairs, modes)),
            ('stretch', float, (pairs, pairs)),
            ('bend', float, (pairs, pairs)),
        ]
    )
    return record_type([('hub', float, (2,)), ('links', link, (2,))])


def floats(constants: Records) -> FloatArray:
    """Return the numbers of :class:`Constants` as one flat array on the same memory."""
    return constants.view(np.float64)


def link_bases(plant: PlantParameters) -> tuple[Basis, Basis]:
    """Return the shape functions of link 1 and link 2 for ``plant.basis``."""
    if plant.basis == 'arm_modes':
        return arm_bases(plant)
    basis = orthogonal_basis(plant.basis, identity(plant.modes))
    return basis, basis


@lru_cache(maxsize=16)
def make_constants(plant: PlantParameters) -> Records:
    """Return :class:`Constants` of an arm, ``(1,)``; shared between callers, read only."""
    return make_constants_on(plant, link_bases(plant))


def make_constants_on(plant: PlantParameters, bases: tuple[Basis, Basis]) -> Records:
    """Return :class:`Constants` of an arm with the given shape functions, ``(1,)``."""
    ends = (
        (plant.link_end_mass, plant.link_end_inertia),
        (plant.payload_mass, plant.payload_inertia),
    )
    constants: Records = np.zeros(1, constants_type(plant.modes))
    constants[0].hub[:] = plant.hub_inertia
    for link in (0, 1):
        _pack(constants[0].links[link], *_link(plant, bases[link], link, *ends[link]))
    return constants


def _pack(
    record: Any,
    scalars: FloatArray,
    vectors: FloatArray,
    matrices: FloatArray,
    cross: FloatArray,
    quartic: FloatArray,
) -> None:
    """Fill the record of a link; ``cross`` (N, N, N), ``quartic`` (N, N, N, N) as computed."""
    for names, values in ((SCALARS, scalars), (VECTORS, vectors), (MATRICES, matrices)):
        for name, value in zip(names, values, strict=True):
            record[name] = value
    record.cross[:] = np.transpose(cross, (2, 0, 1))
    pairs = [(i, j) for i in range(len(cross)) for j in range(i + 1)]
    for q, (k, m) in enumerate(pairs):
        both = 1.0 if k == m else 2.0
        record.cross_pairs[q] = both * cross[:, k, m]
        for p, (i, j) in enumerate(pairs):
            record.stretch[q, p] = 0.5 * both * (quartic[i, k, j, m] + quartic[i, m, j, k])
            record.bend[q, p] = both * quartic[i, j, k, m]


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
    return scalars, vectors, matrices, cross, quartic
