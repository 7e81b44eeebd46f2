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
The one definition of the fuzzy logic system: Figures 2 and 3, Table 1.

Membership functions and rules are given here as numbers; :func:`build` makes
a scikit-fuzzy control system from them, which can be printed, plotted and
evaluated (slowly: 5 ms per value).  The loop uses the exact evaluation of
:mod:`flexarm_ros.core.control.fls`, which the tests compare with this one.
scikit-fuzzy is imported only when needed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

INPUTS = ('delta1', 'delta2')
"""End deflections of the links divided by K_n, on the universe [-1, 1]."""

OUTPUT = 'lambda'
"""The gain factor of (21), on the universe [0, 1]."""

INPUT_SETS: dict[str, tuple[float, float, float]] = {
    'N': (-1.0, -1.0, 0.0),
    'ZERO': (-1.0, 0.0, 1.0),
    'P': (0.0, 1.0, 1.0),
}
"""Triangles (left foot, peak, right foot) of both inputs."""

OUTPUT_SETS: dict[str, tuple[float, float, float]] = {
    'ZERO': (0.0, 0.0, 0.5),
    'PM': (0.0, 0.5, 1.0),
    'PMAX': (0.5, 1.0, 1.0),
}
"""Triangles of the output."""

RULES: dict[tuple[str, str], str] = {
    ('N', 'N'): 'PMAX', ('N', 'ZERO'): 'PM', ('N', 'P'): 'PMAX',
    ('ZERO', 'N'): 'PM', ('ZERO', 'ZERO'): 'ZERO', ('ZERO', 'P'): 'PM',
    ('P', 'N'): 'PMAX', ('P', 'ZERO'): 'PM', ('P', 'P'): 'PMAX',
}  # fmt: skip
"""Table 1: (set of delta1, set of delta2) -> set of lambda."""


def build(samples: int = 2001) -> Any:
    """
    Return the ``skfuzzy.control.ControlSystem``: min, max, centroid.

    ``samples`` is the number of points on each universe; scikit-fuzzy's
    centroid is exact except for kinks between the points.
    """
    from skfuzzy import control, trimf

    inputs = []
    for name in INPUTS:
        variable = control.Antecedent(np.linspace(-1.0, 1.0, samples), name)
        for label, feet in INPUT_SETS.items():
            variable[label] = trimf(variable.universe, feet)
        inputs.append(variable)
    output = control.Consequent(np.linspace(0.0, 1.0, samples), OUTPUT, 'centroid')
    for label, feet in OUTPUT_SETS.items():
        output[label] = trimf(output.universe, feet)
    first, second = inputs
    rules = [control.Rule(first[a] & second[b], output[c]) for (a, b), c in RULES.items()]
    return control.ControlSystem(rules)


def describe() -> str:
    """Return membership functions and rules as text, one per line."""
    lines = [f'{" and ".join(INPUTS)} on [-1, 1]:']
    lines += [f'  {label}: triangle {feet}' for label, feet in INPUT_SETS.items()]
    lines.append(f'{OUTPUT} on [0, 1]:')
    lines += [f'  {label}: triangle {feet}' for label, feet in OUTPUT_SETS.items()]
    lines += [
        f'IF {INPUTS[0]} is {a} AND {INPUTS[1]} is {b} THEN {OUTPUT} is {c}'
        for (a, b), c in RULES.items()
    ]
    return '\n'.join(lines)
