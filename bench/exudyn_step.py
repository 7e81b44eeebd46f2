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

"""The full model's step beside Exudyn's, each as accurate as the other."""

from __future__ import annotations

from dataclasses import replace
import time

from bench.table import markdown, Ratio
import exudyn  # noqa: F401 - whoever imports this learns here that it is not installed
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.make_plant import make_plant
from validation import exudyn_arm
from validation.cases import CASES
from validation.motion import compare, fly, full_plant

CASE = replace(CASES['shoulder_pulse'], duration=1.0)
MESHES = (exudyn_arm.Mesh(4, 1e-3, (1e6,)), exudyn_arm.Mesh(8, 1e-3, (1e6,)), exudyn_arm.COARSE)
MODES = (1, 2, 4)


def measure() -> tuple[Ratio, str]:
    """Solve a second of one motion with both and with several fidelities of each."""
    reference = exudyn_arm.solve(CASE, exudyn_arm.FINE)
    ours, theirs = [], []
    for modes in MODES:
        plant = full_plant(modes=modes)
        fly(plant, replace(CASE, duration=0.01), every=20)
        start = time.process_time()
        motion = fly(plant, CASE, every=20)
        wall = time.process_time() - start
        tip = compare(motion[: len(reference)], reference).tip
        ours.append((f'`full`, {modes} modes a link, {_substeps(modes)} steps a tick', tip, wall))
    for mesh in MESHES:
        start = time.process_time()
        motion = exudyn_arm.solve(CASE, mesh)
        wall = time.process_time() - start
        tip = compare(motion, reference).tip
        name = f'Exudyn, {mesh.elements} ANCF cables a link, step {mesh.step:g} s, '
        name += 'EA extrapolated' if len(mesh.axial) > 1 else f'EA {mesh.axial[0]:.0e} N'
        theirs.append((name, tip, wall))
    best = min(theirs, key=lambda row: row[2])
    # The cheapest of ours that is at least as close to the reference, else the closest.
    match = [row for row in ours if row[1] <= best[1]] or [min(ours, key=lambda row: row[1])]
    fits = min(match, key=lambda row: row[2])
    ratio = Ratio(
        'Exudyn / our full model, one second of motion',
        f'{fits[2] * 1e3:.1f} ms', f'{best[2] * 1e3:.0f} ms', best[2] / fits[2], None, True,
        f"tip within {fits[1] * 1e3:.1f} and {best[1] * 1e3:.1f} mm of a fine mesh's; processor "
        'time, one run',
    )  # fmt: skip
    rows = [(n, f'{1e3 * tip:.2f}', f'{1e3 * wall:.1f}') for n, tip, wall in [*ours, *theirs]]
    head = ('one second of `shoulder_pulse`, by', 'tip error, mm', 'processor time, ms')
    return ratio, markdown(head, rows)


def _substeps(modes: int) -> int:
    return make_plant(RunConfig(plant=full_plant(modes=modes))).substeps
