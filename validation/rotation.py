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
A link that turns at a steady rate: the stiffening by its own centrifugal tension.

Published: Wright, Smith, Thresher and Wang, "Vibration modes of centrifugally
stiffened beams" (J. Appl. Mech. 49, 1982): a uniform cantilever without hub
radius, vibration out of the plane of rotation.  In the plane, as here, the
squares of the frequencies are lower by the square of the speed.  Speeds and
frequencies in units of sqrt(EI / (rho L^4)).
"""

from __future__ import annotations

import math

from flexarm_ros.core.arm.full.dynamics import make_work, mass_and_bias
from flexarm_ros.core.arm.full.model import make_constants
import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh
from validation.motion import Array, full_plant
from validation.report import Section

LIMIT = 0.005

FLAPPING = {
    0.0: (3.5160, 22.0345, 61.6972),
    1.0: (3.6816, 22.1810, 61.8418),
    2.0: (4.1373, 22.6149, 62.2732),
    3.0: (4.7973, 23.3203, 62.9850),
    6.0: (7.3604, 26.8091, 66.6839),
    12.0: (13.1702, 37.6031, 79.6145),
}
"""Speed -> the first three published frequencies out of the plane."""


def published(speed: float) -> Array:
    """Return the first three frequencies in the plane."""
    return np.sqrt(np.array(FLAPPING[speed]) ** 2 - speed**2)


def ritz(speed: float, count: int = 20) -> Array:
    """
    Return the same from the textbook energies of a beam under tension, no code of ours.

    Tension rho W^2 (L^2 - x^2) / 2; ``count`` polynomials.
    """
    nodes, weights = legendre.leggauss(80)
    xi, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    shapes: list[list[Array]] = []
    for order in (0, 1, 2):
        rows = []
        for i in range(count):
            series = np.eye(count)[i, : i + 1]
            if order < 2:
                series = legendre.legint(series, 2 - order, lbnd=-1.0, scl=0.5)
            rows.append(legendre.legval(nodes, series))
        shapes.append(rows)
    phi, slope, bent = (np.array(rows) for rows in shapes)
    mass = np.einsum('q,iq,jq->ij', weights, phi, phi)
    stiffness = np.einsum('q,iq,jq->ij', weights, bent, bent) - speed**2 * mass
    stiffness += speed**2 * np.einsum('q,iq,jq->ij', 0.5 * weights * (1.0 - xi**2), slope, slope)
    return np.asarray(np.sqrt(eigh(stiffness, mass, eigvals_only=True)[:3]))


def lead_lag(speed: float, modes: int, foreshortening: bool = True) -> Array:
    """
    Return the first three frequencies of link 1 turning at ``speed``, from the plant's terms.

    Link 2 weighs nothing.  The stiffness is the derivative of the forces on
    the elastic coordinates at a steady rate of theta1; without the
    foreshortening only -W^2 times the mass would be left of it.
    """
    plant = full_plant(
        modes=modes, basis='craig_bampton', length=(4.5, 0.01), mass_density=(0.335, 1e-9)
    )
    constants, unit = make_constants(plant), math.sqrt(1676.0 / 0.335) / 4.5**2
    half, size, rate = 2 + modes, 2 + 2 * modes, speed * unit
    link = constants[0].links[0]
    mass, stiffness = link.modal, np.diag(link.stiffness)
    if foreshortening:
        rates, work = np.zeros(size), make_work(modes)
        rates[0] = rate
        for i in range(modes):
            sides = []
            for small in (1e-4, -1e-4):
                q = np.zeros(size)
                q[2 + i] = small
                mass_and_bias(constants, q, rates, work)
                sides.append(work[0].force[2:half].copy())
            stiffness[:, i] += (sides[0] - sides[1]) / 2e-4
    else:
        stiffness = stiffness - rate**2 * mass
    squares = eigh(stiffness, mass, eigvals_only=True)[:3]
    return np.asarray(np.sign(squares) * np.sqrt(np.abs(squares)) / unit)


def run() -> Section:
    """Compute the table."""
    section = Section('A link that rotates')
    rows, worst = [], 0.0
    for speed in FLAPPING:
        found, wrong = lead_lag(speed, 6), lead_lag(speed, 6, foreshortening=False)
        worst = max(worst, float(np.max(np.abs(found / published(speed) - 1.0))))
        first = f'{wrong[0]:.3f}' if wrong[0] > 0.0 else f'unstable, exp({-wrong[0]:.2f} t)'
        cells = (', '.join(f'{value:.3f}' for value in row) for row in (published(speed), found))
        rows.append([f'{speed:g}', *cells, first])
    section.table(['speed', 'published', '`full`, N = 6', 'first without foreshortening'], rows)
    section.goal(
        'Rotating cantilever, published frequencies up to 12 times the unit speed',
        f'{worst:.2%}', '0.5 %', worst < LIMIT,
    )  # fmt: skip
    return section
