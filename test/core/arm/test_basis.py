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

"""Shape functions of a link against closed forms, and their integrals another way."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.basis import (
    Basis,
    clamped_clamped_mode,
    composite_rule,
    identity,
    orthogonal_basis,
)
from flexarm_ros.core.arm.basis_arm import arm_bases
from flexarm_ros.core.arm.basis_integrals import linear_integrals, shortening_integrals
from flexarm_ros.core.arm.beam import clamped_free_root, ClampedFreeModes
from flexarm_ros.core.arm.full.model import link_bases
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np
import pytest
from scipy.integrate import quad

NAMES = ('arm_modes', 'craig_bampton', 'clamped_free')


def basis_of(name: str, count: int) -> Basis:
    if name == 'arm_modes':
        return arm_bases(PlantParameters(modes=count, hub_inertia=(0.0, 0.0)))[1]
    return orthogonal_basis(name, identity(count))


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('count', [1, 2, 4, 6])
def test_shapes_start_at_the_tangent_and_are_orthogonal(name: str, count: int) -> None:
    basis = basis_of(name, count)
    assert basis.shape(0.0)[:, 0] == pytest.approx(np.zeros(count), abs=1e-10)
    assert basis.shape(0.0, 1)[:, 0] == pytest.approx(np.zeros(count), abs=1e-9)
    assert np.all(basis.shape(1.0)[:, 0] > 0.0)
    nodes, weights = np.polynomial.legendre.leggauss(60)
    xi, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    phi, bent = basis.shape(xi), basis.shape(xi, 2)
    mass = np.einsum('q,iq,jq->ij', weights, phi, phi)
    assert mass == pytest.approx(0.25 * np.eye(count), abs=1e-10)
    stiffness = np.einsum('q,iq,jq->ij', weights, bent, bent)
    scale = np.sqrt(np.outer(basis.stiffness, basis.stiffness))
    assert stiffness / scale == pytest.approx(np.eye(count), abs=1e-8)
    assert np.all(np.diff(basis.stiffness) > 0.0)


@pytest.mark.parametrize('name', NAMES)
def test_slope_and_curvature_are_the_derivatives(name: str) -> None:
    basis, h = basis_of(name, 5), 1e-5
    xi = np.array([0.13, 0.5, 0.87])
    for order in (0, 1):
        difference = (basis.shape(xi + h, order) - basis.shape(xi - h, order)) / (2.0 * h)
        exact = basis.shape(xi, order + 1)
        assert difference == pytest.approx(exact, rel=1e-6, abs=1e-6 * np.abs(exact).max())


def test_clamped_free_shapes_are_those_of_equation_8() -> None:
    """Twice the scale, so that the end deflects by 1; alternating signs taken out."""
    modes, basis = ClampedFreeModes(1.0, 1.0, 1.0, 6), basis_of('clamped_free', 6)
    for xi in (0.2, 0.7, 1.0):
        sign = np.sign(modes.shape(1.0))
        assert basis.shape(xi)[:, 0] == pytest.approx(sign * modes.shape(xi) / 0.2, abs=1e-9)
    assert np.sqrt(4.0 * basis.stiffness) == pytest.approx(modes.roots**2, rel=1e-10)


def test_which_bases_carry_an_end_moment() -> None:
    """The reason for the choice of basis: end curvature of the functions, against their mean."""
    for name, carries in zip(NAMES, (True, True, False), strict=True):
        link1 = PlantParameters(modes=4, hub_inertia=(0.0, 0.0), basis=name)
        basis = link_bases(link1)[0]
        end = np.abs(basis.shape(1.0, 2)[:, 0]) / np.sqrt(basis.stiffness)
        assert bool(end.max() > 0.5) is carries
        if not carries:
            assert end.max() < 1e-9


def test_craig_bampton_contains_the_static_deflections() -> None:
    basis, xi = basis_of('craig_bampton', 3), np.linspace(0.0, 1.0, 30)
    for static in (xi**2, 0.5 * xi**2 * (3.0 - xi)):
        shape = basis.shape(xi)
        part, *_ = np.linalg.lstsq(shape.T, static, rcond=None)
        assert shape.T @ part == pytest.approx(static, abs=1e-12)


def test_roots_satisfy_their_equations() -> None:
    for index in range(8):
        z, _ = clamped_clamped_mode(index)
        assert math.cos(z) == pytest.approx(1.0 / math.cosh(z), abs=1e-13)
        z = clamped_free_root(index)
        assert math.cos(z) == pytest.approx(-1.0 / math.cosh(z), abs=1e-13)
    # Blevins, Formulas for Natural Frequency and Mode Shape, table 8-1
    assert clamped_clamped_mode(0)[0] == pytest.approx(4.73004074, rel=1e-8)


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize(('i', 'j'), [(0, 0), (1, 2)])
def test_integrals_by_adaptive_quadrature(name: str, i: int, j: int) -> None:
    basis = basis_of(name, 3)
    linear, short = linear_integrals(basis), shortening_integrals(basis)
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def phi(k: int, x: float) -> float:
        return float(basis.shape(x)[k, 0])

    def g(k: int, m: int, x: float) -> float:
        slopes = basis.shape(0.5 * x * (nodes + 1.0), 1)
        return float(0.5 * x * np.sum(weights * slopes[k] * slopes[m]))

    for ours, function in (
        (linear.mean[i], lambda x: phi(i, x)),
        (linear.moment[i], lambda x: x * phi(i, x)),
        (short.short[i, j], lambda x: g(i, j, x)),
        (short.short_moment[i, j], lambda x: x * g(i, j, x)),
        (short.cross[1, i, j], lambda x: phi(1, x) * g(i, j, x)),
        (short.quartic[i, j, 0, 2], lambda x: g(i, j, x) * g(0, 2, x)),
    ):
        theirs = quad(function, 0.0, 1.0, epsabs=1e-11, epsrel=1e-11)[0]
        assert ours == pytest.approx(theirs, rel=1e-8, abs=1e-10)
    assert short.end_short[i, j] == pytest.approx(g(i, j, 1.0), rel=1e-10)
    assert basis.shortening(0.37)[i, j] == pytest.approx(g(i, j, 0.37), rel=1e-9)


def test_composite_rule_integrates_polynomials_exactly() -> None:
    nodes, weights = composite_rule()
    for power in (0, 1, 9):
        assert np.sum(weights * nodes**power) == pytest.approx(1.0 / (power + 1), rel=1e-14)


@pytest.mark.parametrize('hub', [0.0, 8.0])
@pytest.mark.parametrize('count', [4, 5, 6])
def test_arm_modes_do_not_hang_on_rounding(hub: float, count: int) -> None:
    """Equal links, folded, have pairs of modes of one frequency: any two of their plane do."""
    plant = PlantParameters(modes=count, hub_inertia=(hub, hub), basis='arm_modes')
    heavier = replace(plant, mass_density=(0.335 * (1.0 + 1e-12), 0.335))
    for one, other in zip(arm_bases(plant), arm_bases(heavier), strict=True):
        assert other.stiffness == pytest.approx(one.stiffness, rel=1e-9)
        xi = np.linspace(0.0, 1.0, 11)
        assert other.shape(xi) == pytest.approx(one.shape(xi), abs=1e-9)
