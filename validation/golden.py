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
are not met it refuses.  The CSV files hold a row every so many ticks of trajectory.csv, with the
shortest text that reads back exactly; digests.json holds the digests (`flexarm digest`) of whole
runs, which are the same on every machine.  They tell what has changed, not what is right.
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
import tempfile
from typing import NamedTuple

from flexarm_ros import scenario
from flexarm_ros.bag.checks.digest import digest_of
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.control import PLANNING
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.run.results.trajectory_rows import Rows
from flexarm_ros.scenario import locate
from flexarm_ros.scenario.suites import suite

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
"""Shipped scenario -> seconds simulated, ticks from row to row, what is set anew."""

TOLERANCE = 1e-9
"""Largest difference, of 1 or of the number where that is larger.

What this lets pass, the digests do not: it is there to tell a change in the
last digit, which may be meant, from one that matters.
"""


class Digested(NamedTuple):
    """A run whose digest is frozen: ``settings`` as after ``--set``."""

    scenario: str
    seconds: float
    settings: tuple[str, ...] = ()
    changes: tuple[Change, ...] = ()


_NOISE = ('encoder.noise_std=1e-4', 'tip_sensor.noise_std=1e-3', 'seed=7')
_LIVE = (Change(200, 'controller', 'kp', 120.0), Change(400, 'tip_sensor', 'latency', 0.0021))

QUICK = {
    'pd_collocated': Digested('pd_collocated', 2.0),
    'fls_tip': Digested('fls_tip', 2.0),
    'fls_mid_physical': Digested('fls_mid_physical', 1.0),
    'eq14_three_modes': Digested('pd_tip_elastic', 0.5, ('plant.modes=3',)),
    'full_one_mode': Digested('fls_full', 0.5, ('plant.modes=1',)),
    'full_three_modes': Digested('pd_full', 0.5),
    'cantilever_modes': Digested(
        'pd_full', 0.2, ('plant.basis=clamped_free', 'plant.damping_ratio=0.01')
    ),
    'craig_bampton': Digested('pd_full', 0.2, ('plant.basis=craig_bampton',)),
    'noise': Digested('fls_tip', 1.0, _NOISE),
    'pade2': Digested('pd_tip', 1.0, ('tip_sensor.latency_model=pade2',)),
    'live_change': Digested('fls_tip', 0.6, (), _LIVE),
    'open_loop': Digested('open_loop', 0.5),
    'full_six_modes': Digested('pd_full', 0.5, ('plant.modes=6',)),
    **{law: Digested(f'{law}_smooth', 2.0) for law in PLANNING},
}
"""Name -> what `make test` simulates: some seconds in all."""


def _slow() -> dict[str, Digested]:
    paper = suite.load('paper')
    found = {f'paper_{case.name}': Digested(case.name, 16.0) for case in paper.cases}
    for name in locate.shipped():
        if '_physical' in name:
            found[f'{name}_16_s'] = Digested(name, 16.0)
    for law in PLANNING:
        found[f'{law}_constant'] = Digested(f'{law}_constant', 4.0)
    return found | {
        'full_eight_seconds': Digested('pd_full', 8.0),
        'open_loop_five_seconds': Digested('open_loop', 5.0),
        'de_luca_siciliano': Digested('de_luca_siciliano', 3.0),
    }


SLOW = _slow()
"""Name -> what only `make validate` simulates, a minute in all."""

DIGESTS = DIRECTORY / 'digests.json'


def digest(case: Digested) -> str:
    """Return the digest of a case simulated today."""
    config = scenario.load(case.scenario, case.settings)
    config = replace(config, run=replace(config.run, duration=case.seconds), changes=case.changes)
    with tempfile.TemporaryDirectory() as directory:
        bag = Path(directory) / 'bag'
        with BagWriter(bag, replace(config, changes=()), Provenance()) as writer:
            for change in case.changes:
                writer.write_change(change)
            for block in loop_blocks(ClosedLoop(config)):
                writer.write_block(block)
        return digest_of(bag)


def frozen_digests() -> dict[str, str]:
    """Return the frozen digest of each case."""
    found: dict[str, str] = json.loads(DIGESTS.read_text('utf-8'))
    return found


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
        found = {name: digest(case) for name, case in (QUICK | SLOW).items()}
        DIGESTS.write_text(json.dumps(found, indent=1) + '\n', 'utf-8')
        return 0
    changed = [
        f'{name}: {len(lines)} values differ; {lines[0]}'
        for name in CASES
        if (lines := differences(name))
    ]
    frozen = frozen_digests()
    changed += [
        f'{name}: other bytes than those frozen'
        for name, case in (QUICK | SLOW).items()
        if digest(case) != frozen.get(name)
    ]
    print(*changed, sep='\n', end='\n' if changed else '')
    return 1 if changed else 0


if __name__ == '__main__':
    sys.exit(main())
