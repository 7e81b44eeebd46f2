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
The laws that hold the true tip beside the paper's two: the tables of docs/controllers.md.

    python validation/controllers.py                      # all; writes docs/data and the page
    python validation/controllers.py --only lqg adaptive  # these laws; the other rows stay
    python validation/controllers.py --tables             # the page from docs/data, no runs

Every run is the paper's square in 16 s with the true tip measured 31.2 ms late and the full
plant with three modes a link.  The plant is changed, what the law believes is not.  All take
some forty minutes of one idle core.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
import csv
from dataclasses import dataclass
import itertools
import math
import multiprocessing
from pathlib import Path
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.control import PLANNING
from flexarm_ros.core.parameters.sections import RunConfig
from validation.tables import put

ROOT = Path(__file__).resolve().parent.parent
TABLE = ROOT / 'docs' / 'data' / 'controllers.csv'
PAGE = ROOT / 'docs' / 'controllers.md'

PAPER = {
    'pd': ('controller.law=pd',),
    'fls': ('controller.law=fls',),
    'pd, encoders': ('controller.law=pd', 'controller.feedback=encoder'),
    'fls, encoders': ('controller.law=fls', 'controller.feedback=encoder'),
}
"""The paper's laws on the same plant, with the tip sensor and with the encoders."""

NAMES = (*PAPER, *PLANNING)
PACES = ('smooth', 'constant')
EI, DENSITY, LATENCY = 1676.0, 0.335, 0.0312
SQUARE_S, HOLD_S, SETTLED_S = 16.0, 60.0, 2.0
HOLD = (
    f'duration={SQUARE_S + HOLD_S}', 'trajectory.kind=waypoints',
    'trajectory.waypoint_times=[0.0, 4.0, 8.0, 12.0, 16.0]',
    'trajectory.waypoint_x=[-6.3, -6.3, 6.3, 6.3, -6.3]',
    'trajectory.waypoint_y=[-6.3, 6.3, 6.3, -6.3, -6.3]',
)  # fmt: skip
NOISE = 'tip_sensor.noise_std=0.002'
SUCCESS = {'smooth': 0.020, 'constant': 0.20}
"""A drawn run is a success that is stable with an rms error of the true tip up to this, m."""


def plant(ei: float = 1.0, density: float = 1.0, latency: float = 1.0) -> tuple[str, ...]:
    """Return the settings of a plant whose parameters are these parts of the nominal ones."""
    settings = []
    if ei != 1.0:
        settings.append(f'plant.flexural_rigidity=[{EI * ei!r}, {EI * ei!r}]')
    if density != 1.0:
        settings.append(f'plant.mass_density=[{DENSITY * density!r}, {DENSITY * density!r}]')
    if latency != 1.0:
        settings.append(f'tip_sensor.latency={round(LATENCY * latency, 9)!r}')
    return tuple(settings)


@dataclass(frozen=True)
class Run:
    """One run: the law's name, the pace, the case's name, and what is set."""

    law: str
    pace: str
    case: str
    settings: tuple[str, ...]

    @property
    def scenario(self) -> str:
        """Return the shipped scenario that it starts from."""
        return f'{"inverse" if self.law in PAPER else self.law}_{self.pace}'

    def config(self) -> RunConfig:
        """Return the whole scenario."""
        return scenario.load(self.scenario, (*PAPER.get(self.law, ()), *self.settings))


def runs_of(law: str, pace: str) -> list[Run]:
    """Return the runs of one row of the table."""
    cases: dict[str, tuple[str, ...]] = {'nominal': (), 'noise': (NOISE,), 'hold': HOLD}
    for sign in (0.9, 1.1):
        cases[f'EI {sign}'] = plant(ei=sign)
        cases[f'density {sign}'] = plant(density=sign)
        cases[f'latency {sign}'] = plant(latency=sign)
    if pace == 'smooth' and law in PLANNING:
        cases['noisy hold'] = (*HOLD, NOISE)
    if law == 'adaptive' and pace == 'smooth':
        for signs in itertools.product((0.9, 1.1), repeat=3):
            cases['all ' + ' '.join(map(str, signs))] = (*plant(*signs), 'duration=32.0')
    if law in ('lqg', 'adaptive') and pace == 'smooth':
        cases['5 modes'] = ('plant.modes=5',)
    return [Run(law, pace, case, settings) for case, settings in cases.items()]


def drawn(law: str, pace: str, count: int) -> list[Run]:
    """Return the first ``count`` runs of the shipped Monte Carlo for this law."""
    from flexarm_ros.scenario.sweeps import sweep

    plan = sweep.load('tip_monte_carlo' + ('_constant' if pace == 'constant' else ''))
    first = plan.scenarios.index(f'{law}_{pace}') * plan.samples
    return [
        Run(law, pace, f'draw {i}', (NOISE, *plan.case(first + i).overrides))
        for i in range(min(count, plan.samples))
    ]


def fly(run: Run) -> dict[str, Any]:
    """Return metrics of a run, the residual at rest and the rms error from the second lap on."""
    from flexarm_ros.core.run.loop import ClosedLoop
    from flexarm_ros.core.run.results.columns import COLUMNS
    from flexarm_ros.core.run.results.metrics import Metrics
    from flexarm_ros.core.run.results.trajectory_rows import Rows

    config = run.config()
    at = {name: place for place, name in enumerate(COLUMNS)}
    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    later, later_count, residual = 0.0, 0, 0.0
    while (record := loop.tick()) is not None:
        row = rows.row(
            record.k, record.q, record.qd, record.deflections[:2], record.tip[1:3], record.torque
        )
        metrics.add(row)
        error = math.hypot(
            row[at['tip_x']] - row[at['ref_x']], row[at['tip_y']] - row[at['ref_y']]
        )
        if row[0] >= SQUARE_S:
            later, later_count = later + error * error, later_count + 1
        if row[0] >= SQUARE_S + SETTLED_S:
            residual = max(residual, error)
    found = metrics.result()
    known = [value for value in found['tip_overshoot'] if value is not None]
    return {
        'law': run.law, 'pace': run.pace, 'case': run.case, 'stable': loop.unstable is None,
        'unstable_tick': loop.unstable_tick, 'rms': found['tip_rms_error'],
        'max': found['tip_max_error'], 'overshoot': max(known, default=None),
        'torque': found['max_torque'], 'residual': residual if later_count else None,
        'later_rms': math.sqrt(later / later_count) if later_count else None,
    }  # fmt: skip


COLUMNS = ('law', 'pace', 'case', 'stable', 'unstable_tick', 'rms', 'max', 'overshoot', 'torque',
           'residual', 'later_rms')  # fmt: skip
Key = tuple[str, str, str]
Found = dict[Key, dict[str, str]]


def read() -> Found:
    """Return the rows of docs/data/controllers.csv by law, pace and case."""
    if not TABLE.exists():
        return {}
    with TABLE.open(newline='', encoding='utf-8') as file:
        return {(row['law'], row['pace'], row['case']): row for row in csv.DictReader(file)}


def write(found: Found) -> None:
    """Write every run, one a line, in the order of the tables."""

    def order(key: Key) -> tuple[int, int, str, int, str]:
        head, _, number = key[2].partition('draw ')
        return (
            PACES.index(key[1]), NAMES.index(key[0]), head, int(number or -1), key[2]
        )  # fmt: skip

    TABLE.parent.mkdir(parents=True, exist_ok=True)
    with TABLE.open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator='\n')
        writer.writeheader()
        writer.writerows(found[key] for key in sorted(found, key=order))


def text_of(value: Any) -> str:
    """Return a cell of the CSV: six digits."""
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:.6g}' if isinstance(value, float) else str(value)


def compute(runs: list[Run], workers: int) -> Iterable[dict[str, str]]:
    """Simulate the runs; those of one law and pace in sequence, since they share their plan."""
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(workers, context) as pool:
        chunk = max(1, min(12, len(runs) // workers))
        for number, result in enumerate(pool.map(fly, runs, chunksize=chunk), start=1):
            print(f'\r{number} of {len(runs)} runs', end='', file=sys.stderr, flush=True)
            yield {name: text_of(value) for name, value in result.items()}
    print(file=sys.stderr)


def millimetres(text: str) -> str:
    """Return metres of the CSV as millimetres, three digits or whole ones."""
    value = 1e3 * float(text)
    return f'{value:.0f}' if value >= 100.0 else f'{value:.3g}'


def largest(rows: list[dict[str, str]], column: str = 'rms') -> str:
    """Return the largest value of some runs, mm, or that one of them diverges."""
    if not rows:
        return ''
    if any(row['stable'] != 'true' for row in rows):
        return 'diverges'
    return millimetres(max((row[column] for row in rows), key=float))


def table(found: Found, pace: str) -> list[str]:
    """Return the table of one pace."""
    lines = [
        '| law | rms | max | overshoot | residual | with noise | peak torque | EI | mass | delay '
        '| noise | Monte Carlo |',
        '|---|' + '---|' * 11,
    ]
    for law in NAMES:
        rows = {case: row for (name, speed, case), row in found.items()
                if name == law and speed == pace}  # fmt: skip
        if 'nominal' not in rows:
            continue
        nominal = rows['nominal']
        cells = [f'diverges, tick {nominal["unstable_tick"]}'] + [''] * 10
        if nominal['stable'] == 'true':
            draws = [row for case, row in rows.items() if case.startswith('draw ')]
            good = sum(
                row['stable'] == 'true' and float(row['rms']) <= SUCCESS[pace] for row in draws
            )
            off = [
                largest([rows[c] for c in (f'{name} 0.9', f'{name} 1.1') if c in rows])
                for name in ('EI', 'density', 'latency')
            ]
            noise = [rows['noise']] if 'noise' in rows else []
            quiet, noisy = ([rows[c]] if c in rows else [] for c in ('hold', 'noisy hold'))
            cells = [
                *(millimetres(nominal[name]) for name in ('rms', 'max', 'overshoot')),
                largest(quiet, 'residual'), largest(noisy, 'residual'),
                f"{float(nominal['torque']):.1f}", *off, largest(noise),
                f'{good} of {len(draws)}' if draws else '',
            ]  # fmt: skip
        lines.append(f'| {law} | ' + ' | '.join(cells) + ' |')
    return lines


@dataclass(frozen=True)
class Goal:
    """A goal of the issue: what, the limit, and the value that was found (same unit)."""

    text: str
    limit: float
    unit: str
    value: float

    def row(self, law: str) -> str:
        """Return its row."""
        verdict = 'reached' if self.value <= self.limit else '**not reached**'
        return (
            f'| {law} | {self.text} | {self.limit:g} {self.unit} | {self.value:.3g} | {verdict} |'
        )


def goals(found: Found) -> list[str]:
    """Return the table of goals."""

    def value(law: str, pace: str, case: str, column: str, factor: float = 1e3) -> float:
        row = found.get((law, pace, case))
        if row is None:
            return math.nan
        return factor * float(row[column]) if row['stable'] == 'true' else math.inf

    def worst(law: str, names: Iterable[str], column: str = 'rms') -> float:
        values = [value(law, 'smooth', name, column) for name in names]
        return math.nan if any(map(math.isnan, values)) else max(values)

    signs = (0.9, 1.1)
    lines = ['| law | goal | at most | found | |', '|---|---|---|---|---|']
    for law in ('lqg', 'adaptive'):
        off = [f'{name} {sign}' for name in ('EI', 'density', 'latency') for sign in signs]
        asked = [
            Goal('smooth: rms', 5, 'mm', value(law, 'smooth', 'nominal', 'rms')),
            Goal('smooth: largest error', 10, 'mm', value(law, 'smooth', 'nominal', 'max')),
            Goal('smooth: overshoot', 6, 'mm', value(law, 'smooth', 'nominal', 'overshoot')),
            Goal('smooth: residual after the end', 1, 'mm',
                 value(law, 'smooth', 'hold', 'residual')),
            Goal('smooth: the same, 2 mm of noise', 10, 'mm',
                 value(law, 'smooth', 'noisy hold', 'residual')),
            Goal('smooth: torque', 80, 'N m', value(law, 'smooth', 'nominal', 'torque', 1.0)),
            Goal('smooth: rms, one of EI, mass, delay 10 % off', 20, 'mm', worst(law, off)),
            Goal('constant: rms', 0.20, 'm', value(law, 'constant', 'nominal', 'rms', 1.0)),
            Goal('constant: overshoot', 0.05, 'm',
                 value(law, 'constant', 'nominal', 'overshoot', 1.0)),
            Goal('constant: torque', 150, 'N m',
                 value(law, 'constant', 'nominal', 'torque', 1.0)),
        ]  # fmt: skip
        lines += [goal.row(law) for goal in asked]
    combined = ['all ' + ' '.join(map(str, s)) for s in itertools.product(signs, repeat=3)]
    lines.append(
        Goal(
            'smooth: rms after the first square, all three 10 % off, any direction', 8, 'mm',
            worst('adaptive', combined, 'later_rms'),
        ).row('adaptive')
    )  # fmt: skip
    held = [key for key in found if key[2] in ('hold', 'noisy hold') and key[0] in PLANNING]
    fine = sum(found[key]['stable'] == 'true' for key in held)
    verdict = 'reached' if fine == len(held) else '**not reached**'
    lines.append(
        f'| all four | stable over a hold of 60 s | | {fine} of {len(held)} | {verdict} |'
    )
    return lines


def beyond(found: Found) -> list[str]:
    """Return the table of what the model does not have."""
    lines = ['| law | plant | rms, mm |', '|---|---|---|']
    for law in PLANNING:
        if (law, 'smooth', '5 modes') in found:
            lines.append(f'| {law} | 5 modes | {largest([found[law, "smooth", "5 modes"]])} |')
    return lines


def main() -> int:
    """Simulate what is asked for, and write data and page."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--only', nargs='+', choices=NAMES, metavar='LAW', default=NAMES)
    parser.add_argument('--pace', nargs='+', choices=PACES, default=PACES)
    parser.add_argument('--draws', type=int, default=100, help='Monte Carlo runs a law')
    parser.add_argument('--workers', type=int, default=2)
    parser.add_argument('--tables', action='store_true', help='no runs: the page from the data')
    args = parser.parse_args()
    found = read()
    runs = []
    for pace, law in [] if args.tables else itertools.product(args.pace, args.only):
        runs += runs_of(law, pace)
        if law in PLANNING:
            runs += drawn(law, pace, args.draws)
    for row in compute(runs, args.workers) if runs else ():
        found[row['law'], row['pace'], row['case']] = row
        write(found)
    tables = {pace: table(found, pace) for pace in PACES}
    put(PAGE, {**tables, 'goals': goals(found), 'beyond': beyond(found)})
    return 0


if __name__ == '__main__':
    sys.exit(main())
