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
Kalman filter along a planned motion, with the tip sensor's latency and unknowns in the model.

The estimate is z = (x, b, c): the state; five unknowns b (logarithms of EI
and density, the latency's error, a disturbance torque per joint), each a random
walk; and a chain c of positions of the sensed point at this and earlier ticks,
which makes the delayed reading a linear output (Anderson and Moore,
Optimal Filtering, 1979, section 7.3: fixed-lag smoothing by augmentation).
Covariances are propagated along the plan once, before the run; the gains are
functions of time.  *Considered* unknowns count in the covariance but are not
corrected (Schmidt, 1966), the cautious treatment of parameters that are poorly
known.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.control.design.model import (
    Arm,
    discretise,
    linearise,
    point_jacobian,
    sensitivity,
)
from flexarm_ros.core.control.design.plan import Grid, Motion
from flexarm_ros.core.numerics.compiled import allocating, compiled, FloatArray, internal
from flexarm_ros.core.numerics.records import Records
import numpy as np

UNKNOWNS = 5
"""log EI, log density, latency (s), torque disturbances 1 and 2 (N m)."""


class FilterModel(NamedTuple):
    """
    Latency in ticks, integer and fraction; ticks per tip sample; variances; unknowns.

    ``variances`` (3,): of angles, rates and tip positions as measured.
    ``noise`` (3,): spectral densities of torque ((N m)^2 s) and of accelerations of the
    joints and of the elastic coordinates.  ``start``: initial variances of (x, b).
    ``wander`` (5,): growth of the variance of b per tick.  ``considered`` (5,): 1 for an
    unknown that is not corrected.
    """

    whole: int
    part: float
    every: int
    variances: FloatArray
    noise: FloatArray
    start: FloatArray
    wander: FloatArray
    considered: FloatArray


@internal
def shift_chain(p: FloatArray, chain: int) -> None:
    """Make room for the newest point: entries from ``chain`` on move by two."""
    total = p.shape[0]
    for i in range(total - 1, chain + 1, -1):
        for j in range(total - 1, chain + 1, -1):
            p[i, j] = p[i - 2, j - 2]
    for i in range(total - 1, chain + 1, -1):
        for j in range(chain):
            p[i, j] = p[i - 2, j]


@internal
def carry_cross(p: FloatArray, ad: FloatArray, drive: FloatArray, carried: FloatArray) -> None:
    """Set ``carried`` (2n, total) to the rows of F p that belong to x."""
    size, total, unknowns = ad.shape[0], p.shape[0], drive.shape[1]
    for i in range(size):
        for j in range(total):
            carried[i, j] = 0.0
        for k in range(size):
            f = ad[i, k]
            if f != 0.0:
                for j in range(total):
                    carried[i, j] += f * p[k, j]
        for k in range(unknowns):
            f = drive[i, k]
            if f != 0.0:
                for j in range(total):
                    carried[i, j] += f * p[size + k, j]


@internal
def place_state(
    p: FloatArray, ad: FloatArray, drive: FloatArray, noise: FloatArray, carried: FloatArray
) -> None:
    """Write the new rows and columns of x into ``p``, whose chain has been shifted."""
    size, unknowns, total = ad.shape[0], drive.shape[1], p.shape[0]
    chain = size + unknowns
    for i in range(size):
        for j in range(size, chain):
            p[i, j] = carried[i, j]
            p[j, i] = carried[i, j]
        for j in range(chain + 2, total):
            p[i, j] = carried[i, j - 2]
            p[j, i] = carried[i, j - 2]
        for j in range(i + 1):
            s = noise[i, j]
            for k in range(size):
                s += carried[i, k] * ad[j, k]
            for k in range(unknowns):
                s += carried[i, size + k] * drive[j, k]
            p[i, j] = s
            p[j, i] = s


@internal
def place_newest(p: FloatArray, output: FloatArray, chain: int) -> None:
    """Set the rows of the newest point, ``output`` (2, n) times those of q."""
    n, total = output.shape[1], p.shape[0]
    for c in range(2):
        for j in range(total):
            s = 0.0
            for k in range(n):
                s += output[c, k] * p[k, j]
            p[chain + c, j] = s
    for c in range(2):
        for d in range(2):
            s = 0.0
            for k in range(n):
                s += output[d, k] * p[chain + c, k]
            p[chain + c, chain + d] = s
    for c in range(2):
        for j in range(total):
            if j < chain or j >= chain + 2:
                p[j, chain + c] = p[chain + c, j]


@compiled
def predict(
    p: FloatArray, ad: FloatArray, drive: FloatArray, output: FloatArray, noise: FloatArray,
    wander: FloatArray, carried: FloatArray,
) -> None:  # fmt: skip
    """Propagate the covariance ``p`` of z over a tick."""
    size = ad.shape[0]
    chain = size + drive.shape[1]
    carry_cross(p, ad, drive, carried)
    shift_chain(p, chain)
    for i in range(size, chain):
        for j in range(chain + 2, p.shape[0]):
            p[i, j] = p[j, i]
    place_state(p, ad, drive, noise, carried)
    for k in range(wander.shape[0]):
        p[size + k, size + k] += wander[k]
    place_newest(p, output, chain)


@compiled
def update(
    p: FloatArray, places: tuple[int, int, int], factors: tuple[float, float, float],
    variance: float, which: int, first: int, considered: FloatArray, column: FloatArray,
    gains: FloatArray,
) -> None:  # fmt: skip
    """
    Update by one scalar reading, the weighted sum of three entries of z.

    Sequential gains are combined so that ``gains`` (total, 6) acts on the innovations of all
    six readings before any update.
    """
    total = p.shape[0]
    i0, i1, i2 = places
    a, b, c = factors
    for i in range(total):
        column[i] = a * p[i, i0] + b * p[i, i1] + c * p[i, i2]
    s = a * column[i0] + b * column[i1] + c * column[i2] + variance
    for i in range(total):
        gains[i, which] = column[i] / s
    for i in range(considered.shape[0]):
        if considered[i] == 1.0:
            gains[first + i, which] = 0.0
    for i in range(total):
        f = gains[i, which]
        g = column[i] - f * s
        for j in range(total):
            p[i, j] -= f * column[j] + g * gains[j, which]
    for j in range(which):
        seen = a * gains[i0, j] + b * gains[i1, j] + c * gains[i2, j]
        for i in range(total):
            gains[i, j] -= gains[i, which] * seen


@internal
def update_all(
    p: FloatArray, setup: FilterModel, n: int, velocity: tuple[float, float], tip: bool,
    column: FloatArray, gains: FloatArray,
) -> None:  # fmt: skip
    """Update by both angles, both rates and, with ``tip``, the delayed x and y."""
    size, var = 2 * n, setup.variances
    chain = size + UNKNOWNS
    one = (1.0, 0.0, 0.0)
    considered = setup.considered
    gains[:, :] = 0.0
    update(p, (0, 0, 0), one, var[0], 0, size, considered, column, gains)
    update(p, (1, 1, 1), one, var[0], 1, size, considered, column, gains)
    update(p, (n, n, n), one, var[1], 2, size, considered, column, gains)
    update(p, (n + 1, n + 1, n + 1), one, var[1], 3, size, considered, column, gains)
    if not tip:
        return
    for c in range(2):
        newer = chain + 2 * setup.whole + c
        factors = (1.0 - setup.part, setup.part, -velocity[c])
        update(
            p,
            (newer, newer + 2, size + 2),
            factors,
            var[2],
            4 + c,
            size,
            considered,
            column,
            gains,
        )


@internal
def drive_and_noise(
    bd: FloatArray, period: float, setup: FilterModel, drive: FloatArray, noise: FloatArray
) -> None:
    """Set the effect of the unknowns on x, and the covariance of a tick's noise in x."""
    size = bd.shape[0]
    n = size // 2
    for i in range(size):
        drive[i, 0], drive[i, 1] = bd[i, 2], bd[i, 3]
        drive[i, 2], drive[i, 3], drive[i, 4] = 0.0, bd[i, 0], bd[i, 1]
        for k in range(size):
            product = bd[i, 0] * bd[k, 0] + bd[i, 1] * bd[k, 1]
            noise[i, k] = setup.noise[0] * product / period
    for i in range(n):
        noise[n + i, n + i] += setup.noise[1 if i < 2 else 2] * period


@allocating
def fill_filter(
    arm: Arm, around: tuple[Records, Records, Records, Records], apart: float,
    setup: FilterModel, grid: Grid, motion: Motion, gains: FloatArray,
) -> None:  # fmt: skip
    """Fill ``gains`` (K, total, 6), those of each interval's last tick with a tip reading."""
    count, total, size = gains.shape[0], gains.shape[1], motion.state.shape[1]
    n, period = size // 2, grid.substeps * grid.step
    p, carried = np.zeros((total, total)), np.zeros((size, total))
    column, kept = np.zeros(total), np.zeros((total, 6))
    rows, ad, bd = np.zeros((n, size + 4)), np.zeros((size, size)), np.zeros((size, 4))
    drive, noise = np.zeros((size, UNKNOWNS)), np.zeros((size, size))
    output, past = np.zeros((2, n)), np.zeros((2, n))
    for i in range(size + UNKNOWNS):
        p[i, i] = setup.start[i]
    back = int(round((setup.whole + setup.part) / grid.ticks))
    for j in range(count):
        tau = motion.torque[j]
        linearise(arm, motion.state[j], tau[0], tau[1], rows)
        sensitivity(arm, around, apart, motion.state[j], tau[0], tau[1], rows)
        discretise(rows, period, ad, bd)
        drive_and_noise(bd, period, setup, drive, noise)
        then = motion.state[max(j - back, 0)]
        point_jacobian(arm.sensed, then[:n], past)
        point_jacobian(arm.sensed, motion.state[j, :n], output)
        vx, vy = 0.0, 0.0
        for i in range(n):
            vx += past[0, i] * then[n + i]
            vy += past[1, i] * then[n + i]
        for tick in range(j * grid.ticks, (j + 1) * grid.ticks):
            tip = tick % setup.every == 0
            update_all(p, setup, n, (vx, vy), tip, column, kept)
            if tip:
                gains[j] = kept
            predict(p, ad, drive, output, noise, setup.wander, carried)
