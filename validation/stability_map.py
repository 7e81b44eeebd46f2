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
The tables and pictures of docs/stability.md and docs/fls.md.

    python -m validation.stability_map              # everything: some 20 minutes on two cores
    python -m validation.stability_map sweeps       # or one part of it:
    python -m validation.stability_map boundary hub speed model gain growth factorial held fls
    python -m validation.stability_map pictures pages     # from the tables in docs/data

Whether a table is still what the code makes: validation/stability_check.py.

Tables go to docs/data, pictures to docs/images.  Sweeps keep their state below runs/ and go
on where they were cut off.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
import csv
from dataclasses import replace
import multiprocessing
from pathlib import Path
import subprocess
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.stability.margins import gain_range, poses_along
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np
from validation.stability import boundary

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / 'docs' / 'data'
IMAGES = ROOT / 'docs' / 'images'
LAWS = ('pd', 'fls')
WORKERS = 2
FLS_GAINS = (2.5, 5.0, 7.5)
LEAST_GAIN = 0.05
"""Gain of (20) from which the search for the largest stable one starts."""

SWEEPS = ('map', 'slow', 'hub', 'correction', 'hub_elastic', 'laws', 'factorial',
          'factorial_corrected')  # fmt: skip
KEPT = ('outcome', 'unstable_tick', 'rms_error', 'max_error', 'tip_rms_error', 'tip_max_error',
        'max_overshoot', 'max_deflection', 'max_torque', 'overshoot[0]', 'overshoot[1]',
        'overshoot[2]')  # fmt: skip
"""Columns of a sweep's table that are worth keeping here."""

Row = dict[str, Any]


def write(name: str, rows: list[Row]) -> None:
    """Write a table; floats to six digits, empty for what is not known."""
    DATA.mkdir(parents=True, exist_ok=True)
    with (DATA / f'{name}.csv').open('w', newline='', encoding='utf-8') as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator='\n')
        writer.writeheader()
        for row in rows:
            writer.writerow({key: text(value) for key, value in row.items()})
    print(f'{DATA / name}.csv: {len(rows)} rows')


def text(value: Any) -> str:
    """Return a value as it is written."""
    if value is None:
        return ''
    return f'{value:.6g}' if isinstance(value, float) else str(value)


def spread(work: Callable[[Any], Any], tasks: Iterable[Any]) -> list[Any]:
    """Return ``work`` of each task, in order, computed in processes."""
    with ProcessPoolExecutor(WORKERS, multiprocessing.get_context('spawn')) as pool:
        return list(pool.map(work, tasks))


def tip_config(law: str, location: float = 9.0, **plant: Any) -> RunConfig:
    """Return the paper's scenario with the sensor at a place, without latency."""
    config = scenario.load(f'{law}_tip')
    return replace(
        config,
        plant=replace(config.plant, **plant),
        tip_sensor=replace(config.tip_sensor, location=location, latency=0.0),
    )


def sweeps() -> None:
    """Run the sweeps and keep their tables."""
    for name in SWEEPS:
        out = ROOT / 'runs' / f'stability_{name}'
        command = ['sweep', str(ROOT / 'config' / f'stability_{name}.yaml'), '--out', str(out)]
        subprocess.run(
            [sys.executable, '-m', 'flexarm_ros.cli', *command, '--no-pictures',
             '--workers', str(WORKERS)],
            check=True,
        )  # fmt: skip
        keep_table(name, out / 'table.csv')


def keep_table(name: str, path: Path) -> None:
    """Copy a sweep's table without the columns that nobody reads here."""
    with path.open(newline='', encoding='utf-8') as file:
        given = list(csv.DictReader(file))
    first = list(given[0])
    outcome = first.index('outcome')
    swept = first[1:outcome]
    rows = []
    for row in given:
        numbers = {key: float(row[key]) if row.get(key) else None for key in KEPT[2:]}
        if row['outcome'] != 'stable':
            numbers = dict.fromkeys(numbers)
        rows.append({key: row[key] for key in (*swept, *KEPT[:2])} | numbers)
    write(f'stability_{name}', rows)


def milliseconds(value: float | None) -> float | None:
    """Return seconds in ms."""
    return None if value is None else 1e3 * value


def location_row(task: tuple[str, float]) -> Row:
    """Return all boundaries of one law at one place of the sensor."""
    law, location = task
    config = tip_config(law, location)
    linear = boundary.linear_boundary(config)
    row: Row = {
        'law': law, 'location_m': location,
        'linear_least_ms': milliseconds(linear.least),
        'linear_most_ms': milliseconds(linear.most),
        'worst_theta2': linear.worst.theta2,
        'hold_ms': milliseconds(boundary.fading_boundary(config, linear.worst)),
        'slow_ms': milliseconds(boundary.flown_boundary(boundary.one_side(config, 40.0))),
        'paper_ms': milliseconds(boundary.flown_boundary(config)),
    }  # fmt: skip
    for gain in FLS_GAINS[1:]:
        value = None
        if law == 'fls':
            value = milliseconds(boundary.linear_boundary(config, gain).least)
        row[f'linear_gain_{gain:g}_ms'] = value
    return row


def locations() -> None:
    """Boundaries over the sensor's place."""
    places = [4.5 + 0.25 * i for i in range(19)]
    write('stability_boundary', spread(location_row, [(law, x) for law in LAWS for x in places]))


def hub_row(task: tuple[str, float]) -> Row:
    """Return the boundaries of one law with one hub inertia, sensor at the tip."""
    law, inertia = task
    config = tip_config(law, hub_inertia=(inertia, inertia))
    linear = boundary.linear_boundary(config)
    collocated = replace(config, controller=replace(config.controller, feedback='encoder'))
    ranges = [
        gain_range(SampledLoop(collocated, pose.theta2), LEAST_GAIN)
        for pose in poses_along(config, 3)
    ]
    own = SampledLoop(collocated, 1.0).gain
    limits = [high for _, high in ranges if high is not None]
    return {
        'law': law, 'hub_inertia': inertia,
        'linear_least_ms': milliseconds(linear.least),
        'linear_most_ms': milliseconds(linear.most),
        'hold_ms': milliseconds(boundary.fading_boundary(config, linear.worst)),
        'paper_ms': milliseconds(boundary.flown_boundary(config)),
        'collocated_gain_limit': own * min(limits) if limits else None,
    }  # fmt: skip


def hubs() -> None:
    """Boundaries over the hubs' inertia."""
    inertias = [0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0,
                14.0, 16.0, 18.0, 20.0]  # fmt: skip
    write('stability_hub_boundary', spread(hub_row, [(law, h) for law in LAWS for h in inertias]))


def speed_row(task: tuple[str, float, float]) -> Row:
    """Return the simulated boundary of one side at one speed, beside the linear one."""
    law, location, side_time = task
    config = tip_config(law, location)
    linear = boundary.linear_boundary(config)
    flown = boundary.flown_boundary(boundary.one_side(config, side_time))
    return {
        'law': law, 'location_m': location, 'side_time_s': side_time,
        'speed_m_s': 12.6 / side_time, 'flown_ms': milliseconds(flown),
        'linear_least_ms': milliseconds(linear.least), 'linear_most_ms': milliseconds(linear.most),
    }  # fmt: skip


def speeds() -> None:
    """Boundaries over the speed along a side."""
    times = (2.0, 4.0, 8.0, 16.0, 40.0, 100.0, 400.0)
    tasks = [(law, x, t) for law in LAWS for x in (9.0, 6.75) for t in times]
    write('stability_speed', spread(speed_row, tasks))


def model_row(task: tuple[str, str, int, float]) -> Row:
    """Return the linear boundaries of one law with one model of the arm, sensor at the tip."""
    law, model, modes, damping = task
    config = tip_config(law, model=model, modes=modes, damping_ratio=damping)
    linear = boundary.linear_boundary(config, count=3, limit_s=0.02)
    return {
        'law': law, 'model': model, 'modes': modes, 'damping_ratio': damping,
        'linear_least_ms': milliseconds(linear.least),
        'linear_most_ms': milliseconds(linear.most), 'worst_theta2': linear.worst.theta2,
    }  # fmt: skip


def models() -> None:
    """Boundaries with more modes, and with the full model."""
    kinds = [('eq14', n, 0.0) for n in (1, 2, 3, 4)] + [('full', n, 0.0) for n in (1, 2, 3)]
    kinds += [('eq14', 1, 0.01), ('full', 3, 0.001), ('full', 3, 0.01)]
    write('stability_model', spread(model_row, [(law, *kind) for law in LAWS for kind in kinds]))


PLACES = ('encoder', 'tip, no latency', 'tip, 1.238 ms', '6.75 m, 0.9289 ms', 'tip, 31.2 ms')
LATENCY = {'encoder': 0.0, 'tip, no latency': 0.0, 'tip, 1.238 ms': 0.001238,
           '6.75 m, 0.9289 ms': 0.0009289, 'tip, 31.2 ms': 0.0312}  # fmt: skip


def gain_row(task: tuple[str, float, float]) -> Row:
    """Return the largest stable gain of J^T (Kp e + Kd e') at a pose."""
    place, inertia, theta2 = task
    config = tip_config('pd', 6.75 if '6.75' in place else 9.0, hub_inertia=(inertia, inertia))
    if place == 'encoder':
        config = replace(config, controller=replace(config.controller, feedback='encoder'))
    config = boundary.with_latency(config, LATENCY[place])
    low, high = gain_range(SampledLoop(config, theta2), LEAST_GAIN)
    return {'place': place, 'hub_inertia': inertia, 'theta2': theta2, 'gain_low': low,
            'gain_high': high}  # fmt: skip


def gains() -> None:
    """Stable gains over the elbow angle: (21) is (20) with a gain of 2.5 to 12.5."""
    bends = [float(b) for b in np.linspace(0.2838, 1.5908, 27)]
    tasks = [(place, h, b) for place in PLACES for h in (8.0,) for b in bends]
    tasks += [('tip, 1.238 ms', h, b) for h in (4.0, 20.0) for b in bends]
    write('stability_gain', spread(gain_row, tasks))


def growth_row(task: tuple[str, str, float]) -> Row:
    """Return the largest growth rates of a loop that sees the true point."""
    law, source, location = task
    config = tip_config(law, location)
    config = replace(
        config,
        tip_sensor=replace(config.tip_sensor, measurand='elastic'),
        controller=replace(config.controller, velocity_source=source),
    )
    row: Row = {'law': law, 'velocity_source': source, 'location_m': location}
    rates = []
    for pose in poses_along(config, 7):
        loop = SampledLoop(config, pose.theta2)
        rates.append(float(np.log(loop.modulus())) / loop.period)
    return row | {'least_rate': min(rates), 'largest_rate': max(rates)}


def growth() -> None:
    """Growth rates at rest with measurand elastic, no latency."""
    places = [4.5 + 0.25 * i for i in range(19)]
    tasks = [(law, v, x) for law in LAWS for v in ('feedback', 'encoder') for x in places]
    write('stability_growth', spread(growth_row, tasks))


def fls() -> None:
    """Sweep the FLS over K_s, number of functions, rules and K_n, beside a constant gain."""
    from validation import fls_study

    write('stability_fls', spread(fls_study.row, fls_study.tasks()))
    write('stability_fls_flight', fls_study.flight())


def factorial() -> None:
    """Analyse every combination of the sweep that crosses all factors."""
    from validation import stability_factorial

    write(
        'stability_factorial_linear', spread(stability_factorial.row, stability_factorial.tasks())
    )


def held() -> None:
    """Growth rates at rest of the laws that plan the motion, and flights, over the latency."""
    from validation import stability_held

    write('stability_held', spread(stability_held.row, stability_held.tasks()))


def pictures() -> None:
    """Draw everything from docs/data."""
    from validation.stability import pictures as stability_pictures

    for path in stability_pictures.draw_all(DATA, IMAGES):
        print(path)


def pages() -> None:
    """Put the tables into docs/stability.md and docs/fls.md."""
    from validation import fls_pages, stability_pages

    print(stability_pages.write(), fls_pages.write(), sep='\n')


PARTS: dict[str, Callable[[], None]] = {
    'sweeps': sweeps, 'boundary': locations, 'hub': hubs, 'speed': speeds, 'model': models,
    'gain': gains, 'growth': growth, 'factorial': factorial, 'held': held,
    'fls': fls, 'pictures': pictures, 'pages': pages,
}  # fmt: skip


def main() -> int:
    """Compute the parts that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('parts', nargs='*', choices=[*PARTS, []], metavar='PART',
                        help=', '.join(PARTS))  # fmt: skip
    args = parser.parse_args()
    for name in args.parts or PARTS:
        PARTS[name]()
    return 0


if __name__ == '__main__':
    sys.exit(main())
