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
``flexarm fit`` on measurements of an arm that another code computed.

    python -m validation.fit_draws --linear  # one step from the truth in place of searches
    python -m validation.fit_draws           # searches: the draws that fit_draws.csv lacks

One motion of the arm in Exudyn (`validation.exudyn_rig`), measured a hundred times: noise of the
gauges and their low-pass, noise and resolution of the encoders, noise of the measured torques.
Each draw is fitted in two stages, as a rig is.  First links and gauges with the joints driven as
measured; then friction and inertia of the joints from the torques, with the links as they are, so
that the second stage is judged alone.
"""

from __future__ import annotations

import argparse
import csv
from dataclasses import replace
from pathlib import Path
import tempfile
from typing import NamedTuple

from flexarm_ros.identification.estimate.fitting import Fit, fit, prepare
from flexarm_ros.identification.estimate.problem import Problem
from flexarm_ros.identification.estimate.scores import correlation_length
from flexarm_ros.identification.estimate.statistics import estimate
from flexarm_ros.identification.recording import read_columns, Recording
from flexarm_ros.identification.setting import load_setting, numbers_of, Setting, text_of
import numpy as np
from scipy.signal import bilinear, lfilter
from validation import exudyn_rig
from validation.motion import Array
from validation.report import Section

ROOT = Path(__file__).resolve().parent.parent
ARM = ROOT / 'examples' / 'bench_arm.yaml'
OVERRIDES = (
    'plant.modes=3', 'plant.basis=arm_modes', 'plant.link_damping=[0.04, 0.02]',
    'plant.viscous_friction=[0.6, 0.1]', 'plant.coulomb_friction=[0.02, 0.006]',
    'strain_gauge.location=[0.049292196, 0.039433757]', 'strain_gauge.gain=[0.8, 1.25]',
)  # fmt: skip
"""The arm as it is; the places are those of `validation.exudyn_rig.gauge_places`."""


class Stage(NamedTuple):
    """One fit of a recording: the free keys, the mode, and the channels; empty: all."""

    free: tuple[str, ...]
    mode: str
    channels: tuple[str, ...] = ()


LINKS = Stage(
    ('plant.flexural_rigidity', 'plant.link_end_mass', 'plant.link_damping', 'strain_gauge.gain'),
    'driven',
)
JOINTS = Stage(
    ('plant.viscous_friction', 'plant.coulomb_friction', 'plant.hub_inertia'),
    'torque',
    ('strain1', 'strain2', 'theta1_rate', 'theta2_rate'),
)
STAGES = LINKS, JOINTS

DRAWS, SECONDS = 100, 4.0
DATA = ROOT / 'docs' / 'data' / 'fit_draws.csv'
NOISE = 0.01
"""White noise of the gauges before their low-pass and of the torques, per std of each signal."""

ANGLE_NOISE, RESOLUTION = 2e-6, 5e-6
"""Noise of an encoder before it is rounded, and its count, rad; the joints move by some 0.05."""

OFF = 1.02
"""Factor on every free number at the start of a search: some five standard deviations away."""


def setting() -> Setting:
    """Return the scenario with the true numbers."""
    return load_setting(ARM, OVERRIDES)


def measured(flight: dict[str, Array], true: Setting, seed: int) -> Recording:
    """Return a flight as the rig's sensors give it."""
    random, gauge = np.random.default_rng(seed), true.gauge
    rows, period = len(flight['theta']), true.config.run.control_period
    columns = {'t_s': period * np.arange(rows)}
    for j in (0, 1):
        angle = flight['theta'][:, j] + ANGLE_NOISE * random.standard_normal(rows)
        columns[f'theta{j + 1}_rad'] = np.round(angle / RESOLUTION) * RESOLUTION
        omega = 2.0 * np.pi * gauge.filter_cutoff[j]
        damping = 2.0 * gauge.filter_damping[j] * omega
        low_pass = bilinear([omega**2], [1.0, damping, omega**2], fs=1.0 / period)
        signal = gauge.gain[j] * _noisy(flight['curvature'][:, j], random)
        columns[f'strain{j + 1}'] = lfilter(*low_pass, signal)
    for j in (0, 1):
        columns[f'tau{j + 1}_nm'] = _noisy(flight['torque'][:, j], random)
    return read_columns(columns, f'draw {seed}')


def _noisy(signal: Array, random: np.random.Generator) -> Array:
    return np.asarray(signal + NOISE * signal.std() * random.standard_normal(len(signal)))


def fitted(data: Recording, start: Setting, stage: Stage) -> Fit:
    """Return the fit of a whole recording from rest, every free number being `OFF` at first."""
    keys = [key for given in stage.free for key in numbers_of(given)]
    off = start.with_numbers({key: OFF * start.number(key) for key in keys})
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'start.yaml'
        path.write_text(text_of(off))
        request = prepare([data], path, stage.free, stage.mode, None, chosen=stage.channels)
        return fit(request)


def one_draw(flight: dict[str, Array], seed: int) -> dict[str, tuple[float, float]]:
    """Return error and std of each number, per its true value, with the noise of a seed."""
    true = setting()
    data = measured(flight, true, seed)
    return {
        key: (row['value'] / true.number(key) - 1.0, (row['std'] or np.inf) / true.number(key))
        for stage in STAGES
        for key, row in fitted(data, true, stage).parameters.items()
    }


def linear_draws(flight: dict[str, Array], stage: Stage, count: int) -> dict[str, Array]:
    """
    Return errors and stds, (count, 2), of each number, per its true value.

    One Gauss-Newton step from the true numbers, with the sensitivities of the first draw: errors
    are below 1 %, so that a search would end nearly there, and a draw takes much less time.
    """
    true, rows = setting(), []
    sensitivity = np.zeros(0)
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'true.yaml'
        path.write_text(text_of(true))
        for seed in range(count):
            data = [measured(flight, true, seed)]
            request = prepare(data, path, stage.free, stage.mode, None, chosen=stage.channels)
            problem = request.problem
            numbers = np.array([one.start for one in problem.free])
            if not sensitivity.size:
                sensitivity = _sensitivity(problem, numbers)
            residual = _residuals(problem, numbers)
            levels = [correlation_length(one) * np.mean(one**2) for one in residual]
            weights = 1.0 / np.sqrt(levels)
            jacobian, residual = sensitivity * weights[:, None, None], residual * weights[:, None]
            flat = jacobian.reshape(-1, len(numbers))
            step = -np.linalg.lstsq(flat, residual.ravel(), rcond=None)[0]
            block = jacobian, residual + jacobian @ step
            std = estimate(numbers + step, [block], np.full(len(numbers), np.inf)).std
            rows.append(np.stack([step / numbers, std / numbers], axis=1))
    return dict(zip(problem.keys, np.array(rows).transpose(1, 0, 2), strict=True))


def _residuals(problem: Problem, numbers: Array) -> Array:
    """Return the residuals, (c, n); 0 where a channel is not compared."""
    found = problem.residuals(numbers)
    rows = np.zeros((len(found), len(found[0].used)))
    for row, one in zip(rows, found, strict=True):
        row[one.used] = one.values
    return rows


def _sensitivity(problem: Problem, numbers: Array) -> Array:
    """Return the central differences of the residuals, (c, n, p)."""
    columns = []
    for step in np.diag(1e-4 * np.abs(numbers)):
        ends = [_residuals(problem, numbers + sign * step) for sign in (1.0, -1.0)]
        columns.append((ends[0] - ends[1]) / (2.0 * step.sum()))
    return np.stack(columns, axis=2)


def draws(path: Path = DATA) -> dict[int, dict[str, tuple[float, float]]]:
    """Return error and std of each number, per its true value, of each draw in a file."""
    found: dict[int, dict[str, tuple[float, float]]] = {}
    if path.is_file():
        with path.open(newline='', encoding='utf-8') as file:
            for row in csv.DictReader(file):
                of_seed = found.setdefault(int(row['seed']), {})
                of_seed[row['number']] = float(row['error']), float(row['std'])
    return found


def draw_more(count: int, path: Path = DATA) -> None:
    """Add the draws with seeds below ``count`` that a file lacks; may be stopped at any time."""
    known = draws(path)
    missing = [seed for seed in range(count) if seed not in known]
    if not missing:
        return
    flight = exudyn_rig.fly(setting().config.plant, SECONDS)
    if not known:
        path.write_text('seed,number,error,std\n', 'utf-8')
    for seed in missing:
        rows = one_draw(flight, seed).items()
        text = ''.join(f'{seed},{key},{error:.4e},{std:.4e}\n' for key, (error, std) in rows)
        with path.open('a', encoding='utf-8') as file:
            file.write(text)
        print(f'draw {seed}', flush=True)


def table(section: Section, found: dict[str, Array]) -> None:
    """Add the table of errors and stds, (n, 2) of each number, and judge them."""
    count = len(next(iter(found.values())))
    close = {key: int(np.sum(np.abs(rows[:, 0]) < 0.01)) for key, rows in found.items()}
    inside = {key: int(np.sum(np.abs(rows[:, 0]) < 2 * rows[:, 1])) for key, rows in found.items()}
    section.table(
        ['number', 'mean error, %', 'std of the errors, %', 'std as reported, mean, %',
         f'within 1 %, of {count}', f'within two std, of {count}'],
        [
            [f'`{key}`', *(f'{100 * x:.3f}' for x in (
                rows[:, 0].mean(), rows[:, 0].std(), rows[:, 1].mean())), close[key], inside[key]]
            for key, rows in found.items()
        ],
    )  # fmt: skip
    for what, counts in (('1 %', close), ('two std', inside)):
        least = min(counts, key=lambda key, counts=counts: counts[key])
        section.goal(
            f"Fits of Exudyn's arm, {len(found)} numbers, {count} noise draws: within {what} "
            f'(the least, `{least}`)',
            f'{counts[least]}', f'{round(0.9 * count)}', counts[least] >= 0.9 * count,
        )  # fmt: skip


def run(count: int = DRAWS) -> Section:
    """Compute the tables: of linear draws, and of wrong models."""
    section = Section('Fits of an arm that another code computed')
    flight = exudyn_rig.fly(setting().config.plant, SECONDS)
    found: dict[str, Array] = {}
    for stage in STAGES:
        found.update(linear_draws(flight, stage, count))
    table(section, found)
    data = measured(flight, setting(), 0)
    section.table(
        ['model', 'strain1, fit %', 'strain2, fit %'],
        [
            [name, *(f'{value:.2f}' for value in strain_fits(fitted(data, start, LINKS)))]
            for name, start in models().items()
        ],
    )
    return section


def models() -> dict[str, Setting]:
    """Return the right model and wrong ones."""
    true = setting()
    few = true.with_section('plant', replace(true.config.plant, modes=1))
    heavy = true.with_numbers({'plant.payload_mass': 1.5 * true.number('plant.payload_mass')})
    return {
        'as it is': true, 'one mode of three per link': few,
        'payload of 0.3 kg in place of 0.2 kg': heavy,
    }  # fmt: skip


def strain_fits(found: Fit) -> tuple[float, float]:
    """Return how well both strains are fitted, percent."""
    first, second = (found.channels[f'strain{n}'].fit or 0.0 for n in (1, 2))
    return first, second


def main() -> None:
    """Compute the draws that are missing."""
    parser = argparse.ArgumentParser(prog='python -m validation.fit_draws')
    parser.add_argument('--draws', type=int, default=DRAWS, help=f'default {DRAWS}')
    parser.add_argument('--out', type=Path, default=DATA, help='CSV that is continued')
    parser.add_argument('--linear', action='store_true', help='print the table of linear draws')
    chosen = parser.parse_args()
    if chosen.linear:
        print(run(chosen.draws).text())
        return
    draw_more(chosen.draws, chosen.out)
    section = Section('')
    known = draws(chosen.out)
    first = next(iter(known.values()))
    table(section, {key: np.array([row[key] for row in known.values()]) for key in first})
    print(section.text())


if __name__ == '__main__':
    main()
