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

"""Beam modes against closed forms, quadrature and the published frequencies."""

from __future__ import annotations

import math

from flexarm_ros.core.arm.beam import AMPLITUDE, clamped_free_root, ClampedFreeModes
import numpy as np
import pytest
from scipy.optimize import brentq

LINK = ClampedFreeModes(4.5, 0.335, 1676.0, 6)


@pytest.mark.parametrize('index', range(12))
def test_roots_solve_the_characteristic_equation(index: int) -> None:
    def equation(z: float) -> float:
        return math.cos(z) + 1.0 / math.cosh(z)

    middle = (index + 0.5) * math.pi
    root = brentq(equation, middle - 0.4, middle + 0.4, xtol=1e-14, rtol=1e-14)
    assert clamped_free_root(index) == pytest.approx(root, rel=1e-13)


def test_frequencies_of_the_papers_link() -> None:
    # shared reference: exact clamped-free frequencies of this link, rad/s
    published = [12.28119, 76.96488, 215.50390, 422.30163]
    assert LINK.frequencies[:4] == pytest.approx(published, rel=1e-6)


def as_printed(i: int, x: float) -> float:
    """Equation (8), as it stands in the paper."""
    root = clamped_free_root(i)
    z = root * x / LINK.length
    k = (math.cos(root) + math.cosh(root)) / (math.sin(root) + math.sinh(root))
    return 0.1 * (math.cosh(z) - math.cos(z) - k * (math.sinh(z) - math.sin(z)))


@pytest.mark.parametrize('x', [0.0, 0.1, 1.0, 2.25, 4.0, 4.5])
def test_shape_is_equation_8(x: float) -> None:
    # (8) as printed loses digits as exp(z): 1e-16 * 1e7 for the sixth mode.
    assert LINK.shape(x) == pytest.approx([as_printed(i, x) for i in range(6)], abs=1e-9)


@pytest.mark.parametrize('x', [0.3, 2.25, 4.4])
def test_slope_and_curvature_are_derivatives(x: float) -> None:
    h = 1e-4
    slope = (LINK.shape(x + h) - LINK.shape(x - h)) / (2 * h)
    curvature = (LINK.slope(x + h) - LINK.slope(x - h)) / (2 * h)
    scale = AMPLITUDE * (LINK.roots / LINK.length)
    assert np.abs(LINK.slope(x) - slope) / scale == pytest.approx(0.0, abs=1e-5)
    assert np.abs(LINK.curvature(x) - curvature) / scale**2 == pytest.approx(0.0, abs=1e-5)


def test_boundary_conditions_and_end_value() -> None:
    assert LINK.shape(0.0) == pytest.approx(np.zeros(6), abs=1e-15)
    assert LINK.slope(0.0) == pytest.approx(np.zeros(6), abs=1e-14)
    assert LINK.curvature(4.5) == pytest.approx(np.zeros(6), abs=1e-12)
    assert LINK.shape(4.5) == pytest.approx([0.2 * (-1) ** i for i in range(6)], rel=1e-12)


def test_orthogonality_and_modal_integrals() -> None:
    nodes, weights = np.polynomial.legendre.leggauss(48)
    x, weights = 0.5 * LINK.length * (1.0 + nodes), 0.5 * LINK.length * weights
    shapes = np.array([LINK.shape(at) for at in x])
    curvatures = np.array([LINK.curvature(at) for at in x])
    density = LINK.mass_density * weights
    mass = shapes.T @ (density[:, None] * shapes)
    assert mass == pytest.approx(np.diag(LINK.modal_mass), abs=1e-12)
    bending = curvatures.T @ (LINK.flexural_rigidity * weights[:, None] * curvatures)
    assert np.diag(bending) == pytest.approx(LINK.modal_stiffness, rel=1e-10)
    scale = np.sqrt(np.outer(LINK.modal_stiffness, LINK.modal_stiffness))
    assert bending / scale == pytest.approx(np.eye(6), abs=1e-10)
    assert LINK.first_moment == pytest.approx(shapes.T @ (density * x), rel=1e-10)
    assert LINK.mean == pytest.approx(shapes.T @ density, rel=1e-10)
