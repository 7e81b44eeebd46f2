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
Whether the tables of docs/data are what today's code makes: a sample of rows, made anew.

    python -m validation.stability_check               # some 150 rows: minutes
    python -m validation.stability_check --every 1 map # all rows of one table

Every value is compared as the table has it, with six digits.  Exit status 1 if one differs.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import csv
import sys
from typing import Any

from flexarm_ros.analysis.sweep.worker import run_task
from flexarm_ros.scenario.sweeps.sweep import load as load_sweep
from validation import fls_study, stability_map
from validation.stability_map import DATA, KEPT, ROOT, Row, spread, SWEEPS, text

Task = tuple[str, int, dict[str, str]]
"""Name of a table, number of a row in it, and the row."""


def read(name: str) -> list[dict[str, str]]:
    """Return a table of docs/data."""
    with (DATA / f'stability_{name}.csv').open(newline='', encoding='utf-8') as file:
        return list(csv.DictReader(file))


def metric(found: dict[str, Any], name: str) -> Any:
    """Return a column of a sweep's table from a run's metrics: ``overshoot[0]`` and so on."""
    key, _, place = name.partition('[')
    value = found.get(key)
    if not place or value is None:
        return value
    index = int(place.removesuffix(']'))
    return value[index] if index < len(value) else None


def fly_swept(name: str, number: int) -> Row:
    """Run one row of a sweep again."""
    sweep = load_sweep(ROOT / 'config' / f'stability_{name}.yaml')
    case = sweep.case(number)
    found = run_task(sweep.bases, (number, case.base, case.overrides))
    numbers = {key: metric(found, key) for key in KEPT[2:]}
    if found['outcome'] != 'stable':
        numbers = dict.fromkeys(numbers)
    return {**case.values, **{key: found.get(key) for key in KEPT[:2]}, **numbers}


def compute(name: str) -> Callable[[dict[str, str]], Row]:
    """Return what computes a row of another table from its first columns."""
    work: dict[str, Callable[[dict[str, str]], Row]] = {
        'boundary': lambda r: stability_map.location_row((r['law'], float(r['location_m']))),
        'hub_boundary': lambda r: stability_map.hub_row((r['law'], float(r['hub_inertia']))),
        'speed': lambda r: stability_map.speed_row(
            (r['law'], float(r['location_m']), float(r['side_time_s']))
        ),
        'model': lambda r: stability_map.model_row(
            (r['law'], r['model'], int(r['modes']), float(r['damping_ratio']))
        ),
        'growth': lambda r: stability_map.growth_row(
            (r['law'], r['velocity_source'], float(r['location_m']))
        ),
        'fls': lambda r: fls_study.row((r['case'], r['kind'], float(r['ks']), float(r['kn']))),
    }
    return work[name]


TABLES = dict.fromkeys(SWEEPS, 40) | {
    'boundary': 12, 'hub_boundary': 12, 'speed': 9, 'model': 12, 'growth': 12, 'fls': 20,
}  # fmt: skip
"""Tables that can be checked, and of how many rows one is made anew.

stability_gain.csv and stability_fls_flight.csv are cheap: make them anew whole.
"""


def differences(task: Task) -> list[str]:
    """Make one row anew and return where it differs from the table."""
    name, number, row = task
    again = fly_swept(name, number) if name in SWEEPS else compute(name)(row)
    made = {key: text(value) for key, value in again.items()}
    return [
        f'stability_{name}.csv, row {number}: {key} {row.get(key)!r}, now {made.get(key)!r}'
        for key in dict.fromkeys((*row, *made))
        if row.get(key) != made.get(key)
    ]


def main() -> int:
    """Make a sample of rows anew and say where they differ."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('tables', nargs='*', metavar='TABLE', help=', '.join(TABLES))
    parser.add_argument('--every', type=int, metavar='N', help='every Nth row of each table')
    args = parser.parse_args()
    if not set(args.tables) <= set(TABLES) or (args.every is not None and args.every < 1):
        parser.error(f'tables are {", ".join(TABLES)}; N is 1 or more')
    tasks = []
    for name in args.tables or TABLES:
        step = args.every or TABLES[name]
        # From the middle of a step on, so that not every sampled row is one without latency.
        tasks += [(name, i, row) for i, row in enumerate(read(name)) if i % step == step // 2]
    found = spread(differences, tasks)
    for line in (line for lines in found for line in lines):
        print(line)
    differing = sum(map(bool, found))
    print(f'{len(tasks)} rows made anew, {differing} differ')
    return 1 if differing else 0


if __name__ == '__main__':
    sys.exit(main())
