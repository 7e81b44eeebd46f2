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

"""The tables in docs/fls.md, from those in docs/data."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from validation.tables import DOCS, fixed, grouped, Lines, number, put, read, Table, table

PAGE = DOCS / 'fls.md'


def ks_lines() -> Lines:
    """Results over K_s with three and five functions, and with a constant gain."""
    kinds = ('three', 'five', 'constant')
    runs = {(r['case'], r['kind'], float(r['ks'])): r for r in read('fls', kn='5')}

    def cell(case: str, kind: str, ks: float) -> str:
        row = runs[case, kind, ks]
        if row['outcome'] != 'stable':
            return 'unstable'
        return f'{fixed(row["rms_error"], 3)} / {fixed(row["max_overshoot"])}'

    columns = [(case, kind) for case in ('fls_collocated', 'fls_tip') for kind in kinds]
    head = [f'{case.removeprefix("fls_")}, {kind}' for case, kind in columns]
    return table(
        ('K_s, or gain', *head),
        ((str(ks), *(cell(case, kind, float(ks)) for case, kind in columns))
         for ks in range(1, 31)),
    )  # fmt: skip


def same_gain(rows: Table, case: str, column: str, gain: float) -> float:
    """Return a result of the constant gain, interpolated to ``gain``."""
    fixed_gain = sorted(
        (float(r['ks']), float(r[column])) for r in rows
        if (r['case'], r['kind'], r['outcome']) == (case, 'constant', 'stable')
    )  # fmt: skip
    x, y = zip(*fixed_gain, strict=True)
    return float(np.interp(gain, x, y))


def best_lines() -> Lines:
    """Write the best K_s of each fuzzy system, and the constant gain of the same mean."""
    rows = read('fls', kn='5')

    def cells() -> Iterator[tuple[str, ...]]:
        for case in ('fls_collocated', 'fls_tip'):
            for kind in ('three', 'five', 'three, largest', 'constant'):
                own = [r for r in rows if (r['case'], r['kind']) == (case, kind)]
                stable = [r for r in own if r['outcome'] == 'stable']
                best = min(stable, key=lambda r: float(r['rms_error']))
                least = min(stable, key=lambda r: float(r['max_overshoot']))
                paper = next((r for r in stable if r['ks'] == '15'), None)
                for row in (best, paper):
                    if row is None:
                        continue
                    mean = float(row['mean_gain'])
                    level = [
                        f'{same_gain(rows, case, c, mean):.3f}'
                        for c in ('rms_error', 'max_overshoot')
                    ]
                    label = f'{row["ks"]}{", least rms" if row is best else ""}'
                    if row is least:
                        label += ', least overshoot'
                    yield (case.removeprefix('fls_'), kind,
                           '1 to ' + number(max(float(r['ks']) for r in stable)), label,
                           number(row['mean_gain']), fixed(row['rms_error'], 3),
                           fixed(row['max_overshoot'], 3), number(row['max_torque'], 4),
                           '' if kind == 'constant' else ' / '.join(level))  # fmt: skip

    return table(
        ('sensor', 'functions', 'stable K_s', 'K_s', 'mean gain', 'rms, m', 'overshoot, m',
         'largest torque, N m', 'constant gain of that mean: rms / overshoot, m'),
        cells(),
    )  # fmt: skip


def kn_lines() -> Lines:
    """Results over K_n, which widens the inputs' functions."""
    rows = read('fls', kind='three', ks='15')
    rows.sort(key=lambda r: (r['case'], float(r['kn'])))
    return table(
        ('sensor', 'K_n, m', 'outcome', 'gain: least, mean, largest', 'rms, m', 'overshoot, m'),
        (
            (r['case'].removeprefix('fls_'), r['kn'], r['outcome'],
             f"{number(r['least_gain'])}, {number(r['mean_gain'])}, {number(r['largest_gain'])}",
             fixed(r['rms_error'], 3), fixed(r['max_overshoot'], 3))
            for r in rows
        ),
    )  # fmt: skip


def gain_lines() -> Lines:
    """Write the largest stable gain at rest beside what the FLS can have and has."""
    flight = read('fls_flight', case='fls_tip')
    bends = np.array([float(r['theta2']) for r in flight])
    seen = np.array([float(r['gain']) for r in flight])

    def cells() -> Iterator[tuple[str, ...]]:
        for (place, hub), group in grouped(read('gain'), 'place', 'hub_inertia'):
            poses = np.array([float(r['theta2']) for r in group])
            high = np.array([float(r['gain_high'] or 'inf') for r in group])
            over = ''
            if (place, hub) == ('tip, 1.238 ms', '8'):
                over = f'{np.mean(seen > np.interp(bends, poses, high)):.1%} of {len(seen)}'
            yield (place, hub, number(high[0]), number(high[-1]),
                   'yes' if high.min() > 2.5 else 'no', 'yes' if high.min() > 12.5 else 'no',
                   over)  # fmt: skip

    return table(
        ('sensor', 'hubs, kg m²', 'limit outstretched (0.28 rad)', 'limit bent (1.59 rad)',
         '2.5 stable at all poses', '12.5 too', 'samples of fls_tip above it'),
        cells(),
    )  # fmt: skip


def write(page: Path = PAGE) -> Path:
    """Put the tables into the page."""
    put(page, {'ks': ks_lines(), 'best': best_lines(), 'kn': kn_lines(), 'gain': gain_lines()})
    return page
