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
Products, factors and eigenvalues of small matrices, with reproducible bits.

The last bits of BLAS, LAPACK and ``einsum`` depend on threads, blocking and the vector unit; the
numbers of a run, which are computed with these functions, must not.
"""

from __future__ import annotations

import math

from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
import numpy as np


def symmetric_eigen(matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return eigenvalues (ascending) and orthonormal eigenvectors (columns), by Jacobi."""
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


@internal
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


def inverse_factor(matrix: FloatArray) -> FloatArray:
    """Return the inverse of the lower Cholesky factor of positive definite ``(..., n, n)``."""
    n = matrix.shape[-1]
    low, inverse = np.zeros_like(matrix), np.zeros_like(matrix)
    for i in range(n):
        for j in range(i + 1):
            s = matrix[..., i, j].copy()
            for k in range(j):
                s -= low[..., i, k] * low[..., j, k]
            low[..., i, j] = np.sqrt(s) if i == j else s / low[..., j, j]
    for j in range(n):
        inverse[..., j, j] = 1.0 / low[..., j, j]
        for i in range(j + 1, n):
            s = np.zeros(matrix.shape[:-2])
            for k in range(j, i):
                s -= low[..., i, k] * inverse[..., k, j]
            inverse[..., i, j] = s / low[..., i, i]
    return inverse


def product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a b ``(..., n, m)``, of shapes ``(..., n, k)`` and ``(..., k, m)``."""
    out = np.zeros((*a.shape[:-1], b.shape[-1]))
    for k in range(a.shape[-1]):
        out += a[..., :, k, None] * b[..., k, None, :]
    return out


@allocating
def weighted_gram(weights: FloatArray, rows: FloatArray) -> FloatArray:
    """Return the sums ``(n, n)`` of weight_q row_iq row_jq; ``rows`` ``(n, points)``."""
    n = rows.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            total = 0.0
            for q in range(rows.shape[1]):
                total += weights[q] * rows[i, q] * rows[j, q]
            out[i, j] = total
    return out


_SQUARINGS = 40


def spectral_radius(matrix: FloatArray) -> FloatArray:
    """
    Return the largest modulus of an eigenvalue: the limit of ||A^m||^(1/m) (Gelfand).

    Of each matrix in ``(..., n, n)``.  m is 2^40, by squaring; the m-th root reduces the norm's
    excess over the radius and the rounding of each square.
    """
    a, norms = matrix, []
    for _ in range(_SQUARINGS):
        squares = (a * a).reshape(*a.shape[:-2], -1)
        norms.append(np.sqrt(np.cumsum(squares, axis=-1)[..., -1]))  # in this order
        a = a / np.where(norms[-1] == 0.0, 1.0, norms[-1])[..., None, None]
        a = product(a, a)
    radius = np.ones(matrix.shape[:-2])
    for norm in reversed(norms):
        radius = norm * np.sqrt(radius)
    return radius


def largest_rate(mass: FloatArray, damping: FloatArray, stiffness: FloatArray) -> float:
    """
    Return the largest |s| of M s^2 + D s + K, with each M of ``(m, n, n)`` positive definite.

    ``damping`` and ``stiffness`` ``(n,)`` are the diagonals of D and K.
    """
    n = mass.shape[-1]
    inverse = inverse_factor(mass)
    # In coordinates of unit mass, positions scaled by a rate to balance the blocks.
    springs, dampers, trace = np.zeros_like(mass), np.zeros_like(mass), np.zeros(len(mass))
    for k in range(n):
        both = inverse[:, :, k, None] * inverse[:, None, :, k]
        springs += both * stiffness[k]
        dampers += both * damping[k]
    for i in range(n):
        trace += springs[:, i, i]
    scale = np.sqrt(trace)[:, None, None]
    system = np.zeros((len(mass), 2 * n, 2 * n))
    system[:, :n, n:] = scale * np.eye(n)
    system[:, n:, :n] = -springs / scale
    system[:, n:, n:] = -dampers
    return float(np.max(spectral_radius(system)))


@internal
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


@internal
def solve_upper(matrix: FloatArray, vector: FloatArray) -> None:
    """
    Solve ``matrix @ x = vector`` in place by LDL^T, row by row; ``vector`` becomes x.

    ``matrix`` ``(n, n)`` is symmetric positive definite; only its upper triangle is read, and
    overwritten.  Eliminating a row from all those below it works on contiguous numbers that do
    not depend on one another, so that the compiler can vectorise it for an n that it knows.
    """
    n = len(matrix)
    for k in range(n):
        inverse = 1.0 / matrix[k, k]
        matrix[k, k] = inverse
        right = vector[k]
        for i in range(k + 1, n):
            factor = matrix[k, i] * inverse
            for j in range(i, n):
                matrix[i, j] -= factor * matrix[k, j]
            vector[i] -= factor * right
    for i in range(n - 1, -1, -1):
        value = vector[i]
        for j in range(i + 1, n):
            value -= matrix[i, j] * vector[j]
        vector[i] = value * matrix[i, i]


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


@internal
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


@internal
def transpose_times(a: FloatArray, v: FloatArray, out: FloatArray) -> None:
    """Set ``out`` (n,) to a^T v, of shapes (k, n) and (k,)."""
    out[:] = 0.0
    for k in range(a.shape[0]):
        for i in range(a.shape[1]):
            out[i] += a[k, i] * v[k]


@internal
def symmetrise(a: FloatArray) -> None:
    """Replace the square ``a`` by the mean of itself and its transpose."""
    for i in range(a.shape[0]):
        for j in range(i):
            mean = 0.5 * (a[i, j] + a[j, i])
            a[i, j] = mean
            a[j, i] = mean


@internal
def add_outer(jacobian: FloatArray, factor: float, out: FloatArray) -> None:
    """Add factor J^T J to the upper left of ``out``; ``jacobian`` (2, n)."""
    n = jacobian.shape[1]
    for i in range(n):
        for k in range(n):
            product = jacobian[0, i] * jacobian[0, k] + jacobian[1, i] * jacobian[1, k]
            out[i, k] += factor * product


@internal
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
