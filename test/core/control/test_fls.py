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

"""The exact fuzzy gain against its definition, scikit-fuzzy and known values."""

from __future__ import annotations

import subprocess
import sys

from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.control.fls_definition import build, describe, INPUT_SETS, OUTPUT_SETS, RULES
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import skfuzzy
from skfuzzy import control

UNIVERSE = np.linspace(0.0, 1.0, 2001)
SHAPES = {label: skfuzzy.trimf(UNIVERSE, feet) for label, feet in OUTPUT_SETS.items()}
CORNERS = np.array([-1.0, 0.0, 1.0])  # of the inputs' triangles: interpolation is exact
INPUTS = {label: skfuzzy.trimf(CORNERS, feet) for label, feet in INPUT_SETS.items()}

SAMPLING = 4e-7
"""What scikit-fuzzy's centroid errs by at 2001 samples: kinks fall between two of them.

A kink with a change of slope of 4 hides at most 4 h^2 / 8 of area, h = 5e-4, at most
half a unit from the centroid of an area of 0.25 or more: 2.5e-7.  Seen: 1e-7.
"""


def from_definition(a: float, b: float) -> float:
    """Min, max, centroid with scikit-fuzzy's functions on a fine universe."""
    degree = [
        {label: skfuzzy.interp_membership(CORNERS, shape, x) for label, shape in INPUTS.items()}
        for x in (a, b)
    ]
    total = np.zeros_like(UNIVERSE)
    for (first, second), out in RULES.items():
        strength = min(degree[0][first], degree[1][second])
        total = np.fmax(total, np.fmin(strength, SHAPES[out]))
    return float(skfuzzy.defuzz(UNIVERSE, total, 'centroid'))


# Symmetry is a test of its own, so one quadrant will do; the origin is the steep place.
NEAR = [0.0, 1e-9, 1e-6, 1e-4, 1e-3, 3e-3, 0.006, 0.01, 0.02, 0.03]
AXIS = [*NEAR, *np.linspace(0.06, 1.0, 13).tolist(), 1 / 3, 0.4999, 0.5001]


def test_dense_grid_against_the_definition() -> None:
    worst = max(abs(fls_lambda(a, b) - from_definition(a, b)) for a in AXIS for b in AXIS)
    assert worst < SAMPLING
    signed = [(-a, b) for a in NEAR[1:] for b in NEAR] + [(a, -b) for a in NEAR for b in NEAR[1:]]
    assert max(abs(fls_lambda(a, b) - from_definition(a, b)) for a, b in signed) < SAMPLING


@pytest.fixture(scope='module')
def simulation() -> control.ControlSystemSimulation:
    return control.ControlSystemSimulation(build(2001), cache=False)


POINTS = [
    (0.0, 0.0), (1e-6, 0.0), (0.002, 0.001), (0.01, 0.0), (0.0, -0.01), (0.02, 0.03), (-0.1, 0.25),
    (0.5, 0.5), (0.3, -0.8), (-1.0, 0.2), (0.97, 0.98), (-0.61, 0.0),
]  # fmt: skip


@pytest.mark.filterwarnings('ignore:Passing more than 2 positional:DeprecationWarning')
@pytest.mark.parametrize(('a', 'b'), POINTS)
def test_scikit_fuzzys_own_control_system(simulation, a: float, b: float) -> None:
    simulation.input['delta1'], simulation.input['delta2'] = a, b
    simulation.compute()
    assert fls_lambda(a, b) == pytest.approx(simulation.output['lambda'], abs=SAMPLING)


@pytest.mark.parametrize(
    ('a', 'b', 'expected'),
    [
        (0.0, 0.0, 1 / 6), (-1.0, -1.0, 5 / 6), (1.0, -1.0, 5 / 6), (-1.0, 0.0, 0.5),
        (0.0, 1.0, 0.5), (0.01, 0.0, 0.17807),
    ],
)  # fmt: skip
def test_known_values(a: float, b: float, expected: float) -> None:
    assert fls_lambda(a, b) == pytest.approx(expected, abs=5e-6)


unit = st.floats(-1.0, 1.0)


@given(unit, unit)
def test_symmetric_bounded_and_clipped(a: float, b: float) -> None:
    value = fls_lambda(a, b)
    assert 1 / 6 - 1e-15 <= value <= 5 / 6 + 1e-15
    assert value == fls_lambda(-a, b) == fls_lambda(a, -b)
    assert value == pytest.approx(fls_lambda(b, a), abs=1e-15)
    assert fls_lambda(3.0 * a if abs(a) == 1.0 else a, b) == value


@given(unit, unit)
def test_random_points_against_the_definition(a: float, b: float) -> None:
    assert fls_lambda(a, b) == pytest.approx(from_definition(a, b), abs=SAMPLING)


def test_beyond_the_universe_counts_as_its_end() -> None:
    assert fls_lambda(7.0, -2.0) == fls_lambda(1.0, 1.0)


def test_description_names_every_rule_and_set() -> None:
    text = describe()
    assert text.count('IF delta1 is') == 9
    assert 'IF delta1 is N AND delta2 is P THEN lambda is PMAX' in text
    assert text.count('triangle') == len(INPUT_SETS) + len(OUTPUT_SETS)


def test_the_loop_does_not_import_scikit_fuzzy() -> None:
    code = (
        'import sys, flexarm_ros.core.run.warmup, flexarm_ros.core.control.fls_definition;'
        "sys.exit(any(m.split('.')[0] in ('skfuzzy', 'rclpy') for m in sys.modules))"
    )
    assert subprocess.run([sys.executable, '-c', code], check=False).returncode == 0
