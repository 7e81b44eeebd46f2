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

"""Runs from Python: the same numbers as the command's, in the forms that others take."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
import re
import subprocess
import sys

import flexarm_ros as fa
from flexarm_ros.analysis.report.runs import RunError
from flexarm_ros.bag.errors import BagExistsError
from flexarm_ros.core.run.results.columns import ROW_COLUMNS
import numpy as np
import pytest
from report_cases import fly

SHORT = {'duration': 0.3}


@pytest.fixture(scope='module')
def run() -> fa.Run:
    return fa.simulate('fls_tip', plant={'hub_inertia': [10, 10]}, **SHORT)


def test_importing_the_package_loads_nothing() -> None:
    code = (
        'import sys, flexarm_ros\n'
        "print([name for name in ('numpy', 'matplotlib', 'rclpy', 'flexarm_ros.core')"
        ' if name in sys.modules])\n'
        'print(set(flexarm_ros.__all__) <= set(dir(flexarm_ros)))'
    )
    told = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert told.stdout.split('\n')[:2] == ['[]', 'True']


def test_every_name_of_the_api_is_there_and_described() -> None:
    for name in fa.__all__:
        if name == 'FlexArmEnv':
            pytest.importorskip('gymnasium', reason="pip install 'flexarm_ros[gymnasium]'")
        told = inspect.getdoc(getattr(fa, name)) or ''
        assert told, name
        if name != 'ScenarioError' and name != 'Run':
            parameters = inspect.signature(getattr(fa, name)).parameters
            unsaid = [p for p in parameters if not re.search(rf'\b{p}\b', told)]
            assert unsaid == [], name
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        fa.simulat  # noqa: B018


def test_numbers_are_those_of_the_command(run: fa.Run, tmp_path: Path) -> None:
    flown = fly(tmp_path / 'run', 'fls_tip', 'plant.hub_inertia=[10, 10]', 'duration=0.3')
    read = fa.load(flown)
    assert run.trajectory.tobytes() == read.trajectory.tobytes()
    kept = {'name', 'wall_s', 'rtf', 'versions'}
    written = json.loads((flown / 'summary.json').read_text('utf-8'))
    assert {k: v for k, v in run.summary.items() if k not in kept} == {
        k: v for k, v in written.items() if k not in kept
    }
    assert (run.name, run.stable, read.directory) == ('fls_tip', True, flown.resolve())


def test_out_writes_a_run_that_can_be_loaded(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    run = fa.simulate('pd_tip', duration=0.05, out=out)
    assert sorted(path.name for path in out.iterdir()) == [
        'bag', 'summary.json', 'trajectory.csv'
    ]  # fmt: skip
    assert fa.load(out / 'bag').trajectory.tobytes() == run.trajectory.tobytes()
    with pytest.raises(BagExistsError):
        fa.simulate('pd_tip', duration=0.05, out=out)
    with pytest.raises(RunError, match='is not a run'):
        fa.load(tmp_path)


def test_forms_of_the_rows(run: fa.Run) -> None:
    whole = run.to_numpy()
    assert whole.shape == (300, len(ROW_COLUMNS))
    for library in ('pandas', 'xarray'):
        pytest.importorskip(library, reason="pip install 'flexarm_ros[notebook]'")
    frame, dataset = run.to_pandas(), run.to_xarray()
    for i, (name, unit, meaning, _) in enumerate(ROW_COLUMNS):
        column = run.trajectory[name]
        assert np.array_equal(whole[:, i], column)
        assert np.array_equal(dataset[name], column)
        assert dataset[name].attrs == {'units': unit, 'long_name': meaning}
        assert np.array_equal(frame.index if name == 't' else frame[name], column)
    assert frame.attrs['units']['theta1'] == 'rad'
    with pytest.raises(ValueError, match='read-only'):
        run.trajectory['t'][0] = 1.0


def test_columns_of_optional_parts_have_their_units() -> None:
    for library in ('pandas', 'xarray'):
        pytest.importorskip(library, reason="pip install 'flexarm_ros[notebook]'")
    run = fa.simulate('pd_tip', duration=0.02, imu={'rate': 0.0})
    assert run.to_pandas().attrs['units']['imu_gyro_z'] == 'rad/s'
    assert run.to_xarray()['imu_accel_x'].attrs['units'] == 'm/s^2'


def test_a_run_shows_itself(run: fa.Run) -> None:
    assert repr(run).startswith('<Run fls_tip: 300 ticks, stable=True, rms_error=0.')
    assert 'rms_error' in run._repr_html_()


def test_optional_parts_are_plotted_where_a_run_has_them(run: fa.Run) -> None:
    with pytest.raises(ValueError, match='no optional part of the runs has a column'):
        run.plot('parts')
    figure = fa.simulate('pd_tip', duration=0.02, imu={'rate': 0.0}).plot('parts')
    assert [axis.get_ylabel() for axis in figure.axes][0] == 'imu_gyro_z, rad/s'


@pytest.mark.parametrize('kind', ['paths', 'signals', 'fls'])
def test_plots(run: fa.Run, kind: str) -> None:
    figure = run.plot(kind)
    assert figure.axes
    assert figure._repr_png_().startswith(b'\x89PNG')


def test_plots_that_cannot_be(run: fa.Run) -> None:
    with pytest.raises(ValueError, match="kind: 'path', allowed: paths, corners"):
        run.plot('path')
    with pytest.raises(ValueError, match='never switches'):
        run.plot('corners')
    with pytest.raises(ValueError, match='no run has controller.law: fls'):
        fa.simulate('pd_tip', duration=0.01).plot('fls')
    with pytest.raises(ValueError, match='none given'):
        fa.plot([])


def test_a_report_of_runs_that_have_no_files(run: fa.Run, tmp_path: Path) -> None:
    other = fa.simulate('pd_tip', **SHORT)
    page = fa.report([run, other], tmp_path / 'page.html')
    text = page.read_text('utf-8')
    assert 'fls_tip' in text and 'pd_tip' in text and run.report(page) == page


def test_an_unstable_run_is_returned() -> None:
    run = fa.simulate('fls_tip_physical', duration=4.0)
    assert run.stable is False
    assert 'unstable' in run.summary['problem']
    assert len(run.trajectory) == run.summary['ticks'] < 4000


def test_configure_takes_names_files_maps_and_configs(tmp_path: Path) -> None:
    config = fa.configure('pd_tip', duration=2.0, seed=3, plant={'length': np.array([4.5, 3.0]),
                          'payload_mass': np.float64(1.0)}, tip_sensor={'location': 7.5},
                          trajectory={'side': 6.0})  # fmt: skip
    assert (config.run.duration, config.run.seed, config.plant.length) == (2.0, 3, (4.5, 3.0))
    again = fa.configure(config, controller={'kp': 80})
    assert (again.controller.kp, again.plant.payload_mass) == (80.0, 1.0)
    assert fa.configure(fa.simulate(config, duration=0.01).scenario, duration=2.0) == config
    nested = {'law': 'passive', 'joint': {'kp': np.float64(80)}}
    dotted = {'law': 'passive', 'joint.kp': 80.0}
    for base in ('pd_tip', fa.simulate('pd_tip', duration=0.01).scenario):
        assert fa.configure(base, controller=nested) == fa.configure(base, controller=dotted)
    file = tmp_path / 'mine.yaml'
    file.write_text('plant:\n  ros__parameters:\n    payload_mass: 0.5\n', 'utf-8')
    assert fa.configure(file, run={'duration': 1}).plant.payload_mass == 0.5
    assert fa.simulate(file, duration=0.01).name == 'mine'


def test_torques_are_flown_open_loop() -> None:
    rows = [(0.0, 2.0, -1.0), (0.1, 2.0, -1.0), (0.1, 0.0, 0.0)]
    start = {'initial_position': [0.0, 0.5]}
    for scenario in ('fls_tip', fa.configure('pd_tip')):
        run = fa.simulate(scenario, torques=np.array(rows), plant=start, duration=0.2)
        assert run.trajectory['tau1'].tolist() == [2.0] * 100 + [0.0] * 100
        assert run.trajectory['tau2'][0] == -1.0
    kept = fa.configure(fa.configure('fls_tip', torques=rows), duration=0.2, plant=start)
    assert kept.torques == tuple(rows)


@pytest.mark.parametrize(
    ('changes', 'text'),
    [
        ({'plant': {'lenght': [1, 1]}}, 'plant.lenght: unknown key'),
        ({'plant': {'length': [1, -1]}}, 'plant.length'),
        ({'duration': -1.0}, 'duration'),
        ({'duration': 0.0005}, 'duration: 0.0005 s is not a whole number of ticks'),
        ({'plant': 3}, 'plant: 3 is not a map of keys'),
        ({'run': {'nonsense': 1}}, 'nonsense: unknown key'),
        (
            {'torques': [1.0, 2.0]},
            r'torques: \[1.0, 2.0\], allowed: rows t, tau1, tau2 .*\(n, 3\)',
        ),
        ({'torques': []}, r'torques: \[\], allowed: rows t, tau1, tau2'),
        ({'torques': [(0.0, float('nan'), 1.0)]}, r'torques: .*nan.*, allowed: .* finite numbers'),
        ({'torques': [(0.0, 1.0)]}, r'torques: \[\(0.0, 1.0\)\], allowed: rows'),
    ],
)
def test_bad_values_are_named(changes: dict[str, object], text: str) -> None:
    with pytest.raises(fa.ScenarioError, match=text) as caught:
        fa.simulate('fls_tip', **changes)
    assert '\n' not in str(caught.value)


def test_a_scenario_that_is_not_there_is_named() -> None:
    with pytest.raises(fa.ScenarioError, match="did you mean 'fls_tip'"):
        fa.simulate('fls_tipp')


@pytest.mark.parametrize(
    ('code', 'extra'),
    [
        ("fa.simulate('pd_tip', duration=0.01).to_pandas()", 'pandas'),
        ("fa.simulate('pd_tip', duration=0.01).to_xarray()", 'xarray'),
        ("fa.linearize('pd_tip')", 'control'),
        ('fa.FlexArmEnv()', 'gymnasium'),
    ],
)
def test_a_missing_library_is_named_with_its_extra(
    monkeypatch: pytest.MonkeyPatch, code: str, extra: str
) -> None:
    for name in ('flexarm_ros.api.environment', *(m for m in sys.modules if m.startswith(extra))):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, extra, None)
    monkeypatch.delitem(fa.__dict__, 'FlexArmEnv', raising=False)
    with pytest.raises(ImportError, match=rf'{extra} is not installed; .*flexarm_ros\[{extra}\]'):
        eval(code, {'fa': fa})
