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

"""The tables of docs/paper.md, and docs/data/paper_claims.csv from which they can be made."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from validation.paper_variants import judge, Row, variants
from validation.tables import DATA, DOCS, put

TABLE = DATA / 'paper_claims.csv'
PAGE = DOCS / 'paper.md'


def verdict_cell(row: Row, letter: str) -> str:
    """Return a claim's verdict in a table."""
    verdict, held, of = row.verdicts[letter]
    if verdict == 'not known':
        return '-'
    return {'holds': 'yes', 'does not hold': '**no**'}.get(verdict, f'{held} of {of}')


def overshoots(row: Row, case: str) -> str:
    """Return a run's overshoots, or when it diverged."""
    run = row.runs[case]
    if not run['stable']:
        period = scenario.load(case, row.variant.overrides(case)).run.control_period
        return f'diverges at {period * int(run["unstable_tick"]):.4g} s'
    name = 'tip_overshoot' if row.variant.true_tip else 'overshoot'
    return ' '.join(f'{value:.3f}' for value in run[name])


LETTERS = 'abcdefgh'


def claims_table(rows: list[Row]) -> list[str]:
    """Return the first table of docs/paper.md: variants by claims."""
    lines = [
        '| row | dropped | instead | ' + ' | '.join(f'({x})' for x in LETTERS) + ' | stable |',
        '|---|---|---|' + '---|' * (len(LETTERS) + 1),
    ]
    for row in rows:
        stable = sum(bool(run['stable']) for run in row.runs.values())
        cells = [verdict_cell(row, letter) for letter in LETTERS]
        lines.append(
            f'| `{row.variant.name}` | {row.variant.assumption} | {row.variant.change} | '
            + ' | '.join(cells)
            + f' | {stable} of {len(row.runs)} |'
        )  # fmt: skip
    return lines


def numbers_table(rows: list[Row]) -> list[str]:
    """Return the second table: overshoots and rms errors."""
    cases = ('pd_collocated', 'pd_tip', 'pd_tip_corrected', 'fls_collocated', 'fls_tip',
             'fls_tip_corrected')  # fmt: skip
    lines = [
        '| row | ' + ' | '.join(f'`{case}`' for case in cases) + ' | rms, PD and FLS, tip |',
        '|---|' + '---|' * (len(cases) + 1),
    ]
    for row in rows:
        tip = row.variant.true_tip
        rms = [row.runs[case]['tip_rms_error' if tip else 'rms_error'] for case in
               ('pd_tip', 'fls_tip')]  # fmt: skip
        stable = [row.runs[case]['stable'] for case in ('pd_tip', 'fls_tip')]
        shown = ' '.join(
            f'{value:.3f}' if fine else '-' for value, fine in zip(rms, stable, strict=True)
        )
        lines.append(
            f'| `{row.variant.name}` | '
            + ' | '.join(overshoots(row, case) for case in cases)
            + f' | {shown} |'
        )
    return lines


def commands_table(rows: list[Row]) -> list[str]:
    """Return the third table: the command of one of the ten cases."""
    return [
        '| row | `fls_tip` of it |',
        '|---|---|',
        *(f'| `{row.variant.name}` | `{row.variant.command()}` |' for row in rows),
    ]


COLUMNS = ('rms_error', 'max_error', 'tip_rms_error', 'tip_max_error', 'max_deflection',
           'max_torque')  # fmt: skip


def write_csv(rows: list[Row], path: Path) -> None:
    """Write every run's numbers, one a line, six digits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        switches = [f'{name}[{i}]' for name in ('overshoot', 'tip_overshoot') for i in range(3)]
        writer.writerow(
            ['variant', 'case', 'stable', 'unstable_tick', *COLUMNS, *switches, 'command']
        )
        for row in rows:
            for case, run in row.runs.items():
                values = [run[name] for name in COLUMNS]
                for name in ('overshoot', 'tip_overshoot'):
                    values += [*run[name], None, None, None][:3]
                unstable = run['unstable_tick']
                writer.writerow(
                    [row.variant.name, case, str(run['stable']).lower(),
                     '' if unstable is None else unstable,
                     *('' if v is None else f'{v:.6g}' for v in values),
                     row.variant.command(case)]
                )  # fmt: skip


def read_csv(path: Path) -> list[Row]:
    """Return the rows of a table that :func:`write_csv` made."""
    runs: dict[str, dict[str, dict[str, Any]]] = {}
    with path.open(newline='', encoding='utf-8') as file:
        for line in csv.DictReader(file):
            run: dict[str, Any] = {'stable': line['stable'] == 'true'}
            run['unstable_tick'] = line['unstable_tick'] or None
            for name in COLUMNS:
                run[name] = float(line[name]) if line[name] else None
            for name in ('overshoot', 'tip_overshoot'):
                values = [line[f'{name}[{i}]'] for i in range(3)]
                run[name] = [float(value) for value in values if value]
            runs.setdefault(line['variant'], {})[line['case']] = run
    known = {variant.name: variant for variant in variants()}
    if set(runs) != set(known):
        raise SystemExit(f'{path}: its rows are not those of this program; simulate them anew')
    return [judge(variant, runs[name]) for name, variant in known.items()]


def write_page(rows: list[Row], page: Path = PAGE) -> None:
    """Put the tables into docs/paper.md."""
    put(page, {
        'claims': claims_table(rows), 'numbers': numbers_table(rows),
        'commands': commands_table(rows),
    })  # fmt: skip
