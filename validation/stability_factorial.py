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
Where all factors of the stability map are crossed: the linear analysis of every combination.

The flights are those of ``config/stability_factorial.yaml`` and ``_corrected.yaml``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.scenario.sweeps.sweep import load as load_sweep
from flexarm_ros.stability.margins import is_stable, poses_along
from flexarm_ros.stability.sampled_loop import SampledLoop
from validation.tables import DOCS, grouped, law, Lines, read, table

NAME = 'factorial'
CONFIG = DOCS.parent / 'config'
FACTORS = ('scenario', 'tip_sensor.measurand', 'controller.velocity_source',
           'plant.hub_inertia', 'tip_sensor.location', 'tip_sensor.latency')  # fmt: skip
POSES = 3


def row(number: int) -> dict[str, Any]:
    """Return at how many poses the combination of a run of the sweep is stable at rest."""
    sweep = load_sweep(CONFIG / f'stability_{NAME}.yaml')
    case = sweep.case(number)
    config = scenario.load(sweep.scenarios[case.base], case.overrides)
    steady = [is_stable(SampledLoop(config, p.theta2)) for p in poses_along(config, POSES)]
    return {**{key: case.values[key] for key in FACTORS}, 'poses': POSES, 'stable': sum(steady)}


def tasks() -> range:
    """Return the numbers of the runs of one sweep."""
    return range(load_sweep(CONFIG / f'stability_{NAME}.yaml').count)


def lines() -> Lines:
    """Write how flights ended by what the analysis says, without and with the correction."""
    said = {tuple(r[f] for f in FACTORS): r for r in read(f'{NAME}_linear')}
    flights = [
        {**r, 'corrected': word, 'said': _verdict(said[tuple(r[f] for f in FACTORS)])}
        for word, name in (('no', NAME), ('yes', f'{NAME}_corrected'))
        for r in read(name)
    ]
    by = ('scenario', 'tip_sensor.measurand', 'controller.velocity_source', 'corrected')
    flights.sort(key=lambda r: tuple(r[name] for name in by[:3]), reverse=True)

    def cells() -> Iterator[tuple[str, ...]]:
        for (_, measurand, source, corrected), group in grouped(flights, *by):
            count = Counter((r['said'], r['outcome']) for r in group)
            yield (law(group[0]), measurand, source, corrected, *(
                f"{count[word, 'stable']} / {count[word, 'unstable']}"
                for word in ('all', 'some', 'none')
            ))  # fmt: skip

    return table(
        ('law', 'measurand', 'rates from', 'corrected', 'linear: stable at all poses', 'at some',
         'at none'),
        cells(),
    )  # fmt: skip


def _verdict(row: dict[str, str]) -> str:
    stable, poses = int(row['stable']), int(row['poses'])
    return 'all' if stable == poses else 'some' if stable else 'none'
