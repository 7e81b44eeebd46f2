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
Golden files: runs as they were when the physics had been checked.

    .venv/bin/python -m validation.golden          # compare test/golden with runs of today
    .venv/bin/python -m validation.golden --write  # freeze anew

To be frozen only when a change of the numbers is meant, and after `make validate`: with goals that
are not met it refuses.  The files hold a row every so many ticks of trajectory.csv, with the
shortest text that reads back exactly.  They tell what has changed, not what is right.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
import io
import json
import math
from pathlib import Path
import sys

from flexarm_ros import scenario
from flexarm_ros.core.loop import ClosedLoop
from flexarm_ros.core.rows import COLUMNS, Rows

ROOT = Path(__file__).resolve().parent.parent
DIRECTORY = ROOT / 'test' / 'golden'
GOALS = ROOT / 'docs' / 'data' / 'validation_goals.json'

CASES: dict[str, tuple[float, int, tuple[str, ...]]] = {
    'pd_collocated': (16.0, 500, ()),
    'fls_tip': (16.0, 500, ()),
    'fls_mid_corrected': (16.0, 500, ()),
    'pd_tip_physical_encoder_rates': (16.0, 500, ()),
    'pd_full': (8.0, 250, ('plant.modes=4',)),
    'open_loop': (5.0, 100, ()),
    'de_luca_siciliano': (3.0, 100, ()),
}
"""Shipped scenario -> seconds flown, ticks from row to row, what is set anew."""

TOLERANCE = 1e-9
"""Largest difference, of 1 or of the number where that is larger.

Other processors and versions of the compiler round otherwise in the last
digit; the loops are stable and do not make much of it.
"""

Table = list[list[float]]


def fly(name: str) -> Table:
    """Return the rows of a golden run as they are today; nan where a value is not known."""
    seconds, every, settings = CASES[name]
    config = scenario.load(name, settings)
    config = replace(config, run=replace(config.run, duration=seconds))
    loop, rows, table = ClosedLoop(config), Rows(config), []
    while (record := loop.tick()) is not None:
        if record.k % every == 0:
            values = rows.row(
                record.k, record.q, record.qd, record.deflections[:2], record.tip[1:3],
                record.torque,
            )  # fmt: skip
            table.append([float(value) for value in values])
    if loop.unstable is not None:
        raise SystemExit(f'{name}: unstable, {loop.unstable}')
    return table


def text(table: Table) -> str:
    """Return a table as CSV."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(COLUMNS)
    writer.writerows(['' if math.isnan(v) else repr(v) for v in row] for row in table)
    return out.getvalue()


def read(name: str) -> Table:
    """Return a frozen table."""
    with (DIRECTORY / f'{name}.csv').open(newline='', encoding='utf-8') as file:
        head, *rows = csv.reader(file)
    assert tuple(head) == COLUMNS, head
    return [[float(cell) if cell else math.nan for cell in row] for row in rows]


def differences(name: str) -> list[str]:
    """Return what a run of today does otherwise, one text a value, worst first."""
    today, frozen = fly(name), read(name)
    if len(today) != len(frozen):
        return [f'{len(today)} rows, frozen {len(frozen)}']
    found = []
    for new, old in zip(today, frozen, strict=True):
        for column, a, b in zip(COLUMNS, new, old, strict=True):
            if math.isnan(a) and math.isnan(b):
                continue
            off = abs(a - b) / max(1.0, abs(b))
            if not off <= TOLERANCE:
                found.append((off, f'{column} at {old[0]:g} s: {a!r}, frozen {b!r}'))
    return [line for _, line in sorted(found, key=lambda pair: -pair[0])]


def refuse() -> str | None:
    """Return why nothing may be frozen now, or ``None``."""
    stored = json.loads(GOALS.read_text('utf-8'))
    missed = [
        goal['what']
        for group in stored.values()
        for goal in group
        if not (goal['met'] or goal['out_of_reach'])
    ]
    return f'not met: {missed[0]}' if missed else None


def main() -> int:
    """Compare, or freeze."""
    parser = argparse.ArgumentParser(
        prog='python -m validation.golden',
        description='compare the golden runs in test/golden with those of today',
    )
    parser.add_argument('--write', action='store_true', help='freeze the runs of today instead')
    if parser.parse_args().write:
        if (why := refuse()) is not None:
            print(f'python -m validation.golden: error: {why}', file=sys.stderr)
            return 1
        for name in CASES:
            (DIRECTORY / f'{name}.csv').write_text(text(fly(name)), 'utf-8')
        return 0
    changed = {name: lines for name in CASES if (lines := differences(name))}
    for name, lines in changed.items():
        print(f'{name}: {len(lines)} values differ; {lines[0]}')
    return 1 if changed else 0


if __name__ == '__main__':
    sys.exit(main())
