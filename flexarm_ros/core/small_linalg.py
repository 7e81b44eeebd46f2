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
Eigenvalues and factors of matrices of a few rows, the same to the last bit everywhere.

LAPACK's last bits may change with its threads and its blocking; what these
functions give goes into the numbers of a run, which must not.
"""

from __future__ import annotations

import math

from flexarm_ros.core.compiled import compiled, FloatArray
import numpy as np


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (rising) and orthonormal eigenvectors (columns), by Jacobi rotations."""
    a = np.array(matrix, dtype=float)
    vectors = np.zeros_like(a)
    for i in range(len(a)):
        vectors[i, i] = 1.0
    _jacobi(a, vectors)
    values = np.array([a[i, i] for i in range(len(a))])
    order = np.argsort(values, kind='stable')
    return values[order], np.ascontiguousarray(vectors[:, order])


@compiled
def _jacobi(a: FloatArray, vectors: FloatArray) -> None:
    """Make ``a`` diagonal in place by cyclic sweeps; ``vectors`` collects the rotations."""
    n = a.shape[0]
    for _ in range(60):
        rotated = False
        for p in range(n):
            for q in range(p + 1, n):
                if abs(a[p, q]) > 4e-16 * math.sqrt(abs(a[p, p] * a[q, q])):
                    rotated = True
                    _rotate(a, vectors, p, q)
        if not rotated:
            break


@compiled
def _rotate(a: FloatArray, vectors: FloatArray, p: int, q: int) -> None:
    """Zero ``a[p, q]`` by a plane rotation."""
    tau = (a[q, q] - a[p, p]) / (2.0 * a[p, q])
    t = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
    c = 1.0 / math.sqrt(1.0 + t * t)
    s = t * c
    n = a.shape[0]
    for i in range(n):
        x, y = a[i, p], a[i, q]
        a[i, p] = c * x - s * y
        a[i, q] = s * x + c * y
        x, y = vectors[i, p], vectors[i, q]
        vectors[i, p] = c * x - s * y
        vectors[i, q] = s * x + c * y
    for i in range(n):
        x, y = a[p, i], a[q, i]
        a[p, i] = c * x - s * y
        a[q, i] = s * x + c * y
    a[p, q] = 0.0
    a[q, p] = 0.0


@compiled
def inverse_factor(matrix: FloatArray) -> FloatArray:
    """Return the inverse of the lower Cholesky factor of a positive definite matrix."""
    n = matrix.shape[0]
    low = np.zeros((n, n))
    inverse = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            s = matrix[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            low[i, j] = math.sqrt(s) if i == j else s / low[j, j]
    for j in range(n):
        inverse[j, j] = 1.0 / low[j, j]
        for i in range(j + 1, n):
            s = 0.0
            for k in range(j, i):
                s -= low[i, k] * inverse[k, j]
            inverse[i, j] = s / low[i, i]
    return inverse
