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

"""Fuzzy systems with more functions: against the loop's own and against scikit-fuzzy."""

from __future__ import annotations

from flexarm_ros.core.control.fls import fls_lambda
import numpy as np
import pytest
from validation.fuzzy_variants import FuzzyGain

POINTS = [(0.0, 0.0), (0.01, 0.0), (0.3, -1.2), (-2.4, 0.7), (2.5, 2.5), (4.9, -0.2), (5.0, 9.0)]


@pytest.mark.parametrize('point', POINTS)
def test_three_functions_are_the_loop_s_own(point: tuple[float, float]) -> None:
    assert FuzzyGain(3)(*point) == pytest.approx(
        fls_lambda(point[0] / 5.0, point[1] / 5.0), rel=1e-14
    )


def test_ends_of_five_functions() -> None:
    five = FuzzyGain(5)
    # One triangle of width 1/4 fires alone: centroid a third of it from its peak.
    assert five(0.0, 0.0) == pytest.approx(1.0 / 12.0)
    assert five(5.0, -5.0) == pytest.approx(11.0 / 12.0)
    assert five(5.0, 0.0) == pytest.approx(0.5)
    assert five(2.5, 0.0) == pytest.approx(0.25)


@pytest.mark.parametrize('point', POINTS)
@pytest.mark.parametrize('rule', ['sum', 'largest'])
def test_five_functions_against_scikit_fuzzy(point: tuple[float, float], rule: str) -> None:
    skfuzzy = pytest.importorskip('skfuzzy')
    universe, out = np.linspace(-1.0, 1.0, 2001), np.linspace(0.0, 1.0, 8001)
    x = np.clip(np.array(point) / 5.0, -1.0, 1.0)

    def triangle(grid: np.ndarray, peak: float, width: float) -> np.ndarray:
        return np.clip(1.0 - np.abs(grid - peak) / width, 0.0, None)

    total = np.zeros_like(out)
    for i in range(-2, 3):
        for j in range(-2, 3):
            fired = min(
                skfuzzy.interp_membership(universe, triangle(universe, peak / 2.0, 0.5), value)
                for peak, value in ((i, x[0]), (j, x[1]))
            )
            level = abs(i) + abs(j) if rule == 'sum' else 2 * max(abs(i), abs(j))
            total = np.fmax(total, np.fmin(fired, triangle(out, level / 4.0, 0.25)))
    expected = skfuzzy.defuzz(out, total, 'centroid')
    assert FuzzyGain(5, rule=rule)(*point) == pytest.approx(expected, abs=2e-6)


def test_bad_definitions_are_refused() -> None:
    with pytest.raises(ValueError, match='^functions: 4'):
        FuzzyGain(4)
    with pytest.raises(ValueError, match="^rule: 'least'"):
        FuzzyGain(rule='least')
