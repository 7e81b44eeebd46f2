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

"""The integrators' coefficients, order and stability against theory."""

from __future__ import annotations

import math

from flexarm_ros.core.numerics.runge_kutta import DOP853, RK4, Tableau, TABLEAUS
import numpy as np
import pytest
from scipy.integrate import DOP853 as SCIPY

METHODS = [pytest.param(tableau, id=f'order {order}') for order, tableau in TABLEAUS.items()]


def amplification(method: Tableau, phase: float) -> complex:
    """Return the factor of one step of x' = i w x, from the stages themselves."""
    slopes = np.zeros(len(method.b), complex)
    for stage, row in enumerate(method.a):
        slopes[stage] = 1j * phase * (1.0 + row @ slopes)
    return complex(1.0 + method.b @ slopes)


def test_the_coefficients_are_scipys() -> None:
    stages = len(DOP853.b)
    np.testing.assert_array_equal(DOP853.a, SCIPY.A[:stages, :stages])
    np.testing.assert_array_equal(DOP853.b, SCIPY.B)


@pytest.mark.parametrize('method', METHODS)
def test_each_stage_uses_earlier_ones_only(method: Tableau) -> None:
    assert np.all(np.triu(method.a) == 0.0)


@pytest.mark.parametrize('method', METHODS)
def test_a_step_is_the_exponential_series_up_to_its_order_only(method: Tableau) -> None:
    factor, found = np.ones(len(method.b)), []
    for _ in range(method.order + 1):
        found.append(float(method.b @ factor))
        factor = method.a @ factor
    theory = [1.0 / math.factorial(k) for k in range(1, method.order + 2)]
    assert found[:-1] == pytest.approx(theory[:-1], rel=1e-12)
    assert found[-1] != pytest.approx(theory[-1], rel=0.01)


@pytest.mark.parametrize('method', METHODS)
def test_an_undamped_mode_does_not_grow_up_to_the_stability_limit(method: Tableau) -> None:
    phases = np.linspace(1e-2, method.stable, 2000)
    assert max(abs(amplification(method, phase)) for phase in phases) <= 1.0 + 1e-14
    assert abs(amplification(method, 1.01 * method.stable)) > 1.0


@pytest.mark.parametrize(
    ('method', 'phase', 'loss'),
    [(RK4, 0.33, 9e-6), (DOP853, 2.0, 2.7e-5), (DOP853, 1.5, 1.5e-6), (DOP853, 1.0, 2.4e-8)],
)
def test_a_step_takes_what_the_documentation_says(
    method: Tableau, phase: float, loss: float
) -> None:
    assert 1.0 - abs(amplification(method, phase)) == pytest.approx(loss, rel=0.03)
