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

"""A small symmetric solver without BLAS, for the mass matrix."""

from __future__ import annotations

from flexarm_ros.core.numerics.compiled import compiled, FloatArray


@compiled
def solve_symmetric(matrix: FloatArray, vector: FloatArray) -> None:
    """
    Solve ``matrix @ x = vector`` in place by LDL^T; ``vector`` becomes x.

    ``matrix`` ``(n, n)`` is symmetric positive definite; only its lower
    triangle is read, and overwritten.  The order of every sum is fixed.
    """
    n = vector.shape[0]
    for j in range(n):
        # Row j holds column j before the division, L_jk D_k: divide it here.
        pivot = matrix[j, j]
        for k in range(j):
            product = matrix[j, k]
            factor = product / matrix[k, k]
            pivot -= product * factor
            matrix[j, k] = factor
        matrix[j, j] = pivot
        for i in range(j + 1, n):
            value = matrix[i, j]
            for k in range(j):
                value -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = value
    for i in range(n):
        value = vector[i]
        for k in range(i):
            value -= matrix[i, k] * vector[k]
        vector[i] = value
    for i in range(n):
        vector[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        value = vector[i]
        for k in range(i + 1, n):
            value -= matrix[k, i] * vector[k]
        vector[i] = value
