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
Exact natural frequencies of the two-link arm by its dynamic stiffness matrix.

Independent of the package: each link is the exact solution of the
Euler-Bernoulli equation at a frequency, a combination of cos, sin, cosh and
sinh, condensed to the displacement and slope of its ends; Wittrick and
Williams' count (Q. J. Mech. Appl. Math. 24, 1971) finds every root, however
close two of them lie.

Small motion about straight links at elbow angle theta2.  The elbow moves by w
across link 1, hence by w cos(theta2) across link 2 and w sin(theta2) along it,
where link 2 follows as a rigid (inextensible) body.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Chain:
    """Two links (SI units; pairs: link 1, link 2); masses at the elbow and at the tip."""

    length: tuple[float, float] = (4.5, 4.5)
    density: tuple[float, float] = (0.335, 0.335)
    rigidity: tuple[float, float] = (1676.0, 1676.0)
    hub: tuple[float, float] = (0.0, 0.0)
    end_mass: tuple[float, float] = (0.0, 0.0)
    end_inertia: tuple[float, float] = (0.0, 0.0)
    rigid_start: tuple[float, float] = (0.0, 0.0)
    rigid_end: tuple[float, float] = (0.0, 0.0)


def clamped_roots(count: int) -> list[float]:
    """Return the first roots of cos(z) cosh(z) = 1."""
    return [
        brentq(
            lambda z: math.cos(z) - 1.0 / math.cosh(z), (i + 1.2) * math.pi, (i + 1.8) * math.pi
        )
        for i in range(count)
    ]


_ROOTS = clamped_roots(40)


def beam(length: float, density: float, rigidity: float, omega: float) -> Array:
    """Return the 4 x 4 dynamic stiffness over (w0, slope0, wL, slopeL), forces likewise."""
    k = math.sqrt(omega * math.sqrt(density / rigidity))
    c, s = math.cos(k * length), math.sin(k * length)
    ch, sh = math.cosh(k * length), math.sinh(k * length)
    ends = np.array(
        [
            [1.0, 0.0, 1.0, 0.0],
            [0.0, k, 0.0, k],
            [c, s, ch, sh],
            [-k * s, k * c, k * sh, k * ch],
        ]
    )
    # Forces on the beam from outside: at 0, shear EI w''' and moment -EI w''; at L, opposite.
    loads = rigidity * np.array(
        [
            [0.0, -(k**3), 0.0, k**3],
            [k**2, 0.0, -(k**2), 0.0],
            [-(k**3) * s, k**3 * c, -(k**3) * sh, -(k**3) * ch],
            [-(k**2) * c, -(k**2) * s, k**2 * ch, k**2 * sh],
        ]
    )
    stiffness: Array = np.linalg.solve(ends.T, loads.T).T
    return 0.5 * (stiffness + stiffness.T)


def assembled(chain: Chain, theta2: float, shoulder: bool, elbow: bool, omega: float) -> Array:
    """
    Return the dynamic stiffness over the free coordinates.

    Coordinates: slope at the shoulder, elbow displacement, slope at link 1's
    end, slope at link 2's start, tip displacement, tip slope.  ``shoulder``
    and ``elbow``: locked.
    """
    total = np.zeros((6, 6))
    cosine, sine = math.cos(theta2), math.sin(theta2)
    # Rows: (w0, slope0, wL, slopeL) of each link over the six coordinates.
    first, second = np.zeros((4, 6)), np.zeros((4, 6))
    first[1, 0] = first[2, 1] = first[3, 2] = 1.0
    second[0, 1], second[1, 3], second[2, 4], second[3, 5] = cosine, 1.0, 1.0, 1.0
    for link, rows in enumerate((first, second)):
        part = beam(chain.length[link], chain.density[link], chain.rigidity[link], omega)
        rows[0] += chain.rigid_start[link] * rows[1]
        rows[2] -= chain.rigid_end[link] * rows[3]
        total += rows.T @ part @ rows
    square = omega**2
    carried = chain.density[1] * chain.length[1] + chain.end_mass[1]
    total[1, 1] -= square * (carried * sine**2 + chain.end_mass[0])
    total[2, 2] -= square * chain.end_inertia[0]
    total[4, 4] -= square * chain.end_mass[1]
    total[5, 5] -= square * chain.end_inertia[1]
    total[0, 0] -= square * chain.hub[0]
    turn = np.zeros(6)
    turn[3], turn[2] = 1.0, -1.0
    total -= square * chain.hub[1] * np.outer(turn, turn)
    keep = np.eye(6)
    if elbow:
        keep[:, 2] += keep[:, 3]
        keep = np.delete(keep, 3, axis=1)
    if shoulder:
        keep = np.delete(keep, 0, axis=1)
    return np.asarray(keep.T @ total @ keep)


def count_below(chain: Chain, theta2: float, shoulder: bool, elbow: bool, omega: float) -> int:
    """Return how many natural frequencies, rigid modes included, lie below ``omega``."""
    matrix = assembled(chain, theta2, shoulder, elbow, omega)
    scale = 1.0 / np.sqrt(np.abs(np.diag(matrix)))
    negative = int(np.sum(np.linalg.eigvalsh(matrix * np.outer(scale, scale)) < 0.0))
    for length, density, rigidity in zip(chain.length, chain.density, chain.rigidity, strict=True):
        unit = math.sqrt(rigidity / density) / length**2
        negative += sum(root**2 * unit < omega for root in _ROOTS)
    return negative


def frequencies(chain: Chain, theta2: float, shoulder: bool, elbow: bool, count: int = 4) -> Array:
    """Return the first natural frequencies, rad/s, rigid modes left out, to 1e-9 of each."""
    rigid = 2 - shoulder - elbow
    result = []
    for index in range(rigid, rigid + count):
        low, high = 1e-3, 1.0
        while count_below(chain, theta2, shoulder, elbow, high) <= index:
            low, high = high, 2.0 * high
        while high - low > 1e-9 * high:
            middle = 0.5 * (low + high)
            if count_below(chain, theta2, shoulder, elbow, middle) <= index:
                low = middle
            else:
                high = middle
        result.append(0.5 * (low + high))
    return np.array(result)
