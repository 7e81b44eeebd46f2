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
Both plants' equations in one form, M q'' = f with M and f evaluated by the model's own code.

The integrator of :mod:`flexarm_ros.core.arm.driven.dynamics` is compiled once per model: numba
selects the implementation of :func:`terms` by the type of its first argument.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from flexarm_ros.core.arm.full.dynamics import make_work, mass_and_bias
from flexarm_ros.core.arm.full.model import link_bases, make_constants_on
from flexarm_ros.core.arm.full.plant import elastic_diagonals
from flexarm_ros.core.arm.plant_eq14 import eq14_terms, Eq14Matrices
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.parameters.sections import PlantParameters
from numba.extending import overload


class Eq14Terms(NamedTuple):
    """
    Constants of the ``eq14`` plant; n coordinates.

    ``mass`` ``(2, n, n)``; ``diagonals`` ``(2, n)``: stiffness and damping; ``coupling``: of the
    rigid Coriolis terms, kg m^2.  See :class:`flexarm_ros.core.arm.plant_eq14.Eq14Matrices`.
    """

    mass: FloatArray
    diagonals: FloatArray
    coupling: float


class FullTerms(NamedTuple):
    """Constants and scratch of the ``full`` plant; ``diagonals`` as in :class:`Eq14Terms`."""

    con: Records
    diagonals: FloatArray
    work: Records


def make_terms(plant: PlantParameters, payload_mass: float) -> Eq14Terms | FullTerms:
    """
    Return the constants of ``plant`` with another payload (kg).

    The shape functions are those of ``plant`` itself, so that its coordinates keep their meaning.
    """
    from dataclasses import replace

    import numpy as np

    loaded = replace(plant, payload_mass=payload_mass)
    if plant.model == 'full':
        con = make_constants_on(loaded, link_bases(plant))
        return FullTerms(con, np.stack(elastic_diagonals(plant)), make_work(plant.modes))
    matrices = Eq14Matrices(loaded)
    diagonals = np.stack([matrices.stiffness, matrices.damping])
    return Eq14Terms(matrices.mass, np.ascontiguousarray(diagonals), matrices.coupling)


@compiled
def _of_eq14(
    model: Eq14Terms, q: FloatArray, qd: FloatArray, mass: FloatArray, force: FloatArray
) -> None:
    eq14_terms(q, qd, 0.0, 0.0, model.mass, model.diagonals, model.coupling, mass, force)


@compiled
def _of_full(
    model: FullTerms, q: FloatArray, qd: FloatArray, mass: FloatArray, force: FloatArray
) -> None:
    mass_and_bias(model.con, q, qd, model.work)
    work = model.work[0]
    for i in range(len(work.force)):
        force[i] = -work.force[i] - model.diagonals[0, i] * q[i] - model.diagonals[1, i] * qd[i]
        for j in range(i + 1):
            mass[i, j] = work.mass[j, i]


def terms(model: Any, q: FloatArray, qd: FloatArray, mass: FloatArray, force: FloatArray) -> None:
    """
    Fill the lower triangle of M ``(n, n)`` and the force f ``(n,)`` without the joint torques.

    f holds the Coriolis and centrifugal terms, stiffness, damping and viscous friction.
    """
    (_of_full if isinstance(model, FullTerms) else _of_eq14)(model, q, qd, mass, force)


@overload(terms)
def _terms(model: Any, q: Any, qd: Any, mass: Any, force: Any) -> Any:
    if model.instance_class is FullTerms:

        def of_full(model: Any, q: Any, qd: Any, mass: Any, force: Any) -> Any:
            _of_full(model, q, qd, mass, force)

        return of_full

    def of_eq14(model: Any, q: Any, qd: Any, mass: Any, force: Any) -> Any:
        _of_eq14(model, q, qd, mass, force)

    return of_eq14
