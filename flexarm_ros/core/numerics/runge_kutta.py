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
Explicit Runge-Kutta methods as tableaus.

The classical method of fourth order, and DOP853, of eighth order with 12 stages (Hairer, Norsett
and Wanner, Solving Ordinary Differential Equations I, 2nd edition, section II.10), here with
fixed steps and without its error estimate.
"""

from __future__ import annotations

from typing import NamedTuple

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np


class Tableau(NamedTuple):
    """
    A method with s stages: ``order``, ``a`` (s, s), strictly lower triangular, and ``b`` (s,).

    ``stable``: largest phase w h, rad, at which an undamped mode of frequency w does not grow.
    """

    order: int
    a: FloatArray
    b: FloatArray
    stable: float


def _tableau(
    order: int, rows: list[dict[int, float]], weights: dict[int, float], stable: float
) -> Tableau:
    a, b = np.zeros((len(rows) + 1, len(rows) + 1)), np.zeros(len(rows) + 1)
    for stage, row in enumerate(rows, start=1):
        for j, value in row.items():
            a[stage, j] = value
    for j, value in weights.items():
        b[j] = value
    return Tableau(order, a, b, stable)


RK4 = _tableau(
    4,
    [{0: 0.5}, {1: 0.5}, {2: 1.0}],
    {0: 1.0 / 6.0, 1: 1.0 / 3.0, 2: 1.0 / 3.0, 3: 1.0 / 6.0},
    2.82,
)

_DOP853_A: list[dict[int, float]] = [
    {0: 0.05260015195876773},
    {0: 0.0197250569845379, 1: 0.0591751709536137},
    {0: 0.02958758547680685, 2: 0.08876275643042054},
    {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
    {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
    {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
    {
        0: 0.03709200011850479,
        3: 0.17038392571223998,
        4: 0.10726203044637328,
        5: -0.015319437748624402,
        6: 0.008273789163814023,
    },
    {
        0: 0.6241109587160757,
        3: -3.3608926294469414,
        4: -0.868219346841726,
        5: 27.59209969944671,
        6: 20.154067550477894,
        7: -43.48988418106996,
    },
    {
        0: 0.47766253643826434,
        3: -2.4881146199716677,
        4: -0.590290826836843,
        5: 21.230051448181193,
        6: 15.279233632882423,
        7: -33.28821096898486,
        8: -0.020331201708508627,
    },
    {
        0: -0.9371424300859873,
        3: 5.186372428844064,
        4: 1.0914373489967295,
        5: -8.149787010746927,
        6: -18.52006565999696,
        7: 22.739487099350505,
        8: 2.4936055526796523,
        9: -3.0467644718982196,
    },
    {
        0: 2.273310147516538,
        3: -10.53449546673725,
        4: -2.0008720582248625,
        5: -17.9589318631188,
        6: 27.94888452941996,
        7: -2.8589982771350235,
        8: -8.87285693353063,
        9: 12.360567175794303,
        10: 0.6433927460157636,
    },
]
_DOP853_B = {
    0: 0.054293734116568765,
    5: 4.450312892752409,
    6: 1.8915178993145003,
    7: -5.801203960010585,
    8: 0.3111643669578199,
    9: -0.1521609496625161,
    10: 0.20136540080403034,
    11: 0.04471061572777259,
}
DOP853 = _tableau(8, _DOP853_A, _DOP853_B, 5.96)

TABLEAUS = {tableau.order: tableau for tableau in (RK4, DOP853)}
