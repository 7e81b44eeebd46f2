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

"""Joint friction and rigid parts of the links against Exudyn: one motion of an arm on a bench."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.parameters.rig import StrainGaugeParameters
from flexarm_ros.core.parameters.sections import PlantParameters
from flexarm_ros.core.sensing.gauge import gauge_shape
import numpy as np
from validation import exudyn_rig
from validation.exudyn_rig import COARSE, Mesh, Pair
from validation.motion import Array, full_plant, start
from validation.report import Section

SECONDS = 2.0
LIMIT = 1e-3
"""Largest difference of an angle or a curvature, of its range.

The links bend by 2.6 %, at which the curvature to first order, as of the model, costs 0.07 % of
the deflection; the rest is the error of Exudyn's integrator.
"""

QUICK = Mesh(step=2e-4)
MESHES = (QUICK, COARSE, Mesh(step=5e-5), Mesh(2 * COARSE.elements))
"""The convergence of Exudyn: the step halved twice, then the mesh doubled."""

ARM = full_plant(
    modes=4, length=(0.5, 0.4), mass_density=(0.6, 0.3), flexural_rigidity=(4.0, 1.2),
    link_damping=(0.01, 0.01), hub_inertia=(0.3, 0.03), link_end_mass=1.2, payload_mass=0.2,
)  # fmt: skip
_RIGID = {'hub_radius': (0.08, 0.05), 'end_offset': (0.06, 0.04)}
_VISCOUS = {'viscous_friction': (0.3, 0.03)}
_COULOMB = {'coulomb_friction': (0.02, 0.004)}
CASES = {
    'rigid parts': _RIGID,
    'viscous friction': _VISCOUS,
    'Coulomb friction': _COULOMB,
    'all three': _RIGID | _VISCOUS | _COULOMB,
}
"""Name -> keys of the plant beside `ARM`."""


def law(time: float, _angles: Pair, _rates: Pair) -> Pair:
    """
    Return the torques, N m, of a tick that begins at ``time``, s: each joint reverses at times.

    Not from zero: Newton's tolerance is relative to the first residual.
    """
    middle = time + 0.5 * exudyn_rig.PERIOD
    return (
        0.2 * math.sin(2.0 * math.pi * middle + 0.5),
        0.03 * math.sin(3.0 * math.pi * middle + 0.5),
    )


def fly(plant: PlantParameters, mesh: Mesh) -> Array:
    """Return theta1, theta2 (rad) and the curvatures at the gauges (1/m) of each tick, (n, 4)."""
    arm = start(plant, (0.0, 0.0), period=exudyn_rig.PERIOD)
    gauge = StrainGaugeParameters(location=exudyn_rig.gauge_places(plant, mesh))
    shapes = [gauge_shape(plant, gauge, link, 'strain') for link in (0, 1)]
    rows = []
    for tick in range(round(SECONDS / exudyn_rig.PERIOD)):
        bends = arm.q[2:].reshape(2, plant.modes)
        curvatures = (shape @ bend for shape, bend in zip(shapes, bends, strict=True))
        rows.append((*arm.q[:2], *curvatures))
        arm.step(*law(tick * exudyn_rig.PERIOD, (0.0, 0.0), (0.0, 0.0)))
    return np.array(rows)


def solve(plant: PlantParameters, mesh: Mesh) -> Array:
    """Return the motion of `fly` as Exudyn computes it."""
    motion = exudyn_rig.fly(plant, SECONDS, law, mesh)
    return np.hstack([motion['theta'], motion['curvature']])


def differences(plant: PlantParameters, reference: Array, mesh: Mesh) -> Array:
    """Return the largest differences of our motion, of the ranges of the reference, (4,)."""
    error = np.abs(fly(plant, mesh) - reference)
    return np.asarray(error.max(axis=0) / np.ptp(reference, axis=0))


def run() -> Section:
    """Compute the table: each case on each mesh, and what our model lacks without its keys."""
    section = Section('Joint friction and rigid parts: Exudyn')
    rows, worst = [], 0.0
    for name, keys in CASES.items():
        plant = replace(ARM, **keys)
        for mesh in MESHES:
            reference = solve(plant, mesh)
            found = differences(plant, reference, mesh)
            without = differences(ARM, reference, mesh)
            shares = [f'{100.0 * value:.3f}' for value in found]
            step = f'{1e3 * mesh.step:g}'
            rows.append([name, mesh.elements, step, *shares, f'{100.0 * without[:2].min():.0f}'])
            worst = max(worst, *found)
    section.table(
        ['joints and links', 'elements', 'step, ms', 'theta1, %', 'theta2, %', 'curvature 1, %',
         'curvature 2, %', 'angles without, %'], rows,
    )  # fmt: skip
    section.goal(
        f'Exudyn, {len(CASES)} cases of friction and rigid parts, N = 4: angles and curvatures, '
        'of their range', f'{worst:.3%}', f'{LIMIT:.1%}', worst < LIMIT,
    )  # fmt: skip
    return section
