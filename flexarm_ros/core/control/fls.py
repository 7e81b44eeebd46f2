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
The fuzzy logic system of (21), evaluated exactly.

The definition is :mod:`flexarm_ros.core.control.fls_definition`; this is its closed form.
With a = |delta1| / K_n and b = |delta2| / K_n on [0, 1] the nine rules of Table 1 fire
three output sets,

    ZERO: min(1 - a, 1 - b),  PM: max(min(a, 1 - b), min(1 - a, b)),  PMAX: min(a, b),

since N and P of an input are the two halves of its absolute value and the
table is symmetric.  Each half of the universe of lambda then holds one falling
and one rising ramp, clipped at their rules' strengths.  The area under their
maximum is the sum of both minus that under their minimum: the centroid is
a quotient of polynomials in the strengths, without sampling.
"""

from __future__ import annotations

from flexarm_ros.core.numerics.compiled import compiled, internal


@internal
def _half_moments(falling: float, rising: float) -> tuple[float, float]:
    """Area and first moment on s in [0, 1] of max(min(falling, 1 - s), min(rising, s))."""
    fall_area = falling * (1.0 - 0.5 * falling)
    rise_area = rising * (1.0 - 0.5 * rising)
    least = min(falling, rising)
    both_area = least * (1.0 - least) if least < 0.5 else 0.25
    fall_moment = fall_area - falling * (0.5 - falling * falling / 6.0)
    rise_moment = rising * (0.5 - rising * rising / 6.0)
    return fall_area + rise_area - both_area, fall_moment + rise_moment - 0.5 * both_area


@compiled
def fls_lambda(input1: float, input2: float) -> float:
    """
    Return lambda for the normalised deflections delta1 / K_n and delta2 / K_n.

    Inputs beyond the universe [-1, 1] are clipped; the value is from
    lambda(0, 0) = 1/6 to lambda(+-1, +-1) = 5/6.
    """
    a, b = min(abs(input1), 1.0), min(abs(input2), 1.0)
    zero = min(1.0 - a, 1.0 - b)
    medium = max(min(a, 1.0 - b), min(1.0 - a, b))
    largest = min(a, b)
    left_area, left = _half_moments(zero, medium)
    # The right half is the left one mirrored, with PMAX instead of ZERO.
    right_area, right = _half_moments(largest, medium)
    area = left_area + right_area
    # s = 2 lambda on the left, s = 2 (1 - lambda) on the right.
    return (0.5 * left + right_area - 0.5 * right) / area
