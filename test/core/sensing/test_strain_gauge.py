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

"""Strain gauges: curvature, gain, offset, low-pass and noise, in every kind of run."""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
import re
from typing import Any

from armtools import ARM
from flexarm_ros import cli, scenario
from flexarm_ros.analysis.report.runs import load_run
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.control.pd import fuzzy_gain
from flexarm_ros.core.parameters.rig import StrainGaugeParameters
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, with_section
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.parts import check_parts, parts_of
from flexarm_ros.core.run.required_parts import ControllerPart
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.run.results.trajectory_rows import Rows
from flexarm_ros.core.sensing.gauge import gauge_shape
from flexarm_ros.core.sensing.lowpass import lowpass_step
from flexarm_ros.core.sensing.strain_gauge import STRAIN, StrainGaugePart
from flexarm_ros.identification.prediction.predict import predict
from flexarm_ros.identification.recording import read
from flexarm_ros.identification.setting import load_setting
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.stability.law import linear_law
from flexarm_ros.stability.modes import linearise
import numpy as np
import pytest
from scipy.linalg import expm

PERIOD = 1e-3


def at(place: float) -> StrainGaugeParameters:
    return StrainGaugeParameters(location=(place, place))


def exact_step(cutoff: float, damping: float, period: float) -> np.ndarray:
    """Return what `lowpass_step` does, by the matrix exponential."""
    omega = 2.0 * math.pi * cutoff
    system = np.zeros((4, 4))
    system[0, 1] = 1.0
    system[1, :3] = -omega * omega, -2.0 * damping * omega, omega * omega
    system[2, 3] = 1.0 / period
    step = expm(system * period)[:2]
    return np.column_stack([step[:, :2], step[:, 2] - step[:, 3], step[:, 3]])


@pytest.mark.parametrize('damping', [0.05, 0.7, 0.9999, 1.0, 1.0001, 1.3, 20.0])
@pytest.mark.parametrize('cutoff', [0.5, 40.0, 2000.0])
def test_the_low_pass_is_exact_between_samples(cutoff: float, damping: float) -> None:
    found, expected = lowpass_step(cutoff, damping, PERIOD), exact_step(cutoff, damping, PERIOD)
    scale = np.array([[1.0, 1.0 / (2.0 * math.pi * cutoff)]]).T * np.ones(4)
    scale[:, 1] *= 2.0 * math.pi * cutoff
    assert np.abs((found - expected) * scale).max() < 1e-11
    # A constant stays, a ramp is followed with its lag.
    assert found[:, 0] + found[:, 2:].sum(axis=1) == pytest.approx([1.0, 0.0], abs=1e-9)


@pytest.mark.parametrize('plant', [
    PlantParameters(modes=3),
    PlantParameters(model='full', modes=3, hub_radius=(0.1, 0.2), length=(4.0, 3.0)),
])  # fmt: skip
@pytest.mark.parametrize('link', [0, 1])
def test_a_gauge_measures_the_curvature_of_its_link(plant: PlantParameters, link: int) -> None:
    """Against second differences of the places of material points, for small coordinates."""
    step, place, small = 1e-3, 1.3, 1e-6
    root = plant.hub_radius[link] + (plant.spans[0] if link else 0.0)
    for mode in range(3):
        q = np.zeros(8)
        q[2 + 3 * link + mode] = small
        across = [
            make_point(plant, root + place + shift, elastic=True)(q, np.zeros(8))[1]
            for shift in (-step, 0.0, step)
        ]
        curvature = (across[0] - 2.0 * across[1] + across[2]) / step**2 / small
        found = gauge_shape(plant, at(place), link, 'strain')[mode]
        assert found == pytest.approx(curvature, rel=1e-4, abs=1e-4)


@pytest.mark.parametrize('place', [0.0, 0.11])
def test_an_end_force_is_read_as_its_deflection(place: float) -> None:
    plant = PlantParameters(model='full', basis='craig_bampton', length=(0.3, 0.2))
    deflection = gauge_shape(plant, at(place), 0, 'deflection')
    tip = make_point(plant, 0.3, elastic=True).shapes[0, :1]
    assert deflection == pytest.approx(tip, rel=1e-12)
    assert gauge_shape(plant, at(place), 0, 'angle') == pytest.approx(tip / 0.3, rel=1e-12)


def with_gauge(held: StrainGaugeParameters, **plant: Any) -> RunConfig:
    config = scenario.load('fls_tip', ['duration=0.4'])
    return with_section(config, 'strain_gauge', held)


def flown(config: RunConfig) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return stamps, readings and coordinates of a run."""
    loop, told, states = ClosedLoop(config), [], []
    place = loop.answers.places[STRAIN]
    while (record := loop.tick()) is not None:
        told.append(record.messages[place])
        states.append(record.q.copy())
    rows = np.array(told)
    return rows[:, 0], rows[:, 1:], np.array(states)


def test_gain_offset_slope_low_pass_and_latency() -> None:
    held = StrainGaugeParameters(
        output='angle', location=(0.2, 0.0), gain=(2.0, -0.5), offset=(0.01, 0.02),
        offset_slope=(0.1, -0.2), filter_cutoff=(5.0, 0.0), filter_damping=(0.6, 0.7),
    )  # fmt: skip
    config = with_gauge(held)
    stamps, found, q = flown(config)
    signals = [
        held.gain[i] * q[:, 2 + i] * gauge_shape(config.plant, held, i, 'angle')
        + held.offset[i] + held.offset_slope[i] * q[:, i]
        for i in (0, 1)
    ]  # fmt: skip
    assert found[:, 1] == pytest.approx(signals[1], rel=1e-12)
    step, state = exact_step(5.0, 0.6, PERIOD), np.array([signals[0][0], 0.0])
    expected = [state[0]]
    for before, after in zip(signals[0][:-1], signals[0][1:], strict=True):
        state = step @ [*state, before, after]
        expected.append(state[0])
    assert found[:, 0] == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert np.ptp(found[:, 0]) > 1e-4
    late_stamps, late, _ = flown(with_gauge(replace(held, latency=0.0025)))
    assert (stamps - late_stamps == 2_500_000).all()
    assert late[10:] == pytest.approx(0.5 * (found[7:-3] + found[8:-2]), rel=1e-12)


def test_noise_is_seeded_and_after_the_low_pass() -> None:
    quiet = StrainGaugeParameters(filter_cutoff=(1.0, 1.0))
    noisy = StrainGaugeParameters(filter_cutoff=(1.0, 1.0), noise_std=1e-4)
    errors = flown(with_gauge(noisy))[1] - flown(with_gauge(quiet))[1]
    assert 0.9e-4 < errors.std() < 1.1e-4
    assert abs(np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]) < 0.15
    assert abs(np.corrcoef(errors.T)[0, 1]) < 0.15


@pytest.mark.parametrize(
    ('held', 'text'),
    [
        (
            StrainGaugeParameters(location=(0.0, 4.6)),
            'strain_gauge.location: 4.6 m on link2, allowed with output strain: from 0, at most '
            '4.5 m (plant.length)',
        ),
        (
            StrainGaugeParameters(location=(4.5, 0.0), output='angle'),
            'strain_gauge.location: 4.5 m on link1, allowed with output angle: from 0, below 4.5',
        ),
    ],
)
def test_a_gauge_beside_its_link_is_refused(held: StrainGaugeParameters, text: str) -> None:
    with pytest.raises(ValueError, match=re.escape(text)):
        check_parts(with_gauge(held))


def test_a_gauge_without_a_signal_cannot_close_the_loop() -> None:
    for held, text in (
        (StrainGaugeParameters(gain=(1.0, 0.0)), 'strain_gauge.gain: 0.0 of link2'),
        (StrainGaugeParameters(location=(0.0, 4.5)), 'below 4.5 m'),
    ):
        check_parts(with_gauge(held))
        with pytest.raises(ValueError, match=re.escape(text)):
            check_parts(looped(held))


def looped(held: StrainGaugeParameters, **controller: Any) -> RunConfig:
    """Return a scenario whose law reads the gauges."""
    config = with_gauge(held)
    keys = replace(config.controller, deflection_source='strain_gauge', **controller)
    return replace(config, controller=keys)


@pytest.mark.parametrize('output', ['strain', 'deflection', 'angle'])
def test_the_fuzzy_law_reads_the_gauges(output: str) -> None:
    gain = (0.002, 0.003) if output == 'strain' else (1.0, 1.2)
    config = looped(StrainGaugeParameters(output=output, gain=gain, location=(0.4, 0.9)))
    loop, rows = ClosedLoop(config), Rows(config)
    table = np.concatenate([rows.table(block) for block in loop_blocks(loop)])
    record = ClosedLoop(config)
    place = record.answers.places[STRAIN]
    for k in range(len(table)):
        tick = record.tick()
        assert tick is not None
        readings = tick.messages[place][1:]
        known = gain if output == 'strain' else (1.0, 1.0)
        per = {'deflection': 1.0, 'angle': 4.5}
        bends = [
            reading / known[i] * per.get(output, 4.5**3 / 3.0 / (4.5 - place_m))
            for i, (reading, place_m) in enumerate(zip(readings, (0.4, 0.9), strict=True))
        ]
        assert tick.gain == pytest.approx(fuzzy_gain(config, *bends), rel=1e-12)
        assert table[k, COLUMNS.index('lambda')] == tick.gain
    plain = replace(config, controller=replace(config.controller, deflection_source='plant'))
    assert ClosedLoop(plain).tick() is not None


def test_the_source_of_the_deflections_must_exist() -> None:
    config = scenario.load('fls_tip')
    with pytest.raises(ScenarioError, match='the scenario has no section strain_gauge'):
        scenario.load('fls_tip', ['controller.deflection_source=strain_gauge'])
    assert 'strain_gauge/strain' not in ControllerPart.reads(config)
    assert ControllerPart.reads(looped(StrainGaugeParameters()))[-1] == STRAIN


def test_the_offset_of_a_gauge_is_in_the_gain_of_the_linear_loop() -> None:
    offset = StrainGaugeParameters(output='angle', offset=(0.1, 0.0), offset_slope=(0.0, 0.2))
    config = looped(offset)
    arm = linearise(config, 0.7)
    expected = 15.0 * fuzzy_gain(config, 0.1 * 4.5, 0.2 * 0.7 * 4.5)
    assert linear_law(config, arm).gain == pytest.approx(expected, rel=1e-12)
    exact = linear_law(scenario.load('fls_tip'), arm).gain
    assert exact == pytest.approx(15.0 * fuzzy_gain(config, 0.0, 0.0), rel=1e-12)
    filtered = looped(replace(offset, filter_cutoff=(2.0, 2.0)))
    assert linear_law(filtered, arm).gain == linear_law(config, arm).gain


def test_without_the_section_there_is_no_gauge() -> None:
    assert StrainGaugePart not in parts_of(scenario.load('fls_tip'))
    assert StrainGaugePart in parts_of(with_gauge(StrainGaugeParameters()))


def test_a_prediction_of_a_run_uses_the_same_gauge(tmp_path: Path) -> None:
    """The simulated sensor and the model of ``flexarm predict`` are one declaration."""
    path = tmp_path / 'arm.yaml'
    path.write_text(ARM)
    out = tmp_path / 'run'
    words = ['plant.initial_position=[0.3, 0.4]', 'trajectory.hold_position=[0.2, 0.4]']
    sets = [
        *words, 'strain_gauge.output=angle', 'strain_gauge.latency=0.003',
        'strain_gauge.location=[0.02, 0.0]',
        'strain_gauge.offset=[0.0, 0.0]', 'strain_gauge.offset_slope=[0.0, 0.0]',
        'controller.kp=20.0', 'controller.kd=2.0',
    ]  # fmt: skip
    overrides = [part for word in sets for part in ('--set', word)]
    assert cli.main(['simulate', str(path), *overrides, '--no-pictures', '--out', str(out)]) == 0
    assert cli.main(['verify', str(out)]) == 0
    columns = load_run(out).columns
    recording = read(out)
    assert (recording.channels['strain1'] == columns['strain1']).all()
    assert recording.strain_units == {'strain1': 'angle', 'strain2': 'angle'}
    found = predict(recording, load_setting(path, sets), window=0.5).numbers
    assert found['strain1']['fit'] > 99.5  # type: ignore[operator]
    assert found['strain2']['fit'] > 99.5  # type: ignore[operator]
