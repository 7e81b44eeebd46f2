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

"""Small dense matrix arithmetic in plain loops, with reproducible bits."""

from __future__ import annotations

from flexarm_ros.core.numerics.compiled import compiled, FloatArray


@compiled
def multiply(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (n, m) to a b, of shapes (n, k) and (k, m)."""
    for i in range(a.shape[0]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
        for k in range(a.shape[1]):
            factor = a[i, k]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]


@compiled
def transpose_multiply(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (n, m) to a^T b, of shapes (k, n) and (k, m)."""
    for i in range(a.shape[1]):
        for j in range(b.shape[1]):
            out[i, j] = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            factor = a[k, i]
            if factor != 0.0:
                for j in range(b.shape[1]):
                    out[i, j] += factor * b[k, j]


@compiled
def transpose_times(a: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (n,) to a^T v, of shapes (k, n) and (k,)."""
    out[:] = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            out[i] += a[k, i] * v[k]


@compiled
def symmetrise(a: FloatArray) -> None:
    """Replace the square ``a`` by the mean of itself and its transpose."""
    for i in range(a.shape[0]):
        for j in range(i):
            mean = 0.5 * (a[i, j] + a[j, i])
            a[i, j] = mean
            a[j, i] = mean


@compiled
def add_outer(jacobian: FloatArray, factor: float, out: FloatArray) -> None:
    """Add factor J^T J to the upper left of ``out``; ``jacobian`` (2, n)."""
    n = jacobian.shape[1]
    for i in range(n):
        for k in range(n):
            product = jacobian[0, i] * jacobian[0, k] + jacobian[1, i] * jacobian[1, k]
            out[i, k] += factor * product


@compiled
def gains_of_two(
    inner: FloatArray, cross: FloatArray, lead: FloatArray, feedback: FloatArray,
    change: FloatArray,
) -> None:  # fmt: skip
    """Set ``feedback`` (2, m) to -inner^-1 cross and ``change`` (2,) to -inner^-1 lead."""
    det = inner[0, 0] * inner[1, 1] - inner[0, 1] * inner[0, 1]
    a, b, d = inner[1, 1] / det, inner[0, 1] / det, inner[0, 0] / det
    change[0] = -(a * lead[0] - b * lead[1])
    change[1] = -(d * lead[1] - b * lead[0])
    for i in range(cross.shape[1]):
        feedback[0, i] = -(a * cross[0, i] - b * cross[1, i])
        feedback[1, i] = -(d * cross[1, i] - b * cross[0, i])
