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

"""Measured arms: recordings, driven predictions, fits, and what they say of their uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import csv
import json
import math
from pathlib import Path
from typing import Any

from armtools import ARM, PERIOD
import flexarm_ros.cli as cli
from flexarm_ros.core.arm.full.plant import FullPlant
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.identification.estimate.fitting import fit, prepare
from flexarm_ros.identification.estimate.statistics import estimate
from flexarm_ros.identification.prediction.predict import predict
from flexarm_ros.identification.recording import channel_of, read, Recording
from flexarm_ros.identification.setting import load_setting
from flexarm_ros.scenario import ScenarioError
import numpy as np
import pytest
from scipy.signal import bilinear, lfilter, lfilter_zi

GAIN, OFFSET, SLOPE = (0.57, 0.88), (0.001, -0.002), (-0.004, 0.0)


@pytest.fixture(scope='module')
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('arm') / 'arm.yaml'
    path.write_text(ARM)
    return path


def flight(
    arm: Path, seconds: float = 4.0, overrides: Sequence[str] = ()
) -> dict[str, np.ndarray]:
    """Fly the plant itself with a joint PD law; return what ideal sensors read."""
    config = load_setting(arm, overrides).config
    plant, tip = FullPlant(config), make_point(config.plant, sum(config.plant.spans), elastic=True)
    rows = []
    for k in range(round(seconds / PERIOD)):
        t = k * PERIOD
        ends = plant.deflections()
        rows.append(
            [t, *plant.q[:2], ends[0] / 0.202, ends[1] / 0.20185, *tip(plant.q, plant.qd)[:2]]
        )
        goal = (0.4 if t % 2.0 < 1.0 else -0.4, 0.3 if (t + 0.5) % 1.6 < 0.8 else -0.3)
        torque = [
            gain * (goal[i] - plant.q[i]) - damp * plant.qd[i]
            for i, (gain, damp) in enumerate(((15.0, 3.0), (2.0, 0.15)))
        ]
        plant.step(*torque)
    names = ('t', 'theta1', 'theta2', 'angle1', 'angle2', 'tip_x', 'tip_y')
    return dict(zip(names, np.array(rows).T, strict=True))


@pytest.fixture(scope='module')
def ideal(arm: Path) -> dict[str, np.ndarray]:
    return flight(arm)


def gauged(ideal: dict[str, np.ndarray], noise: float = 0.0, seed: int = 0) -> dict[str, Any]:
    """Return the columns of a CSV: strains through gain, offset, slope and SciPy's low-pass."""
    random = np.random.default_rng(seed)
    omega = 2.0 * math.pi * 4.0
    low_pass = bilinear([omega**2], [1.0, 2 * 0.9 * omega, omega**2], fs=1 / PERIOD)
    columns = {'t_s': ideal['t']}
    for i in (0, 1):
        theta = ideal[f'theta{i + 1}']
        raw = GAIN[i] * ideal[f'angle{i + 1}'] + OFFSET[i] + SLOPE[i] * theta
        # In equilibrium at first: the program of a rig has run for a while.
        settled, _ = lfilter(*low_pass, raw, zi=raw[0] * lfilter_zi(*low_pass))
        strain = settled + noise * random.standard_normal(len(raw))
        columns[f'theta{i + 1}_deg'] = np.degrees(theta)
        columns[f'strain{i + 1}_rad'] = strain
    return columns


def written(path: Path, columns: dict[str, Any]) -> Path:
    with path.open('w', newline='') as file:
        table = csv.writer(file)
        table.writerow(columns)
        table.writerows(zip(*(map(float, values) for values in columns.values()), strict=True))
    return path


@pytest.fixture(scope='module')
def noisy(ideal: dict[str, np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp('data') / 'noisy.csv', gauged(ideal, 2e-4))


@pytest.mark.parametrize(
    ('column', 'expected'),
    [
        ('theta1_deg', ('theta1', math.pi / 180.0, 'angle')),
        ('theta2_reference_rad', ('theta2_reference', 1.0, 'angle')),
        ('theta1_rate_deg_s', ('theta1_rate', math.pi / 180.0, 'strain')),
        ('i1_ma', ('i1', 1e-3, 'strain')),
        ('tip_x_mm', ('tip_x', 1e-3, 'deflection')),
        ('strain1', ('strain1', 1.0, 'strain')),
        ('strain2_m', ('strain2', 1.0, 'deflection')),
        ('i1_command_a', None),
        ('theta_deg', None),
        ('theta3_deg', None),
        ('theta1', None),
        ('t1_s', None),
    ],
)
def test_a_column_has_its_unit_in_its_name(column: str, expected: Any) -> None:
    assert channel_of(column) == expected


def test_each_unused_column_is_told(tmp_path: Path, ideal: dict[str, np.ndarray]) -> None:
    columns = gauged(ideal)
    columns.update(temperature_c=ideal['t'], i1_command_a=ideal['t'])
    recording = read(written(tmp_path / 'x.csv', columns))
    assert recording.notes == (
        'column temperature_c is not used', 'column i1_command_a is not used',
    )  # fmt: skip
    assert recording.period == pytest.approx(PERIOD)


def break_time(lines: list[str]) -> list[str]:
    return [*lines[:5], lines[4], *lines[5:]]


@pytest.mark.parametrize(
    ('change', 'told'),
    [
        (lambda lines: [*lines[:3], lines[3].replace('0.', 'zero', 1), *lines[4:]], 'row 4'),
        (lambda lines: [*lines[:3], lines[3] + ',1', *lines[4:]], 'row 4'),
        (break_time, 'time does not increase'),
        (lambda lines: [lines[0].replace('t_s', 'time'), *lines[1:]], 'no column t_s'),
        (lambda lines: lines[:5], 'at least 20'),
        (lambda lines: [lines[0].replace('theta1_deg', 'theta2_rad'), *lines[1:]], 'two columns'),
        (lambda lines: [lines[0].replace('theta1_deg', 'a_deg'), *lines[1:]], 'no channel theta1'),
        (lambda lines: [*lines[:3], lines[3].replace('0.', 'nan,0.', 1), *lines[4:]], 'row 4'),
        (lambda lines: [*lines[:3], '1e9,' + ','.join(['1e200'] * 4)], 'at least 20'),
        (lambda lines: [*lines[:-1], '9.0,' + ','.join(['1e200'] * 4)], 'is the unit'),
        (lambda lines: [lines[0], *(',,,,' for _ in lines[1:])], 't: no row has a value'),
        (lambda lines: [*lines[:9], *(',,,,' for _ in lines[9:])], '8 complete rows'),
    ],
)
def test_bad_data_end_with_one_line(
    noisy: Path, arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    change: Callable[[list[str]], list[str]], told: str,
) -> None:  # fmt: skip
    path = tmp_path / 'bad.csv'
    path.write_text('\n'.join(change(noisy.read_text().splitlines())))
    assert cli.main(['predict', str(path), '--scenario', str(arm)]) == 2
    errors = [x for x in capsys.readouterr().err.splitlines() if 'is not used' not in x]
    assert len(errors) == 1
    assert told in errors[0]


def test_rows_without_a_value_are_left_out(
    tmp_path: Path, ideal: dict[str, np.ndarray], arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Empty cells and NaN, a channel without a value, text in a column that is not used."""
    names = list(gauged(ideal))
    rows = [list(map(repr, map(float, row))) for row in zip(*gauged(ideal).values(), strict=True)]
    for number, row in enumerate(rows):
        row[names.index('strain2_rad')] = ''
        row.append('run' if number % 2 else '')
    rows[100][names.index('strain1_rad')] = ''
    rows[200][names.index('theta1_deg')] = 'nan'
    path = tmp_path / 'x.csv'
    head = ','.join([*names, 'state']).replace('theta1_deg', 'Theta1_DEG')
    path.write_text('\n'.join([head, *map(','.join, rows)]))
    assert cli.main(['predict', str(path), '--scenario', str(arm), '--json']) == 0
    told = capsys.readouterr()
    assert 'rows without a value, left out: 2, the first is row 102' in told.err
    assert 'column state is not used' in told.err
    assert 'strain2: no row has a value: not used' in told.err
    channels = json.loads(told.out)['channels']
    assert set(channels) == {'strain1'}
    assert channels['strain1']['fit'] > 99.0


def test_a_gap_is_told(tmp_path: Path, ideal: dict[str, np.ndarray]) -> None:
    columns = {key: np.delete(values, slice(1000, 1400)) for key, values in gauged(ideal).items()}
    recording = read(written(tmp_path / 'x.csv', columns))
    assert recording.rows == len(ideal['t'])
    assert any('a gap of 0.802 s, 1.998 s after' in note for note in recording.notes)


def test_a_prediction_that_diverges_is_told(
    tmp_path: Path, ideal: dict[str, np.ndarray], arm: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = gauged(ideal)
    columns['theta1_deg'] = 1e6 * columns['theta1_deg']
    words = ['predict', str(written(tmp_path / 'x.csv', columns)), '--scenario', str(arm)]
    assert cli.main([*words, '--out', str(tmp_path / 'out')]) == 1
    assert (tmp_path / 'out' / 'prediction.html').is_file()
    assert 'strain1: the prediction diverges' in capsys.readouterr().err


def test_uneven_times_are_resampled(tmp_path: Path, ideal: dict[str, np.ndarray]) -> None:
    columns = {key: np.delete(values, [100, 101, 900]) for key, values in gauged(ideal).items()}
    recording = read(written(tmp_path / 'x.csv', columns))
    assert recording.rows == len(ideal['t'])
    assert any('resampled' in note for note in recording.notes)
    error = recording.channels['theta1'] - ideal['theta1']
    assert np.abs(error).max() < 1e-3


def test_the_driven_arm_is_the_plant(
    arm: Path, ideal: dict[str, np.ndarray], tmp_path: Path
) -> None:
    """The plant's own deflections, from its joint angles alone, without any observer."""
    recording = read(written(tmp_path / 'x.csv', gauged(ideal)))
    found = predict(recording, load_setting(arm)).numbers
    assert found['strain1']['fit'] > 99.7
    assert found['strain2']['fit'] > 99.7


def test_the_tip_of_the_driven_arm_is_the_plants(
    arm: Path, ideal: dict[str, np.ndarray], tmp_path: Path
) -> None:
    """From the joint angles alone: a recording with a camera on the tip and no gauges."""
    tip = {f'tip_{axis}_mm': 1e3 * ideal[f'tip_{axis}'] for axis in 'xy'}
    angles = {f'theta{i}_rad': ideal[f'theta{i}'] for i in (1, 2)}
    recording = read(written(tmp_path / 'x.csv', {'t_s': ideal['t'], **angles, **tip}))
    setting = load_setting(arm)
    found = predict(recording, setting)
    assert list(found.channels) == ['tip_x', 'tip_y']
    stiff = setting.with_numbers({'plant.flexural_rigidity.1': 1e3})
    rigid = predict(recording, stiff)
    for name in ('tip_x', 'tip_y'):
        assert found.channels[name].rms < 1e-4  # angles are linear between samples
        assert rigid.channels[name].rms > 1e-3
    assert found.channels['tip_y'].fit > 99.9
    # The loads of link 2 and payload also follow from the tip alone.
    keys = ('plant.flexural_rigidity', 'plant.link_end_mass')
    changed = ['plant.flexural_rigidity=[1.9, 0.2]', 'plant.link_end_mass=1.5']
    again = fitted(tmp_path / 'x.csv', arm, free=keys, overrides=changed, window=None)
    for key, row in again.parameters.items():
        assert row['value'] == pytest.approx(setting.number(key), rel=0.01)


def test_a_window_starts_from_the_past_alone(arm: Path, noisy: Path) -> None:
    recording = read(noisy)
    first = predict(recording, load_setting(arm), window=1.0)
    changed = dict(recording.channels)
    for name in ('strain1', 'strain2'):
        changed[name] = changed[name].copy()
        changed[name][501:] += 0.1  # the second window begins with sample 500
    other = Recording('x', PERIOD, changed, recording.strain_units)
    second = predict(other, load_setting(arm), window=1.0)
    for name, channel in first.channels.items():
        same = channel.predicted == second.channels[name].predicted
        assert same[:1000].all()
        assert not same[1000:].any()


def test_windows_recover_from_an_unknown_start(arm: Path, ideal: dict[str, np.ndarray]) -> None:
    """A recording that begins in motion: the observer finds the state from the gauges."""
    columns = {key: values[600:] for key, values in gauged(ideal).items()}
    channels = {key.partition('_')[0]: values for key, values in columns.items()}
    del channels['t']
    for name in ('theta1', 'theta2'):
        channels[name] = np.radians(channels[name])
    recording = Recording('x', PERIOD, channels, dict.fromkeys(('strain1', 'strain2'), 'angle'))
    whole = predict(recording, load_setting(arm)).channels['strain1']
    found = predict(recording, load_setting(arm), window=0.5).channels['strain1']
    late = slice(500, None)
    wrong = np.abs(whole.measured - whole.predicted)[late].max()
    assert np.abs(found.measured - found.predicted)[late].max() < 0.1 * wrong


def without_bias(ideal: dict[str, np.ndarray], held: int, late: int = 0) -> Recording:
    """
    Return what a program gives that subtracts the mean of its first samples, and filters.

    ``held``: number of samples at first, for which it gives 0; ``late``: latency in samples.
    """
    channels = {f'theta{i}': ideal[f'theta{i}'] for i in (1, 2)}
    omega = 2.0 * math.pi * 4.0
    low_pass = bilinear([omega**2], [1.0, 2 * 0.9 * omega, omega**2], fs=1 / PERIOD)
    for i in (0, 1):
        raw = GAIN[i] * ideal[f'angle{i + 1}'] + 0.3 + SLOPE[i] * ideal[f'theta{i + 1}']
        raw = np.where(ideal['t'] < held * PERIOD, 0.0, raw - raw[:held].mean())
        strain = lfilter(*low_pass, raw)
        channels[f'strain{i + 1}'] = np.concatenate([np.zeros(late), strain[: len(raw) - late]])
    return Recording('x', PERIOD, channels, dict.fromkeys(('strain1', 'strain2'), 'angle'))


def test_a_bias_that_was_removed_is_found_again(arm: Path, ideal: dict[str, np.ndarray]) -> None:
    held = 300
    recording = without_bias(ideal, held)
    plain = predict(recording, load_setting(arm)).numbers
    found = predict(recording, load_setting(arm), zero=1.0)
    for name in ('strain1', 'strain2'):
        assert found.numbers[name]['fit'] > 99.0
        assert plain[name]['fit'] < 98.0
        assert not found.channels[name].valid[:held].any()


def test_a_latency_is_found_where_a_gauge_begins_late(
    arm: Path, ideal: dict[str, np.ndarray]
) -> None:
    """The first sample that was measured moves with the latency; the samples compared do not."""
    request = prepare(
        [without_bias(ideal, 300, late=3)], arm, ['strain_gauge.latency'], window=None, zero=1.0,
        overrides=['strain_gauge.latency=0.0013'],
    )  # fmt: skip
    row = fit(request).parameters['strain_gauge.latency']
    assert row['value'] == pytest.approx(3 * PERIOD, rel=0.02)


@pytest.mark.parametrize('offset', [0.02, -0.02])
def test_an_offset_of_either_sign_is_taken_from_the_first_second(
    arm: Path, ideal: dict[str, np.ndarray], tmp_path: Path, offset: float
) -> None:
    """As large as the signals, and the program never subtracts it; its filter has run before."""
    columns = gauged(ideal)
    for name in ('strain1_rad', 'strain2_rad'):
        columns[name] = columns[name] + offset
    # The joints rest for a second at first.
    rest = {key: np.repeat(values[:1], 500) for key, values in columns.items()}
    columns = {key: np.concatenate([rest[key], values]) for key, values in columns.items()}
    columns['strain1_rad'][:500:2] += 1e-6  # not held
    columns['strain2_rad'][:500:2] += 1e-6
    columns['t_s'] = PERIOD * np.arange(len(columns['t_s']))
    recording = read(written(tmp_path / 'x.csv', columns))
    for window in (None, 1.0):
        found = predict(recording, load_setting(arm), window=window, zero=0.9).numbers
        assert found['strain1']['fit'] > 99.5
        assert found['strain2']['fit'] > 99.5


def test_a_recording_that_begins_in_motion_is_told(
    arm: Path, ideal: dict[str, np.ndarray], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its start is taken at rest, and offsets too: the fit is poor, and a line says why."""
    columns = gauged(ideal, 2e-4)
    begun = {
        name: values[520:] - values[520] * (name == 't_s') for name, values in columns.items()
    }
    told = []
    for name, data in (('still', columns), ('begun', begun)):
        path = written(tmp_path / f'{name}.csv', data)
        for options in (['--zero', '1'], ['--window', '1'], []):
            assert cli.main(['predict', str(path), '--scenario', str(arm), *options]) == 0
            told.append('begins in motion (theta1, ' in capsys.readouterr().err)
    assert told == [False, False, False, True, False, True]
    warnings = fitted(path, arm, free=['plant.link_end_mass'], window=None).warnings
    assert any('begun.csv: the recording begins in motion' in text for text in warnings)


FREE = ('plant.flexural_rigidity', 'plant.link_end_mass', 'strain_gauge.gain')


def fitted(data: Path, arm: Path, **changes: Any) -> Any:
    options: dict[str, Any] = {'free': FREE, 'window': 1.0, **changes}
    return fit(prepare([data], arm, **options))


def test_a_fit_finds_the_arm(arm: Path, noisy: Path) -> None:
    start = [
        'plant.flexural_rigidity=[1.9, 0.2]', 'plant.link_end_mass=1.5',
        'strain_gauge.gain=[0.5, 1.0]',
    ]  # fmt: skip
    found = fitted(noisy, arm, overrides=start, window=None, hold_out=['3.0:4.0'])
    true = load_setting(arm)
    assert found.complete
    for key, row in found.parameters.items():
        assert row['status'] == 'identified'
        assert row['value'] == pytest.approx(true.number(key), rel=0.003)
        assert 1e-5 < row['std'] / abs(row['value']) < 0.003
    assert found.held_out['strain1'].fit > 95.0
    assert not found.warnings


def test_what_the_data_cannot_tell_is_said(arm: Path, noisy: Path) -> None:
    """Joint inertia does not move a driven arm; of masses and stiffnesses only ratios count."""
    keys = (
        'plant.hub_inertia.1', 'plant.flexural_rigidity', 'plant.link_damping',
        'plant.mass_density', 'plant.link_end_mass', 'plant.payload_mass', 'strain_gauge.gain',
    )  # fmt: skip
    found = fitted(noisy, arm, free=keys, window=None)
    rows = found.parameters
    assert rows['plant.hub_inertia.1']['value'] == pytest.approx(0.0635)
    assert rows['plant.hub_inertia.1']['status'] == 'not identifiable'
    assert rows['plant.hub_inertia.1']['std'] is None
    assert rows['plant.flexural_rigidity.1']['status'] == 'not identifiable'
    assert rows['strain_gauge.gain.1']['status'] == 'identified'
    assert any('only ratios are determined' in text for text in found.warnings)


def test_one_trusted_mass_sets_the_scale(arm: Path, noisy: Path) -> None:
    keys = (*FREE, 'plant.payload_mass', 'plant.hub_inertia.2')
    priors = ['plant.payload_mass=0.157+-0.001', 'plant.hub_inertia.2=0.003+-0.0001']
    found = fitted(noisy, arm, free=keys, priors=priors, window=None)
    rows = found.parameters
    assert rows['plant.payload_mass']['status'] in ('prior', 'identified')
    assert rows['plant.hub_inertia.2']['status'] == 'prior'
    assert rows['plant.hub_inertia.2']['std'] == pytest.approx(0.0001)
    assert rows['plant.flexural_rigidity.1']['status'] == 'identified'
    assert not any('ratios' in text for text in found.warnings)


def correlated(random: np.random.Generator, rows: int) -> np.ndarray:
    """Return noise of std 1 with a correlation time of some 20 samples."""
    pole = 0.9
    noise = lfilter([math.sqrt(1 - pole**2)], [1.0, -pole], random.standard_normal(rows + 100))
    return np.asarray(noise[100:])


def test_correlated_residuals_count_less() -> None:
    """The std is that of the estimates over many draws, which independent samples would belie."""
    rows = 4000
    t = np.arange(rows)
    jacobian = np.stack([np.sin(t / 200.0), np.ones(rows)], axis=1)
    inverse = np.linalg.pinv(jacobian)
    random = np.random.default_rng(1)
    draws, told = [], []
    for _ in range(200):
        noise = correlated(random, rows)
        values = inverse @ noise
        draws.append(values)
        residual = noise - jacobian @ values
        told.append(
            estimate(values + 1.0, [(jacobian[None], residual[None])], np.full(2, np.inf)).std
        )
    spread = np.std(draws, axis=0)
    assert np.mean(told, axis=0) == pytest.approx(spread, rel=0.2)
    assert (spread > 3.0 * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))).all()


def test_noise_at_the_frequency_of_the_parameters_counts() -> None:
    """
    The std covers the errors although the fit takes noise out of the residuals.

    Rings at 2 Hz in noise of a 4 Hz low-pass, 6 s: what is left at 2 Hz after the fit is less than
    the noise was, so that a std from the residual times the sensitivities is too small.
    """
    t = np.arange(3000) * 0.002

    def rings(values: np.ndarray) -> np.ndarray:
        gain, frequency, damping = values
        omega, since = 2.0 * math.pi * frequency, t % 1.5
        return np.asarray(gain * np.exp(-damping * omega * since) * np.cos(omega * since))

    values = np.array([1.0, 2.0, 0.05])
    columns = [(rings(values + step) - rings(values - step)) / 2e-6 for step in 1e-6 * np.eye(3)]
    jacobian = np.stack(columns, axis=1)
    inverse = np.linalg.pinv(jacobian)
    omega = 2.0 * math.pi * 4.0
    low_pass = bilinear([omega**2], [1.0, 1.4 * omega, omega**2], fs=500.0)
    random = np.random.default_rng(2)
    errors, told = [], []
    for _ in range(200):
        noise = lfilter(*low_pass, 0.05 * random.standard_normal(len(t)))
        errors.append(inverse @ noise)
        residual = noise - jacobian @ errors[-1]
        told.append(estimate(values, [(jacobian[None], residual[None])], np.full(3, np.inf)).std)
    inside = np.abs(errors) < 2.0 * np.array(told)
    assert (inside.mean(axis=0) > 0.92).all()
    assert (np.mean(told, axis=0) < 1.25 * np.std(errors, axis=0)).all()


def test_a_stopped_fit_keeps_the_best_and_goes_on(arm: Path, noisy: Path, tmp_path: Path) -> None:
    options: dict[str, Any] = {
        'free': FREE, 'window': 1.0, 'overrides': ['plant.flexural_rigidity=[1.9, 0.2]'],
    }  # fmt: skip
    state = tmp_path / 'search.json'
    trials: list[float] = []

    def note(search: Any) -> None:
        trials.append(search.best_cost)

    part = fit(prepare([noisy], arm, **options), note, lambda: len(trials) > 20, state)
    assert not part.complete
    assert any('stopped' in text for text in part.warnings)
    best = json.loads(state.read_text())['best']
    assert best == {key: row['value'] for key, row in part.parameters.items()}
    whole = fit(prepare([noisy], arm, **options), state=state)
    assert whole.complete
    assert whole.parameters['plant.link_end_mass']['value'] == pytest.approx(1.8, rel=0.01)
    with pytest.raises(ScenarioError, match='belongs to another fit'):
        fit(prepare([noisy], arm, free=FREE, window=0.5), state=state)


def test_the_commands(
    arm: Path, noisy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    words = ['--free', 'plant.flexural_rigidity,strain_gauge.gain', '--window', '1']
    words += ['--set', 'plant.flexural_rigidity=[1.6, 0.24]']
    data = ['--scenario', str(arm), '--out', str(out), '--hold-out', str(noisy)]
    assert cli.main(['fit', str(noisy), *data, *words]) == 0
    told = capsys.readouterr()
    assert 'plant.flexural_rigidity.1' in told.out
    found = json.loads((out / 'fit.json').read_text())
    assert set(found) >= {'parameters', 'correlation', 'channels', 'hold_out', 'windows'}
    row = found['parameters']['plant.flexural_rigidity.1']
    assert set(row) == {'value', 'std', 'start', 'status'}
    assert row['start'] == 1.6
    assert set(found['channels']['strain1']) == {'fit', 'vaf', 'rms'}
    assert found['hold_out'].keys() == found['channels'].keys()
    page = (out / 'fit.html').read_text()
    assert 'plant.flexural_rigidity.1' in page
    assert page.count('data:image/png') == 2
    assert {path.name for path in (out / 'pictures').glob('*.svg')} == {
        'fitted_1.svg', 'held_out_1.svg',
    }  # fmt: skip
    fitted_arm = str(out / 'fitted.yaml')
    words = ['predict', str(noisy), '--scenario', fitted_arm, '--window', '1', '--json']
    assert cli.main(words) == 0
    channels = json.loads(capsys.readouterr().out)['channels']
    assert channels['strain1']['fit'] == pytest.approx(found['channels']['strain1']['fit'])
    out = tmp_path / 'predicted'
    assert cli.main(['predict', str(noisy), '--scenario', fitted_arm, '--out', str(out)]) == 0
    told = capsys.readouterr().out
    assert 'strain2' in told
    page = (out / 'prediction.html').read_text()
    assert page.count('data:image/png') == 1
    assert 'strain2' in page
    for name in ('prediction.html', 'pictures/prediction.png', 'pictures/prediction.svg'):
        assert (out / name).stat().st_size
        assert f'{out / name}\n' in told
    assert cli.main(['predict', str(noisy), '--scenario', fitted_arm, '--out', str(out)]) == 2
    assert 'exists already' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('words', 'told'),
    [
        (['--free', 'plant.rigidity'], 'plant.rigidity: unknown key'),
        (['--free', 'plant.model'], 'plant.model: cannot be estimated'),
        (['--free', 'plant.link_end_mass.1'], 'cannot be estimated'),
        (['--free', 'plant.flexural_rigidity,plant.flexural_rigidity.1'], 'twice'),
        (['--free', ','], 'at least one key'),
        (['--free', 'plant.payload_mass', '--prior', 'plant.payload_mass=0.1'], '+-STD'),
        (['--free', 'plant.payload_mass', '--prior', 'plant.link_end_mass=1+-1'], 'not free'),
        (['--free', 'plant.payload_mass', '--prior', 'plant.payload_mass=-1+-1'], 'out of range'),
        (['--free', 'plant.payload_mass', '--hold-out', '3:1'], 'T0 < T1'),
        (['--free', 'plant.payload_mass', '--hold-out', '0:100'], 'nothing to fit'),
        (['--free', 'plant.payload_mass', '--set', 'plant.model=eq14'], 'plant.model'),
    ],
)
def test_bad_requests_end_with_one_line(
    noisy: Path, arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str],
    words: list[str], told: str,
) -> None:  # fmt: skip
    base = ['fit', str(noisy), '--scenario', str(arm), '--out', str(tmp_path / 'out')]
    assert cli.main([*base, *words]) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert told in errors[0]


def test_a_real_arm_is_predicted(real: Path, tmp_path: Path) -> None:
    """Fitted on one recording of an arm, the model predicts another one, which it has not seen."""
    arm = tmp_path / 'arm.yaml'
    arm.write_text(ARM.replace('[4.0, 4.0]', '[2.0, 2.0]'))
    keys = (*FREE, 'plant.link_damping.1', 'strain_gauge.offset_slope.1')
    found = fitted(real / 'fsf.csv', arm, free=keys, window=2.0, zero=1.0)
    recording = read(real / 'psf.csv')
    for window, least in ((1.0, 92.0), (2.0, 90.0), (5.0, 85.0)):
        numbers = predict(recording, found.setting, window=window, zero=1.0).numbers
        assert numbers['strain1']['fit'] > least
        assert numbers['strain2']['fit'] > least


def test_the_std_is_that_of_the_estimates(
    arm: Path, ideal: dict[str, np.ndarray], tmp_path: Path
) -> None:
    """Noise of a tenth of the signals: most estimates within two std, and within 1 % or so."""
    true, inside, errors = load_setting(arm), [], []
    for seed in range(8):
        data = written(tmp_path / f'{seed}.csv', gauged(ideal, 4e-3, seed))
        for key, row in fitted(data, arm, window=None).parameters.items():
            error = row['value'] - true.number(key)
            inside.append(abs(error) < 2.0 * row['std'])
            errors.append(abs(error / true.number(key)))
    assert np.mean(inside) >= 0.85
    assert max(errors) < 0.015


def test_a_missing_mode_is_seen_in_the_residuals(arm: Path) -> None:
    """An arm of three modes a link and a model of one: fits are far from the noise."""
    more = ['plant.modes=3', 'plant.basis=arm_modes']
    plant_rows = flight(arm, 3.0, more)
    channels = {name: plant_rows[name] for name in ('theta1', 'theta2')}
    channels.update({f'strain{i}': plant_rows[f'angle{i}'] for i in (1, 2)})
    recording = Recording('x', PERIOD, channels, dict.fromkeys(('strain1', 'strain2'), 'angle'))
    plain = [
        'strain_gauge.gain=[1.0, 1.0]', 'strain_gauge.offset=[0.0, 0.0]',
        'strain_gauge.offset_slope=[0.0, 0.0]', 'strain_gauge.filter_cutoff=[0.0, 0.0]',
    ]  # fmt: skip
    few = predict(recording, load_setting(arm, plain)).numbers
    right = predict(recording, load_setting(arm, [*plain, *more])).numbers
    assert right['strain2']['fit'] > 95.0 > 85.0 > few['strain2']['fit']
