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

"""The tables in docs/stability.md, from those in docs/data."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from validation import stability_factorial, stability_held
from validation.tables import (
    delay,
    DOCS,
    fixed,
    grouped,
    law,
    Lines,
    number,
    put,
    read,
    Table,
    table,
)

PAGE = DOCS / 'stability.md'
LATENCY = 'tip_sensor.latency'
PLACE = 'tip_sensor.location'
SOURCE = 'controller.velocity_source'
HUB = 'plant.hub_inertia'


def bound(rows: Table) -> str:
    """Return between which latencies, ms, a column of simulated runs stops being stable."""
    last = ''
    for row in rows:
        value = f'{1e3 * float(row[LATENCY]):g}'
        if row['outcome'] != 'stable':
            return f'{last} to {value}' if last else 'none'
        last = value
    return f'over {last}'


def boundary_lines() -> Lines:
    """Boundaries over the sensor's place: linear, and simulated at three speeds."""
    rows = [r for r in read('boundary') if float(r['location_m']) % 0.75 == 0.0]
    return table(
        ('law', 'sensor, m', 'linear, worst pose', 'simulated at rest, that pose',
         'simulated, 0.3 m/s', 'simulated, 3.15 m/s', 'linear, best pose',
         'linear, worst pose, gain 5'),
        (
            (law(r), r['location_m'], *(delay(r[k]) for k in (
                'linear_least_ms', 'hold_ms', 'slow_ms', 'paper_ms', 'linear_most_ms')),
             delay(r['linear_gain_5_ms']) if r['law'] == 'fls' else '')
            for r in rows
        ),
    )  # fmt: skip


def outcome_lines() -> Lines:
    """How many of the map's runs are stable, and how soon the others diverge."""
    rows = read('map') + [{**row, 'hub': '0 to 20'} for row in read('hub_elastic')]
    for row in rows:
        row.setdefault('hub', '8')
        row.setdefault('tip_sensor.measurand', 'elastic')
    order = ('scenario', 'hub', 'tip_sensor.measurand', SOURCE)
    rows.sort(key=lambda r: tuple(r[name] for name in order), reverse=True)

    def cells() -> Iterator[tuple[str, ...]]:
        for (_, measurand, source, hub), group in grouped(
            rows, 'scenario', 'tip_sensor.measurand', SOURCE, 'hub'
        ):
            ticks = [int(r['unstable_tick']) for r in group if r['outcome'] != 'stable']
            when = f'{min(ticks) / 1e3:.3g} to {max(ticks) / 1e3:.3g} s' if ticks else ''
            yield (law(group[0]), measurand, source, hub,
                   f'{len(group) - len(ticks)} of {len(group)}', when)  # fmt: skip

    return table(('law', 'measurand', 'rates from', 'hubs, kg m²', 'stable', 'the others diverge'),
                 cells())  # fmt: skip


SHOWN = ('0.0', '0.001238', '0.0025', '0.005', '0.01', '0.0312', '0.05')


def effect_lines() -> Lines:
    """Overshoot and true tip error over the latency, rigid measurand."""
    head = [f'{1e3 * float(x):g} ms' for x in SHOWN]

    def cells() -> Iterator[tuple[str, ...]]:
        for (_, source, place), group in grouped(
            read('map', **{'tip_sensor.measurand': 'rigid'}), 'scenario', SOURCE, PLACE
        ):
            if place not in ('4.5', '6.75', '9.0'):
                continue
            by = {row[LATENCY]: row for row in group}
            yield (law(group[0]), source, place, *(
                f"{fixed(by[x]['max_overshoot'])} / {fixed(by[x]['tip_max_error'])}"
                if by[x]['outcome'] == 'stable' else 'unstable' for x in SHOWN
            ))  # fmt: skip

    return table(('law', 'rates from', 'sensor, m', *head), cells())


def correction_lines() -> Lines:
    """Write the same flights without and with the correction."""
    without = {
        (r['scenario'], r[SOURCE], r[PLACE], r[LATENCY]): r
        for r in read('map', **{'tip_sensor.measurand': 'rigid'})
    }

    def cells() -> Iterator[tuple[str, ...]]:
        for (name, source, place), group in grouped(read('correction'), 'scenario', SOURCE, PLACE):
            plain = [without[name, source, place, r[LATENCY]] for r in group]
            by = {r[LATENCY]: (p, r) for p, r in zip(plain, group, strict=True)}

            def pair(latency: str, column: str, by: dict = by) -> str:  # type: ignore[type-arg]
                return ' → '.join(fixed(r[column], 3) for r in by[latency])

            yield (law(group[0]), source, place, bound(plain), bound(group),
                   *(pair(x, c) for x in ('0.001238', '0.0312')
                     for c in ('max_overshoot', 'max_error', 'tip_max_error')))  # fmt: skip

    return table(
        ('law', 'rates from', 'sensor, m', 'unstable from, ms', 'the same, corrected',
         *(f'{what}, {x} ms' for x in ('1.238', '31.2')
           for what in ('overshoot', 'largest error', "tip's largest error"))),
        cells(),
    )  # fmt: skip


def hub_lines() -> Lines:
    """Boundaries and runs over the hubs' inertia, sensor at the tip."""
    flown = {
        (r['scenario'].removesuffix('_tip'), float(r[HUB]), r[LATENCY]): r
        for r in read('hub', **{SOURCE: 'feedback'})
    }

    def cells() -> Iterator[tuple[str, ...]]:
        for row in read('hub_boundary'):
            run = flown.get((row['law'], float(row['hub_inertia']), '0.001238'))
            seen = ('', '') if run is None else (
                ('unstable', '') if run['outcome'] != 'stable'
                else (fixed(run['max_overshoot']), fixed(run['tip_max_error']))
            )  # fmt: skip
            yield (law(row), row['hub_inertia'], delay(row['linear_least_ms']),
                   delay(row['hold_ms']), delay(row['paper_ms']), delay(row['linear_most_ms']),
                   number(row['collocated_gain_limit']), *seen)  # fmt: skip

    return table(
        ('law', 'hubs, kg m²', 'linear, worst pose', 'simulated at rest', 'simulated, 3.15 m/s',
         'linear, best pose', 'largest stable gain, collocated', 'overshoot, 1.238 ms',
         "tip's largest error"),
        cells(),
    )  # fmt: skip


def agreement_lines() -> Lines:
    """How simulated runs ended where the linear analysis says stable, at some poses, unstable."""
    linear = {
        (f"{r['law']}_tip", float(r['location_m'])): (
            float(r['linear_least_ms'] or 'inf'), float(r['linear_most_ms'] or 'inf'))
        for r in read('boundary')
    }  # fmt: skip
    rigid = {'tip_sensor.measurand': 'rigid', SOURCE: 'feedback'}
    flights = (('0.3 m/s', read('slow')), ('3.15 m/s', read('map', **rigid)))

    def cells() -> Iterator[tuple[str, ...]]:
        for scenario in ('pd_tip', 'fls_tip'):
            for speed, rows in flights:
                count: Counter[tuple[str, str]] = Counter()
                for row in rows:
                    if row['scenario'] != scenario:
                        continue
                    least, most = linear[scenario, float(row[PLACE])]
                    latency = 1e3 * float(row[LATENCY])
                    said = 'all' if latency < least else 'none' if latency > most else 'some'
                    count[said, row['outcome']] += 1
                yield (law({'scenario': scenario}), speed, *(
                    f"{count[said, 'stable']} / {count[said, 'unstable']}"
                    for said in ('all', 'some', 'none')
                ))  # fmt: skip

    return table(
        ('law', 'simulated at', 'linear: stable at all poses', 'at some', 'at none'), cells()
    )


def speed_lines() -> Lines:
    """Return simulated boundaries against speed."""
    rows = read('speed')
    speeds = list(dict.fromkeys(r['speed_m_s'] for r in rows))[::-1]

    def cells() -> Iterator[tuple[str, ...]]:
        for (_, place), group in grouped(rows, 'law', 'location_m'):
            by = {r['speed_m_s']: r for r in group}
            yield (law(group[0]), place, delay(group[0]['linear_least_ms']),
                   *(delay(by[x]['flown_ms']) for x in speeds))  # fmt: skip

    return table(
        ('law', 'sensor, m', 'linear, worst pose', *(f'{float(x):g} m/s' for x in speeds)), cells()
    )


def model_lines() -> Lines:
    """Boundaries with more modes, the full model and damping, sensor at the tip."""
    head = ('law', 'model', 'modes a link', 'damping ratio', 'worst pose', 'best pose')
    names = ('linear_least_ms', 'linear_most_ms')
    return table(
        head,
        (
            (law(r), r['model'], r['modes'], r['damping_ratio'], *(delay(r[k]) for k in names))
            for r in read('model')
        ),
    )


def laws_lines() -> Lines:
    """Write the laws that see the true point: rms / largest tip error over place and delay."""
    rows = read('laws')
    head = [f'{1e3 * float(x):g} ms' for x in dict.fromkeys(r[LATENCY] for r in rows)]

    def cells() -> Iterator[tuple[str, ...]]:
        for (name, place), group in grouped(rows, 'scenario', PLACE):
            yield (f'`{name}`', place, *(
                f"{1e3 * float(r['tip_rms_error']):.1f} / {1e3 * float(r['tip_max_error']):.1f}"
                if r['outcome'] == 'stable' else 'unstable' for r in group
            ))  # fmt: skip

    return table(('scenario', 'sensor, m', *head), cells())


def growth_lines() -> Lines:
    """Growth rates of loops that see the true point."""
    rows = [r for r in read('growth') if float(r['location_m']) % 0.75 == 0.0]
    places = list(dict.fromkeys(r['location_m'] for r in rows))

    def cells() -> Iterator[tuple[str, ...]]:
        for (_, source), group in grouped(rows, 'law', 'velocity_source'):
            yield (law(group[0]), source, *(
                f"{number(r['least_rate'], 2)} to {number(r['largest_rate'], 2)}" for r in group
            ))  # fmt: skip

    return table(('law', 'rates from', *(f'{x} m' for x in places)), cells())


def write(page: Path = PAGE) -> Path:
    """Put the tables into the page."""
    put(page, {
        'boundary': boundary_lines(), 'outcome': outcome_lines(), 'effect': effect_lines(),
        'correction': correction_lines(), 'hub': hub_lines(), 'agreement': agreement_lines(),
        'speed': speed_lines(), 'model': model_lines(), 'growth': growth_lines(),
        'laws': laws_lines(), 'factorial': stability_factorial.lines(),
        'held': stability_held.lines(),
    })  # fmt: skip
    return page
