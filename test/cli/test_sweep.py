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

"""``flexarm sweep``: the same table from any number of workers, cut off or not."""

from __future__ import annotations

from collections.abc import Sequence
import csv
import json
import math
import os
from pathlib import Path
import re
import shutil
import signal
import subprocess
import sys
import time

from flexarm_ros import scenario
from flexarm_ros.analysis.sweep import engine as sweep_engine
from flexarm_ros.analysis.sweep import pictures as sweep_pictures
from flexarm_ros.analysis.sweep import worker as sweep_worker
from flexarm_ros.analysis.sweep.pictures import write_pictures
from flexarm_ros.analysis.sweep.store import make_table, StoreError, SweepStore
from flexarm_ros.analysis.sweep_linear import (
    analyse_grid,
    BEST,
    growth_rates,
    Linear,
    linear_table,
    WORST,
)
import flexarm_ros.cli as cli
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.scenario.sweeps import sweep as sweeps
import pytest
from sweeptools import die

SWEEP = """
# Latency and hub inertia, with one value that does not fit
scenario: [fls_tip, pd_tip]
set:
  duration: 0.4
  trajectory.kind: waypoints
  trajectory.waypoint_times: [0.0, 0.1, 0.2, 0.3]
  trajectory.waypoint_x: [6.0, 6.3, 6.3, 6.0]
  trajectory.waypoint_y: [0.0, 0.0, 0.3, 0.3]
grid:
  tip_sensor.latency: [0.0, 0.0312]
  tip_sensor.location: [9.0, 9.5]
draw: {count: 2, seed: 3, parameters: {plant.flexural_rigidity: {factor: [0.9, 1.1]}}}
"""
COUNT = 2 * 2 * 2 * 2


@pytest.fixture
def file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'small.yaml'
    path.write_text(SWEEP)
    return path


def sweep(*words: str) -> int:
    return cli.main(['sweep', *words, '--no-pictures'])


def table(directory: Path) -> list[dict[str, str]]:
    with open(directory / 'table.csv', newline='') as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope='module')
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run the sweep as one worker computes it, in a directory ``out`` of its own."""
    directory = tmp_path_factory.mktemp('sweep')
    (directory / 'small.yaml').write_text(SWEEP)
    out = directory / 'out'
    assert sweep(str(directory / 'small.yaml'), '--out', str(out), '--workers', '1') == 0
    return out


def test_every_run_is_a_row_those_that_do_not_fit_too(finished: Path) -> None:
    rows = table(finished)
    assert [int(row['index']) for row in rows] == list(range(COUNT))
    outcomes = [row['outcome'] for row in rows]
    assert outcomes.count('invalid') == COUNT // 2
    assert outcomes.count('stable') >= 2
    for row in rows:
        if row['outcome'] == 'invalid':
            assert 'tip_sensor.location: 9.5' in row['error']
            assert row['max_error'] == row['stable'] == ''
        else:
            assert float(row['max_error']) > 0.0


def test_the_numbers_are_those_of_simulate(file: Path, finished: Path) -> None:
    row = table(finished)[0]
    made = sweeps.load(file)
    Path('one.yaml').write_text(scenario.dump(made.bases[0]))
    words = [word for text in made.case(0).overrides for word in ('--set', text)]
    assert cli.main(['simulate', 'one.yaml', *words, '--out', 'one', '--no-pictures']) == 0
    summary = json.loads(Path('one/summary.json').read_text())
    for name in ('rms_error', 'max_error', 'tip_max_error', 'max_deflection', 'max_torque'):
        assert float(row[name]) == summary[name]
    assert [float(row[f'overshoot[{i}]']) for i in range(3)] == summary['overshoot']


def test_results_do_not_depend_on_the_number_of_workers(file: Path, finished: Path) -> None:
    assert sweep(str(file), '--out', 'three', '--workers', '3') == 0
    assert Path('three/table.csv').read_bytes() == (finished / 'table.csv').read_bytes()


def test_a_sweep_that_was_cut_off_goes_on(
    file: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished, 'out')
    # As if killed in the middle of writing a row.
    lines = Path('out/rows.jsonl').read_bytes().splitlines(keepends=True)
    Path('out/rows.jsonl').write_bytes(b''.join(lines[:-2]) + lines[-2][:20])
    Path('out/table.csv').unlink()
    assert sweep(str(file), '--out', 'out', '--workers', '1') == 0
    shown = capsys.readouterr()
    assert f'{COUNT - 2} of {COUNT} runs have results already' in shown.err
    assert f'{COUNT} of {COUNT} runs: ' in shown.out
    assert re.search(r'^flexarm sweep: \d+ runs in \S+ s, \S+ a second$', shown.err, re.M)
    assert Path('out/table.csv').read_bytes() == (finished / 'table.csv').read_bytes()
    assert len(Path('out/rows.jsonl').read_bytes().splitlines()) == COUNT


def test_a_directory_is_for_one_sweep_only(
    file: Path, finished: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished, 'out')
    before = Path('out/rows.jsonl').read_bytes()
    file.write_text(SWEEP.replace('seed: 3', 'seed: 4'))
    assert sweep(str(file), '--out', 'out') == 2
    assert 'another sweep' in capsys.readouterr().err
    assert Path('out/rows.jsonl').read_bytes() == before
    Path('taken').mkdir()
    Path('taken/file').touch()
    assert sweep(str(file), '--out', 'taken') == 2
    with (
        SweepStore(Path('held'), sweeps.load(file)),
        pytest.raises(StoreError, match='another sweep is writing'),
        SweepStore(Path('held'), sweeps.load(file)),
    ):
        pass


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGHUP])
def test_a_signal_leaves_the_rows_and_says_how_to_go_on(number: int, file: Path) -> None:
    file.write_text(SWEEP.replace('duration: 0.4', 'duration: 4.0').replace('[9.0, 9.5]', '[9.0]'))
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'sweep', str(file), '--out', 'out',
         '--workers', '1'], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True,
        start_new_session=True,
    )  # fmt: skip
    rows = Path('out/rows.jsonl')
    deadline = time.monotonic() + 60.0
    while not (rows.exists() and rows.read_bytes().count(b'\n') >= 2):
        assert process.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.killpg(process.pid, number)  # a terminal sends it to the whole group
    _, errors = process.communicate(timeout=60)
    assert process.returncode == 128 + number
    assert '--out out` continues' in errors
    assert 'Traceback' not in errors
    assert 2 <= len(table(Path('out'))) < COUNT // 2


def broken(bases: Sequence[RunConfig], task: sweep_worker.Task) -> None:
    raise ArithmeticError('two\nlines')


def test_a_run_that_kills_its_process_is_a_row(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sweep_engine, 'run_tasks', die)
    made = sweeps.load(file)
    cases = [made.case(index) for index in range(5)]
    tasks = [(case.index, case.base, case.overrides) for case in cases]
    rows = list(sweep_engine.LocalPool(made.bases, 2).rows(tasks, lambda: False))
    assert sorted(row['index'] for row in rows) == list(range(5))
    assert [row['index'] for row in rows if row['outcome'] == 'crashed'] == [3]


def test_an_error_within_a_run_is_a_row(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sweep_worker, 'simulate_row', broken)
    row = sweep_worker.run_task([scenario.load('pd_tip')], (7, 0, ()))
    assert row == {'index': 7, 'outcome': 'failed', 'error': 'ArithmeticError: two lines'}


def test_pictures_have_a_map_for_each_scenario(file: Path, finished: Path) -> None:
    shutil.copytree(finished, 'out')
    assert cli.main(['sweep', str(file), '--out', 'out']) == 0
    names = sorted(path.name for path in Path('out/pictures').iterdir())
    assert names == [
        f'max_error_{name}.{kind}' for name in ('fls_tip', 'pd_tip') for kind in ('png', 'svg')
    ]


def test_a_curve_is_drawn_over_a_single_axis(file: Path) -> None:
    file.write_text('{scenario: pd_tip, grid: {controller.kp: [100, 150, 200]}}')
    made = sweeps.load(file)
    rows = {
        i: {'index': i, 'outcome': 'stable', 'stable': i != 2, 'max_error': 0.1 * i}
        for i in range(3)
    }
    paths = write_pictures(made, make_table(made, rows), Path('out'))
    assert [path.name for path in paths] == ['max_error_pd_tip.png', 'max_error_pd_tip.svg']


def test_a_missing_scheduler_is_one_line(file: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert sweep(str(file), '--out', 'out', '--scheduler', 'tcp://127.0.0.1:1') == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert '--scheduler' in lines[0]


def test_a_dask_cluster_of_two_processes_gives_the_same_table(file: Path, finished: Path) -> None:
    distributed = pytest.importorskip('distributed', reason="needs the extra 'dask'")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster:
        assert sweep(str(file), '--out', 'there', '--scheduler', cluster.scheduler_address) == 0
    assert Path('there/table.csv').read_bytes() == (finished / 'table.csv').read_bytes()


def test_the_table_is_written_as_parquet_where_that_can_be(finished: Path) -> None:
    parquet = pytest.importorskip('pyarrow.parquet', reason="needs the extra 'parquet'")
    read = parquet.read_table(finished / 'table.parquet').to_pylist()
    assert [row['index'] for row in read] == list(range(COUNT))
    first = table(finished)[0]
    assert read[0]['max_error'] == float(first['max_error'])


def analysed(text: str) -> tuple[sweeps.Sweep, Linear]:
    made = sweeps.from_text(text, 'map', Path('.'))
    linear = analyse_grid(made, 2, lambda: False)
    assert linear is not None
    return made, linear


MAP = """
scenario: [pd_tip, fls_tip]
set: {duration: 16.0}
grid:
  tip_sensor.location: [9.0, 6.75]
  tip_sensor.latency: [0.0, 0.02, 0.001]
draw: {count: 3, parameters: {controller.kd: {factor: [0.1, 0.2]}}}
"""


def test_the_linear_boundary_is_that_of_the_stability_command() -> None:
    made, linear = analysed(MAP)
    assert linear.reasons() == [] and len(linear.rates) == made.points == 12
    # docs/stability.md: crossing delays, ms, at the worst and at the best pose, 9 m and 6.75 m.
    expected = {
        (0, WORST): 6.84, (0, BEST): 13.0, (3, WORST): 13.5,
        (6, WORST): 2.55, (6, BEST): 5.16, (9, WORST): 5.0, (9, BEST): 13.1,
    }  # fmt: skip
    for (place, which), crossing in expected.items():
        part = linear.crossings[which][place + 1, place + 2]  # from 20 ms to 1 ms
        assert 20.0 - 19.0 * part == pytest.approx(crossing, abs=0.1)
    assert (4, 5) not in linear.crossings[BEST]  # 6.75 m: stable up to 30 ms at the best pose
    rates = linear_table(made, linear)['worst_rate']
    assert [rate > 0.0 for rate in rates] == [False, True, False] * 4
    assert linear.ignored == ()


def test_a_tied_parameter_follows_and_what_is_left_out_is_named() -> None:
    text = """
scenario: pd_tip
set: {controller.torque_limit: 500.0}
grid: {plant.hub_inertia: [8, [8, 9]], tip_sensor.latency: [0.0, 0.02]}
tie: {trajectory.delay: tip_sensor.latency}
"""
    made, linear = analysed(text)
    assert made.point(3)[1][-1] == 'trajectory.delay=0.02'
    assert linear.ignored == ('controller.torque_limit', 'trajectory.delay')
    assert len(linear.crossings[WORST]) == 2


@pytest.mark.parametrize(
    ('scenario_name', 'reason'),
    [
        ('open_loop', 'open_loop has no linear form'),
        ('pd_tip', r'tip_sensor.latency: above 0.1 s'),
    ],
)
def test_why_there_is_no_linear_boundary_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    scenario_name: str, reason: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path('map.yaml').write_text(
        f'{{scenario: {scenario_name}, set: {{duration: 0.02}}, '
        'grid: {plant.hub_inertia: [8, 9], tip_sensor.latency: [0.2, 0.3]}}'
    )
    drawn = []
    monkeypatch.setattr(
        sweep_pictures, 'save', lambda figure, out, stem: drawn.append(figure) or []
    )
    assert cli.main(['sweep', 'map.yaml', '--out', 'out']) == 0
    shown = capsys.readouterr()
    assert reason in shown.err and 'no linear boundary' in shown.err
    assert '(stable: reached the end of its run)' in shown.out
    with open('out/linear.csv', newline='') as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 4 and all(reason in row['note'] for row in rows)
    said = [legend.get_title().get_text() for legend in drawn[0].legends]
    assert reason in said[0]


def test_a_law_whose_gains_change_with_the_time_has_no_boundary() -> None:
    with pytest.raises(ValueError, match='lqg has gains that change with the time'):
        growth_rates(scenario.load('lqg_smooth'))


def test_the_picture_tells_what_was_survived_from_what_is_stable(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made, linear = analysed(MAP)
    rows = {
        i: {'index': i, 'outcome': 'stable', 'stable': True, 'max_error': 0.1}
        for i in range(made.count)
    }
    drawn = []
    monkeypatch.setattr(
        sweep_pictures, 'save', lambda figure, out, stem: drawn.append(figure) or []
    )
    write_pictures(made, make_table(made, rows), tmp_path, linear)
    assert len(drawn) == 2
    labels = [text.get_text() for text in drawn[0].legends[0].get_texts()]
    assert 'simulated: half of the runs complete' in labels
    assert 'linear, at rest: boundary at the worst pose' in labels
    pieces = [
        line.get_xydata() for line in drawn[1].axes[0].lines
        if line.get_linestyle() == '-' and len(line.get_xydata()) == 2
    ]  # fmt: skip
    ends = {tuple(map(float, end)) for piece in pieces for end in piece}
    assert {round(x, 2) for x, _ in ends} == {6.75, 9.0}  # `pd_tip`, in order of name the second
    assert any(math.isclose(y, 0.00684, abs_tol=1e-4) for x, y in ends if x == 9.0)
