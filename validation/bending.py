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

"""How far a link may bend: a cantilever under a dead load against the elastica."""

from __future__ import annotations

from flexarm_ros.core.arm.full.model import make_constants
import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from validation.motion import full_plant
from validation.report import Section

LENGTH, RIGIDITY = 4.5, 1676.0
LIMIT = 0.01


def elastica(load: float) -> tuple[float, float]:
    """
    Return end deflection and shortening, both of the length, of the inextensible rod.

    ``load``: P L^2 / EI of a dead load across the rod's first direction.  The
    slope angle t(s) has t'' = -load cos t, t(0) = 0, t'(1) = 0: shooting from
    the clamp.
    """

    def shoot(curvature: float) -> np.ndarray:
        def rates(_: float, y: np.ndarray) -> list[float]:
            return [y[1], -load * np.cos(y[0]), np.sin(y[0]), 1.0 - np.cos(y[0])]

        start = [0.0, curvature, 0.0, 0.0]
        return np.asarray(solve_ivp(rates, (0.0, 1.0), start, rtol=1e-11, atol=1e-13).y[:, -1])

    curvature = brentq(lambda k: shoot(k)[1], 0.0, 1.01 * load, xtol=1e-13)
    end = shoot(curvature)
    return float(end[2]), float(end[3])


def ours(load: float) -> tuple[float, float]:
    """Return the same of link 1 of the full model, in equilibrium."""
    link = make_constants(full_plant(modes=2, basis='craig_bampton'))[0].links[0]
    force = load * RIGIDITY / LENGTH**2
    a = force * link.end / link.stiffness
    return float(link.end @ a) / LENGTH, 0.5 * float(a @ link.end_short @ a) / LENGTH


def run() -> Section:
    """Compute the table."""
    section = Section('How far a link may bend')
    rows, errors = [], {}
    for share in (0.02, 0.05, 0.1, 0.2, 0.3):
        load = brentq(lambda x, share=share: elastica(x)[0] - share, share, 10.0 * share)
        exact, found = elastica(load), ours(load)
        errors[share] = found[0] / exact[0] - 1.0
        rows.append(
            [f'{100.0 * share:g}', f'{100.0 * errors[share]:.3f}', f'{100.0 * exact[1]:.3f}',
             f'{100.0 * found[1]:.3f}']
        )  # fmt: skip
    section.table(
        ['exact deflection, % of length', 'error of the deflection, %',
         'exact shortening, % of length', 'computed'], rows,
    )  # fmt: skip
    section.goal(
        'Static deflection of 5 % of the length against the elastica', f'{errors[0.05]:.2%}',
        '1 %', abs(errors[0.05]) < LIMIT,
    )  # fmt: skip
    return section
