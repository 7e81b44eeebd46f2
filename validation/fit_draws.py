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

One flight of the arm in Exudyn (`validation.exudyn_rig`), measured a hundred times: noise of the
gauges and their low-pass, noise and resolution of the encoders.  Links and gauges are fitted with
the joints driven as measured: friction moves the joints otherwise, and must not matter.
"""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
import multiprocessing
import os
from pathlib import Path
import tempfile

from flexarm_ros.identification.estimate.fitting import Fit, fit, prepare
from flexarm_ros.identification.recording import read_columns, Recording
from flexarm_ros.identification.setting import load_setting, numbers_of, Setting, text_of
import numpy as np
from scipy.signal import bilinear, lfilter
from validation import exudyn_rig
from validation.motion import Array
from validation.report import Section

SCENARIO = """
/**:
  ros__parameters: {control_period: 0.002, duration: 6.0}
plant:
  ros__parameters:
    model: full
    modes: 3
    basis: arm_modes
    length: [0.5, 0.4]
    mass_density: [0.6, 0.3]
    flexural_rigidity: [4.0, 1.2]
    link_damping: [0.04, 0.02]
    hub_inertia: [0.3, 0.03]
    link_end_mass: 1.2
    payload_mass: 0.2
    viscous_friction: [0.6, 0.1]
    coulomb_friction: [0.02, 0.006]
    initial_position: [0.0, 0.0]
tip_sensor:
  ros__parameters: {location: 0.9}
trajectory:
  ros__parameters: {kind: hold}
controller:
  ros__parameters: {law: pd, feedback: encoder}
strain_gauge:
  ros__parameters:
    location: [0.049292196, 0.039433757]
    gain: [0.8, 1.25]
    filter_cutoff: [4.0, 4.0]
    filter_damping: [0.7, 0.7]
"""
"""The arm as it is; the places are those of `validation.exudyn_rig.gauge_places`."""

LINKS = (
    'plant.flexural_rigidity', 'plant.link_end_mass', 'plant.link_damping', 'strain_gauge.gain',
)  # fmt: skip
DRAWS, SECONDS = 100, 4.0
GAUGE_NOISE = 4.5e-4
"""White noise of a gauge before its low-pass, 1/m; its signal has some 0.05."""

ANGLE_NOISE, RESOLUTION = 2e-6, 5e-6
"""Noise of an encoder before it is rounded, and its count, rad; the joints move by some 0.05."""

OFF = 1.1
"""Factor on every free number at the start of a search."""


def setting() -> Setting:
    """Return the scenario with the true numbers."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'rig.yaml'
        path.write_text(SCENARIO)
        return load_setting(path)


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
        noisy = gauge.gain[j] * flight['curvature'][:, j] + GAUGE_NOISE * random.standard_normal(
            rows
        )
        columns[f'strain{j + 1}'] = lfilter(*low_pass, noisy)
    return read_columns(columns, f'draw {seed}')


def fitted(data: Recording, start: Setting) -> Fit:
    """Return the fit of a whole recording from rest, every free number being `OFF` at first."""
    keys = [key for given in LINKS for key in numbers_of(given)]
    off = start.with_numbers({key: OFF * start.number(key) for key in keys})
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / 'start.yaml'
        path.write_text(text_of(off))
        return fit(prepare([data], path, LINKS, 'driven', None))


def one_draw(flight: dict[str, Array], seed: int) -> dict[str, tuple[float, float]]:
    """Return error and std of each number, per its true value, with the noise of a seed."""
    true = setting()
    found = fitted(measured(flight, true, seed), true).parameters
    return {
        key: (row['value'] / true.number(key) - 1.0, row['std'] / true.number(key))
        for key, row in found.items()
    }


def draws(flight: dict[str, Array], count: int) -> dict[str, Array]:
    """Return errors and stds, (count, 2), of each number, per its true value."""
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1), mp_context=context) as pool:
        found = list(pool.map(partial(one_draw, flight), range(count)))
    return {key: np.array([row[key] for row in found]) for key in found[0]}


def run() -> Section:
    """Compute the tables."""
    section = Section('Fits of an arm that another code computed')
    flight = exudyn_rig.fly(setting().config.plant, SECONDS)
    found = draws(flight, DRAWS)
    close = {key: int(np.sum(np.abs(rows[:, 0]) < 0.01)) for key, rows in found.items()}
    inside = {key: int(np.sum(np.abs(rows[:, 0]) < 2 * rows[:, 1])) for key, rows in found.items()}
    section.table(
        ['number', 'mean error, %', 'std of the errors, %', 'std as told, mean, %',
         f'within 1 %, of {DRAWS}', f'within two std, of {DRAWS}'],
        [
            [f'`{key}`', *(f'{100 * x:.3f}' for x in (
                rows[:, 0].mean(), rows[:, 0].std(), rows[:, 1].mean())), close[key], inside[key]]
            for key, rows in found.items()
        ],
    )  # fmt: skip
    for what, counts in (('1 %', close), ('two std', inside)):
        least = min(counts.values())
        section.goal(
            f"Fits of Exudyn's arm, 7 numbers: within {what}, of {DRAWS} noise draws",
            f'{least}', '90', least >= 90,
        )  # fmt: skip
    section.table(['model', 'strain1, fit %', 'strain2, fit %'], wrong_models(flight))
    return section


def wrong_models(flight: dict[str, Array]) -> list[list[str]]:
    """Return how well the right model and wrong ones fit one draw."""
    true = setting()
    data = measured(flight, true, 0)
    few = true.with_section('plant', replace(true.config.plant, modes=1))
    heavy = true.with_numbers({'plant.payload_mass': 1.5 * true.number('plant.payload_mass')})
    rows = []
    for name, start in (
        ('as it is', true), ('one mode of three per link', few),
        ('payload of 0.3 kg in place of 0.2 kg', heavy),
    ):  # fmt: skip
        channels = fitted(data, start).channels
        rows.append([name, *(f'{channels[f"strain{n}"].fit:.2f}' for n in (1, 2))])
    return rows
