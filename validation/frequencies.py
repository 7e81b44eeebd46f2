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

"""Natural frequencies against the exact ones, for each basis and number of functions."""

from __future__ import annotations

from functools import lru_cache
import math

from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig
from flexarm_ros.scenario import load
from flexarm_ros.stability.modes import JOINTS, natural_frequencies
import numpy as np
from numpy.polynomial import legendre
from scipy.linalg import eigh
from validation import dynamic_stiffness
from validation.dynamic_stiffness import Array, Chain
from validation.motion import full_plant
from validation.pictures import BLUE, GREEN, GREY, new_figure, ORANGE
from validation.report import Section

ANGLES = tuple(np.linspace(0.0, math.pi, 19))
LIMIT = 0.005
BASES = ('arm_modes', 'craig_bampton', 'clamped_free')

SINGLE = {
    'clamped-free': (12.28119, 76.96488, 215.50390, 422.30163),
    'pinned-free': (53.85468, 174.52364, 364.12965, 622.68325),
}
"""rad/s, one link of 4.5 m: the table of the reference solutions."""

DE_LUCA = {
    'link 1, link 2 rigid, elbow at pi/2': ((1.0, 1e6), (0.48, 1.80)),
    'link 2, link 1 rigid': ((1e6, 1.0), (2.18, 15.91)),
}
"""Rigidities (N m^2) and the published frequencies, Hz."""


def de_luca(rigidity: tuple[float, float], modes: int = 4) -> PlantParameters:
    """Return De Luca and Siciliano's arm of 1991 with these rigidities."""
    return full_plant(
        modes=modes, length=(0.5, 0.5), mass_density=(0.2, 0.2), flexural_rigidity=rigidity,
        hub_inertia=(0.1, 0.0), link_end_mass=1.0, link_end_inertia=0.1, payload_mass=0.1,
        payload_inertia=0.0005,
    )  # fmt: skip


@lru_cache
def exact(hub: float, theta2: float, joints: str) -> Array:
    """Return the first four exact frequencies of the arm of design.md, rad/s."""
    shoulder, elbow = JOINTS[joints]
    return dynamic_stiffness.frequencies(Chain(hub=(hub, hub)), theta2, shoulder, elbow)


def errors(basis: str, modes: int, hub: float, joints: str) -> Array:
    """Return the largest relative error over the elbow angles of each of the first four."""
    plant = full_plant(basis=basis, modes=modes, hub_inertia=(hub, hub))
    worst = np.zeros(min(4, 2 * modes))
    for angle in ANGLES:
        found = natural_frequencies(RunConfig(plant=plant), angle, joints)[: len(worst)]
        worst = np.maximum(worst, np.abs(found / exact(hub, angle, joints)[: len(worst)] - 1.0))
    return worst


def single_link(basis: str, modes: int) -> dict[str, Array]:
    """Return the relative errors for one link: a second one that is short, stiff and light."""
    plant = full_plant(
        basis=basis, modes=modes, length=(4.5, 0.01), mass_density=(0.335, 1e-7),
        flexural_rigidity=(1676.0, 1e6),
    )  # fmt: skip
    joints = {'clamped-free': 'locked', 'pinned-free': 'elbow-locked'}
    return {
        name: natural_frequencies(RunConfig(plant=plant), 0.3, joints[name])[:4] / values - 1.0
        for name, values in SINGLE.items()
    }


def least_misfit(count: int) -> float:
    """
    Return the least mean fraction of strain energy that ``count`` functions of one link miss.

    Of the eight modes of a link by itself, four clamped-free and four
    pinned-free: the part of their Gram matrix in the energy norm beyond its
    ``count`` largest eigenvalues, an eighth of its trace.  A frequency is
    about half of its mode's fraction too high, whatever the functions.
    """
    size, (nodes, weights) = 24, legendre.leggauss(100)
    xi, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    series = [
        legendre.legint(np.eye(size)[i, : i + 1], 2, lbnd=-1.0, scl=0.5) for i in range(size)
    ]
    shapes = np.array(
        [math.sqrt(2 * i + 1) * legendre.legval(nodes, s) for i, s in enumerate(series)]
    )
    mass = np.einsum('q,iq,jq->ij', weights, shapes, shapes)
    moment = np.einsum('q,q,iq->i', weights, xi, shapes)
    modes = []
    for matrix in (mass, mass - 3.0 * np.outer(moment, moment)):
        squares, vectors = eigh(np.eye(size), matrix)
        modes.append(vectors[:, :4] / np.sqrt(squares[:4]))
    rows = np.concatenate(modes, axis=1)
    return float(np.linalg.eigvalsh(rows.T @ rows)[::-1][count:].sum() / 8.0)


def _percent(values: Array) -> str:
    texts = (f'{100.0 * abs(value):.{3 if abs(value) < 0.1 else 0}f}' for value in values)
    return ', '.join(texts)


def run() -> Section:
    """Compute the tables and the picture."""
    section = Section('Natural frequencies')
    worst = {hub: _by_basis(section, hub) for hub in (0.0, 8.0)}
    for hub, found in worst.items():
        section.goal(
            f'First four frequencies, N = 4, every elbow angle and joint, hubs of {hub:g} kg m^2',
            f"{found['arm_modes'][3]:.2%}", '0.5 %', found['arm_modes'][3] < LIMIT,
        )  # fmt: skip
    _draw(section, worst[0.0])
    _one_link(section)
    _de_luca(section)
    return section


def _by_basis(section: Section, hub: float) -> dict[str, list[float]]:
    """Add a table; return for each basis the worst error by number of functions."""
    section.say(
        f'Largest error (%) of the first four frequencies over {len(ANGLES)} elbow angles from '
        f'0 to pi, hubs of {hub:g} kg m^2, against the dynamic stiffness matrix:'
    )
    rows, worst = [], {}
    for basis in BASES:
        worst[basis] = []
        for modes in range(1, 7):
            found = {joints: errors(basis, modes, hub, joints) for joints in JOINTS}
            rows.append([f'`{basis}`', modes, *(_percent(found[joints]) for joints in JOINTS)])
            worst[basis].append(max(float(value.max()) for value in found.values()))
    section.table(['basis', 'N', *JOINTS], rows)
    return worst


def _draw(section: Section, worst: dict[str, list[float]]) -> None:
    figure, axis = new_figure('Worst of the first four frequencies, no hubs')
    styles = ((BLUE, 'o-'), (GREEN, 's-.'), (ORANGE, '^--'))
    for (basis, values), (color, style) in zip(worst.items(), styles, strict=True):
        numbers = range(2, len(values) + 1)
        axis.semilogy(numbers, 100.0 * np.array(values[1:]), style, color=color, label=basis)
    axis.axhline(100.0 * LIMIT, color=GREY, linewidth=0.8, linestyle=':')
    axis.set_xticks(range(2, 7))
    axis.set_xlabel('functions a link, N')
    axis.set_ylabel('largest error, %')
    axis.legend()
    section.picture('frequencies', figure, 'Error of the frequencies against N for each basis')


def _one_link(section: Section) -> None:
    section.say('A single link, errors (%) of the first four frequencies:')
    rows = []
    for basis in BASES:
        for modes in (4, 5, 6):
            found = single_link(basis, modes)
            rows.append([f'`{basis}`', modes, *(_percent(found[name]) for name in SINGLE)])
            if basis == 'arm_modes' and modes < 6:
                worst = max(float(np.abs(values).max()) for values in found.values())
                section.goal(
                    f'One link, N = {modes}: first four of both the clamped-free and the '
                    'pinned-free beam', f'{worst:.2%}', '0.5 %', worst < LIMIT,
                    out_of_reach=0.5 * least_misfit(modes) > LIMIT,
                )  # fmt: skip
    section.table(['basis', 'N', *SINGLE], rows)
    section.say(
        'Four functions of a single link cannot represent all eight of these modes: any four miss '
        f'at least {least_misfit(4):.1%} of their strain energy on average, so that the '
        f'frequencies are on average {0.5 * least_misfit(4):.1%} too high; with five functions '
        f'it is {least_misfit(5):.1e}. (In the arm of two links each mode has eight functions.)'
    )


def _de_luca(section: Section) -> None:
    section.say('De Luca and Siciliano (1991), Hz, N = 4:')
    rows, worst = [], 0.0
    for name, (rigidity, published) in DE_LUCA.items():
        config = RunConfig(plant=de_luca(rigidity))
        found = natural_frequencies(config, 0.5 * math.pi, 'locked')[:2] / (2.0 * math.pi)
        rows.append([name, *published, *(f'{value:.4f}' for value in found)])
        worst = max(worst, float(np.max(np.abs(found - published))))
    section.table(['', 'published f1', 'f2', 'computed f1', 'f2'], rows)
    section.goal(
        "De Luca and Siciliano's four frequencies, Hz, as printed with two digits",
        f'{worst:.4f}', '0.01', worst < 0.01,
    )  # fmt: skip
    plant = load('de_luca_siciliano').plant
    chain = Chain(
        plant.length, plant.mass_density, plant.flexural_rigidity, plant.hub_inertia,
        (plant.link_end_mass, plant.payload_mass), (plant.link_end_inertia, plant.payload_inertia),
    )  # fmt: skip
    section.say(
        'The shipped scenario `de_luca_siciliano`, both links flexible, theta2 = pi/2, rad/s:'
    )
    rows, off = [], 0.0
    for joints, locked in JOINTS.items():
        theory = dynamic_stiffness.frequencies(chain, 0.5 * math.pi, *locked)
        found = natural_frequencies(RunConfig(plant=plant), 0.5 * math.pi, joints)[:4]
        off = max(off, float(np.max(np.abs(found / theory - 1.0))))
        cells = (', '.join(f'{value:.4f}' for value in values) for values in (theory, found))
        rows.append([joints, *cells])
    section.table(['joints', 'exact', f'computed, N = {plant.modes}'], rows)
    section.goal(
        'The same arm, both links flexible, against its dynamic stiffness', f'{off:.3%}', '0.5 %',
        off < LIMIT,
    )  # fmt: skip
