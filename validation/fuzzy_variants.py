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
The fuzzy logic system with any odd number of functions, and other readings of its rules.

For studies only: the loop's own is :mod:`flexarm_ros.core.control.fls`, which is the
case ``half`` = 1 here.  With ``half`` functions on each side of ZERO an input
has 2 half + 1 triangles with equally spaced peaks and feet at the neighbours'
peaks; so has the output, ZERO to PMAX.  Table 1's intuition, lambda by the
"magnitude of resultant deformation", is that a rule's output is the sum of
how many steps each input is from ZERO: (ZERO, ZERO) gives ZERO, one step PM,
two PMAX.  The same sum gives the 25 rules of five functions, whose five
outputs it fills exactly.  Rule ``largest`` takes twice the larger of the two
instead, so that one bent link is as bad as two.
"""

from __future__ import annotations

from flexarm_ros.core.control.fls import _half_moments
from flexarm_ros.core.numerics.compiled import compiled, FloatArray
import numpy as np

RULES = ('sum', 'largest')


@compiled
def _lambda(a: float, b: float, half: int, largest: bool, strengths: FloatArray) -> float:
    """Min, max, centroid for |inputs| a and b; ``strengths`` ``(2 half + 1,)`` is scratch."""
    for level in range(2 * half + 1):
        strengths[level] = 0.0
    for i in range(half + 1):
        first = max(0.0, 1.0 - abs(a * half - i))
        for j in range(half + 1):
            fired = min(first, max(0.0, 1.0 - abs(b * half - j)))
            level = 2 * max(i, j) if largest else i + j
            strengths[level] = max(strengths[level], fired)
    # Between two neighbouring peaks of the output one set falls and one rises.
    area, moment = 0.0, 0.0
    for level in range(2 * half):
        part, first_moment = _half_moments(strengths[level], strengths[level + 1])
        area += part
        moment += level * part + first_moment
    return moment / (2 * half * area)


class FuzzyGain:
    """
    lambda as a function of the end deflections, m, with ``functions`` sets a variable.

    Raises ``ValueError`` for an even number, fewer than three, or an unknown rule.
    """

    def __init__(self, functions: int = 3, kn: float = 5.0, rule: str = 'sum') -> None:
        if functions < 3 or functions % 2 == 0:
            raise ValueError(f'functions: {functions}, allowed: 3, 5, 7, ...')
        if rule not in RULES:
            raise ValueError(f'rule: {rule!r}, allowed: {", ".join(RULES)}')
        self.functions, self.kn, self.rule = functions, kn, rule
        self._strengths = np.zeros(functions)

    def __call__(self, delta1: float, delta2: float) -> float:
        """Return lambda, from 1 / (3 (functions - 1)) at rest to 1 less that."""
        a, b = min(abs(delta1) / self.kn, 1.0), min(abs(delta2) / self.kn, 1.0)
        result: float = _lambda(a, b, self.functions // 2, self.rule == 'largest', self._strengths)
        return result
