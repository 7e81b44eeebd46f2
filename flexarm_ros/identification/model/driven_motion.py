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
Compiled motion of the arm's elastic coordinates while its joints move as measured.

The joint angles are linear between samples, so that their rates jump at each sample.  At a jump
the elastic rates change by -M_ee^-1 M_ej (change of the joint rates), as the momenta of the
elastic coordinates stay the same; in between the joints have no acceleration.  No acceleration of
a measured angle is needed, and the quantisation of an encoder adds no error that grows.

A state is ``(qe, dqe, s)``: elastic coordinates of both links (2N), their rates (2N), and for
each gauge the state of its low-pass (value, rate; 4).
"""

from __future__ import annotations

import math

from flexarm_ros.core.arm.driven.terms import FullTerms, terms
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
from flexarm_ros.core.sensing.gauge import FILTERED, gauge_input
from flexarm_ros.core.sensing.lowpass import follow
import numpy as np
from numpy.typing import NDArray

IntArray = NDArray[np.int64]


@compiled
def advance(
    model: FullTerms,
    q: FloatArray,
    qd: FloatArray,
    change: FloatArray,
    h: float,
    substeps: int,
    mass: FloatArray,
    force: FloatArray,
    factor: FloatArray,
    stage: FloatArray,
) -> None:
    """
    Advance ``q``, ``qd`` (2 + 2N,) by ``substeps`` steps of h s with constant joint rates.

    ``change`` (2,): the jump of the joint rates before, rad/s; ``qd[:2]`` are the rates after it.
    Each step takes mass matrix and centrifugal terms at its middle, and integrates the then linear
    motion by the classical Runge-Kutta method.
    """
    size = model.diagonals.shape[1] - 2
    x, rest = stage[2], stage[4]
    for number in range(substeps):
        for i in range(2 + size):
            x[i] = q[i] + 0.5 * h * qd[i]
        terms(model, x, qd, mass, force)
        for i in range(2, 2 + size):  # what is not linear in the elastic coordinates
            force[i] += model.diagonals[0, i] * x[i] + model.diagonals[1, i] * qd[i]
        _factorise(mass, factor)
        if number == 0:
            for i in range(size):
                rest[i] = -(mass[2 + i, 0] * change[0] + mass[2 + i, 1] * change[1])
            _substitute(factor, rest)
            for i in range(size):
                qd[2 + i] += rest[i]
        _runge_kutta(model.diagonals, q, qd, h, force, factor, stage)
        for i in range(2):
            q[i] += h * qd[i]


@internal
def _runge_kutta(
    diagonals: FloatArray,
    q: FloatArray,
    qd: FloatArray,
    h: float,
    force: FloatArray,
    factor: FloatArray,
    stage: FloatArray,
) -> None:
    """Advance the elastic coordinates by one step with constant mass matrix and ``force``."""
    size = factor.shape[0]
    start, rate, x, v, rest = stage[0], stage[1], stage[2], stage[3], stage[4]
    for i in range(size):
        start[i] = x[i] = q[2 + i]
        rate[i] = v[i] = qd[2 + i]
    for k in range(4):
        for i in range(size):
            elastic = diagonals[0, 2 + i] * x[i] + diagonals[1, 2 + i] * v[i]
            rest[i] = force[2 + i] - elastic
        _substitute(factor, rest)
        weight = h / 6.0 if k == 0 or k == 3 else h / 3.0
        ahead = h if k == 2 else 0.5 * h
        for i in range(size):
            q[2 + i] += weight * v[i]
            qd[2 + i] += weight * rest[i]
            x[i] = start[i] + ahead * v[i]
            v[i] = rate[i] + ahead * rest[i]


@internal
def _factorise(mass: FloatArray, factor: FloatArray) -> None:
    """Fill ``factor`` (2N, 2N) with Cholesky's of the elastic block; inverse diagonal."""
    for i in range(factor.shape[0]):
        for j in range(i + 1):
            s = mass[2 + i, 2 + j]
            for k in range(j):
                s -= factor[i, k] * factor[j, k]
            factor[i, j] = 1.0 / math.sqrt(s) if i == j else s * factor[j, j]


@internal
def _substitute(factor: FloatArray, rhs: FloatArray) -> None:
    """Solve in place with what `_factorise` left."""
    size = factor.shape[0]
    for i in range(size):
        s = rhs[i]
        for k in range(i):
            s -= factor[i, k] * rhs[k]
        rhs[i] = s * factor[i, i]
    for i in range(size - 1, -1, -1):
        s = rhs[i]
        for k in range(i + 1, size):
            s -= factor[k, i] * rhs[k]
        rhs[i] = s * factor[i, i]


@allocating
def driven(
    model: FullTerms,
    shapes: FloatArray,
    gauges: FloatArray,
    lowpass: FloatArray,
    angles: FloatArray,
    period: float,
    substeps: int,
    on: IntArray,
    first: int,
    last: int,
    start: FloatArray,
    correction: FloatArray,
    measured: FloatArray,
    outputs: FloatArray,
    states: FloatArray,
) -> None:
    """
    Predict samples ``first`` to ``last`` (excluded) from the state ``start``, (4N + 4,).

    ``angles`` (n, 2): measured joint angles, rad.  ``lowpass`` (2, 2, 4): each gauge's low-pass
    over one sample, rows over (value, rate, input before, input after).  ``on`` (2,): the sample
    up to which each gauge's low-pass is held.  ``outputs`` (n, 2) takes the gauges' signals
    before any correction; ``states`` (n, 4N + 4) the states, or nothing if it has no rows.
    ``correction`` (4N + 4, 2): gain on ``measured`` - ``outputs``; no columns: none.
    """
    size = model.diagonals.shape[1] - 2
    q, qd = np.zeros(2 + size), np.zeros(2 + size)
    mass, force = np.zeros((2 + size, 2 + size)), np.zeros(2 + size)
    factor, stage = np.zeros((size, size)), np.zeros((5, 2 + size))
    change, before = np.zeros(2), np.zeros(2)
    state = start.copy()
    h = period / substeps
    for k in range(first, last):
        sense(shapes, gauges, angles[k], state, before, outputs[k])
        if correction.shape[1] > 0 and k > first:
            _correct(correction, measured[k], outputs[k], state, on, k)
            for link in range(2):
                before[link] = gauge_input(link, shapes, gauges, angles[k], state)
        if states.shape[0] > 0:
            states[k] = state
        if k == last - 1:
            break
        for i in range(2):
            held = (angles[k, i] - angles[k - 1, i]) / period if k > 0 else 0.0
            q[i], qd[i] = angles[k, i], (angles[k + 1, i] - angles[k, i]) / period
            change[i] = qd[i] - held
        for i in range(size):
            q[2 + i], qd[2 + i] = state[i], state[size + i]
        advance(model, q, qd, change, h, substeps, mass, force, factor, stage)
        for i in range(size):
            state[i], state[size + i] = q[2 + i], qd[2 + i]
        pass_low(shapes, gauges, lowpass, angles[k + 1], state, before, on, k)


@internal
def _correct(
    correction: FloatArray,
    measured: FloatArray,
    output: FloatArray,
    state: FloatArray,
    on: IntArray,
    sample: int,
) -> None:
    """Correct ``state`` by the errors of the gauges that give a signal."""
    for link in range(2):
        if sample >= on[link]:
            error = measured[link] - output[link]
            for i in range(state.shape[0]):
                state[i] += correction[i, link] * error


@internal
def sense(
    shapes: FloatArray,
    gauges: FloatArray,
    angles: FloatArray,
    state: FloatArray,
    before: FloatArray,
    output: FloatArray,
) -> None:
    """Fill the gauges' signals of one sample before and behind their low-pass, (2,) each."""
    row = state.shape[0] - 4
    for link in range(2):
        before[link] = gauge_input(link, shapes, gauges, angles, state)
        filtered = gauges[link, FILTERED] > 0.0
        output[link] = state[row + 2 * link] if filtered else before[link]


@internal
def pass_low(
    shapes: FloatArray,
    gauges: FloatArray,
    lowpass: FloatArray,
    angles: FloatArray,
    state: FloatArray,
    before: FloatArray,
    on: IntArray,
    sample: int,
) -> None:
    """Advance the low-passes, the last four entries of ``state``, from ``sample`` to the next."""
    for link in range(2):
        if sample < on[link]:
            continue
        after = gauge_input(link, shapes, gauges, angles, state)
        row = state.shape[0] - 4 + 2 * link
        follow(lowpass[link], state[row : row + 2], before[link], after)
