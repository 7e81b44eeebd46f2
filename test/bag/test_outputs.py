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

"""Files beside the bag, exports and comparisons."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

from bagtools import small_config, small_messages, write_small
from flexarm_ros.bag import outputs
from flexarm_ros.bag.checks.compare import compare
from flexarm_ros.bag.embedded_metadata import bag_config
from flexarm_ros.bag.errors import BagError, BagExistsError
from flexarm_ros.bag.outputs import unfinished_summary, write_summary
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.bag.tables.export import export, NO_PYARROW
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.cli import main
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import BLOCK_TICKS, loop_blocks
from flexarm_ros.core.run.results.metric_list import METRICS, NAMES
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.wire.topics import COMMAND, per_tick_topics, STATE
import numpy as np
import pytest
from scipy.io import loadmat

HEADER = (
    't,theta1,theta2,dtheta1,dtheta2,delta1,delta2,elbow_x,elbow_y,tip_x,tip_y,rigid_x,rigid_y,'
    'meas_x,meas_y,ref_x,ref_y,tau1,tau2,lambda'
)
SUMMARY_KEYS = {
    'stable', 'rms_error', 'max_error', 'tip_rms_error', 'tip_max_error', 'overshoot',
    'max_overshoot', 'tip_overshoot', 'max_deflection', 'max_torque', 'ticks', 'wall_s', 'rtf',
    'versions', 'scenario', 'complete',
}  # fmt: skip
CONFIG = small_config('trajectory.delay=0.01', duration=0.6)


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('outputs') / 'run'
    simulate(CONFIG, directory, 'mine')
    return directory


def columns(path: Path) -> dict[str, np.ndarray[Any, Any]]:
    with open(path, newline='') as file:
        rows = list(csv.reader(file))
    data = np.array([[float(cell) for cell in row] for row in rows[1:]])
    return dict(zip(rows[0], data.T, strict=True))


def test_trajectory(run: Path) -> None:
    lines = (run / 'trajectory.csv').read_text().split('\n')
    assert lines[0] == HEADER
    assert lines[-1] == ''
    assert len(lines) == 600 + 2
    for line in lines[1:-1]:
        assert line == ','.join(repr(float(cell)) for cell in line.split(','))
    assert [line.split(',')[0] for line in lines[1:4]] == ['0.0', '0.001', '0.002']
    assert lines[600].startswith('0.599,')


def test_trajectory_against_geometry(run: Path) -> None:
    """Every column from the messages by other means than the code's own."""
    c = columns(run / 'trajectory.csv')
    loop = ClosedLoop(CONFIG)
    side, time = 12.6, 4.0
    for k in range(600):
        record = loop.tick()
        assert record is not None
        assert (c['tau1'][k], c['tau2'][k]) == record.torque
        assert (c['meas_x'][k], c['meas_y'][k]) == record.tip[1:3]
        assert (c['delta1'][k], c['delta2'][k]) == record.deflections[:2]
        assert c['lambda'][k] == record.gain
        a, b = record.q[0], record.q[1]
        assert c['rigid_x'][k] == pytest.approx(4.5 * (math.cos(a) + math.cos(a + b)), abs=1e-12)
        d1, d2 = record.deflections[:2]
        elbow = 4.5 * np.exp(1j * a) + 1j * d1 * np.exp(1j * a)
        assert (c['elbow_x'][k], c['elbow_y'][k]) == pytest.approx(
            (elbow.real, elbow.imag), abs=1e-12
        )
        # The end of a clamped-free link turns by 1.3765 delta / L in its first mode.
        turn = a + b + 1.3765 * d1 / 4.5
        tip = elbow + (4.5 + 1j * d2) * np.exp(1j * turn)
        assert abs(c['tip_x'][k] + 1j * c['tip_y'][k] - tip) < 2e-4 * (1.0 + abs(d1))
        assert c['ref_x'][k] == -6.3
        assert c['ref_y'][k] == pytest.approx(-6.3 + side * (k * 1e-3) / time, abs=1e-12)


def test_lambda_is_nan_for_pd(tmp_path: Path) -> None:
    simulate(small_config('controller.law=pd', duration=0.01), tmp_path / 'run')
    lines = (tmp_path / 'run' / 'trajectory.csv').read_text().splitlines()
    assert {line.rsplit(',', 1)[1] for line in lines[1:]} == {'nan'}


def test_summary(run: Path) -> None:
    summary = json.loads((run / 'summary.json').read_text())
    assert set(summary) >= SUMMARY_KEYS
    assert summary['stable'] is True
    assert summary['complete'] is True
    assert summary['ticks'] == 600
    assert summary['rtf'] == pytest.approx(0.6 / summary['wall_s'])
    c = columns(run / 'trajectory.csv')
    error = np.hypot(c['rigid_x'] - c['ref_x'], c['rigid_y'] - c['ref_y'])
    assert summary['rms_error'] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-12)
    assert summary['max_error'] == pytest.approx(error.max(), rel=1e-12)
    deflection = max(np.abs(c['delta1']).max(), np.abs(c['delta2']).max())
    assert summary['max_deflection'] == deflection
    assert summary['scenario']['controller']['kp'] == 150.79
    assert summary['scenario']['plant']['substeps'] is None
    assert summary['overshoot'] == []
    assert summary['versions']['numpy'] == np.__version__


def test_marked_incomplete_until_the_end(tmp_path: Path) -> None:
    directory = tmp_path / 'run'
    seen = []

    def watch(ticks: int, total: int) -> None:
        summary = json.loads((directory / 'summary.json').read_text())
        seen.append((ticks, total, summary['complete'], summary['stable'], summary['ticks']))
        assert set(summary) >= SUMMARY_KEYS
        assert not (directory / 'trajectory.csv').exists()

    simulate(small_config(duration=1.2), directory, watch=watch)
    assert seen == [(k, 1200, False, None, None) for k in (BLOCK_TICKS, 1200)]
    assert json.loads((directory / 'summary.json').read_text())['complete'] is True
    assert sorted(p.name for p in directory.iterdir()) == [
        'bag', 'summary.json', 'trajectory.csv',
    ]  # fmt: skip


def test_unstable_and_interrupted(tmp_path: Path) -> None:
    unstable = small_config('plant.hub_inertia=[0.5,0.5]', 'control_period=0.02', duration=4.0)
    summary = simulate(unstable, tmp_path / 'a')
    assert summary['stable'] is False
    assert summary['complete'] is True
    assert summary['unstable_tick'] == summary['ticks'] < 200
    assert len((tmp_path / 'a' / 'trajectory.csv').read_text().splitlines()) == (
        summary['ticks'] + 1
    )
    summary = simulate(small_config(duration=1.2), tmp_path / 'b', stop=lambda: True)
    assert summary['stable'] is None
    assert summary['complete'] is False
    assert summary['ticks'] == BLOCK_TICKS
    assert f'interrupted at tick {BLOCK_TICKS}' in summary['problem']
    assert json.loads((tmp_path / 'b' / 'summary.json').read_text()) == summary


def test_not_finite_is_null(tmp_path: Path) -> None:
    summary = {'a': math.nan, 'b': [math.inf, 1.0, {'c': -math.inf}], 'd': (1, 2)}
    write_summary(tmp_path, summary)
    assert json.loads((tmp_path / 'summary.json').read_text()) == {
        'a': None, 'b': [None, 1.0, {'c': None}], 'd': [1, 2],
    }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ['summary.json']


def test_summary_of_a_run_that_never_ran() -> None:
    summary = unfinished_summary(CONFIG, Provenance('x'))
    assert summary['stable'] is None
    assert summary['ticks'] is None
    assert summary['rms_error'] is None
    assert set(summary) >= SUMMARY_KEYS


def test_the_list_of_metrics_is_what_a_run_gives() -> None:
    found = Metrics(CONFIG).result()
    assert list(found) == list(NAMES)
    lists = [name for name in found if isinstance(found[name], list)]
    assert lists == [metric.name for metric in METRICS if metric.per_switch]


def test_directory_is_never_reused(run: Path, tmp_path: Path) -> None:
    before = sorted((p, p.stat().st_mtime_ns) for p in run.rglob('*'))
    with pytest.raises(BagExistsError, match='not overwritten'):
        simulate(CONFIG, run)
    assert sorted((p, p.stat().st_mtime_ns) for p in run.rglob('*')) == before


def test_no_room_for_the_trajectory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, 'TRAJECTORY', 'no/such/place.csv')
    with pytest.raises(BagError, match='cannot be written'):
        outputs.write_trajectory(tmp_path, CONFIG, loop_blocks(ClosedLoop(CONFIG)))


def test_export_csv(run: Path, tmp_path: Path) -> None:
    rows = export(run, tmp_path / 'out', 'csv').rows
    topics = ['clock', 'plant_state', 'joint_states', 'tip_sensor_odometry', 'reference',
              'joint_command', 'trajectory']  # fmt: skip
    assert rows == {f'{name}.csv': 600 for name in topics}
    exported = (tmp_path / 'out' / 'trajectory.csv').read_bytes()
    assert exported == (run / 'trajectory.csv').read_bytes()
    c = columns(tmp_path / 'out' / 'joint_command.csv')
    assert list(c) == ['tick', 'stamp_ns', 'effort.shoulder', 'effort.elbow']
    torque = columns(run / 'trajectory.csv')
    assert np.array_equal(c['effort.elbow'], torque['tau2'])
    assert np.array_equal(c['stamp_ns'], 10**9 + np.arange(600) * 10**6)
    with pytest.raises(BagExistsError):
        export(run, tmp_path / 'out', 'csv')


def test_export_of_a_bag_with_gaps(tmp_path: Path) -> None:
    config = small_config()
    truth = small_messages(config)
    with BagWriter(tmp_path / 'bag', config) as writer:
        for tick in [*range(100), *range(150, 300)]:
            for topic, data in enumerate(truth[tick]):
                if (tick, topic) != (160, STATE):
                    writer.write(topic, tick, data)
            writer.end_tick(tick)
    rows = export(tmp_path / 'bag', tmp_path / 'out', 'csv').rows
    assert rows['clock.csv'] == 250
    assert rows['plant_state.csv'] == 249
    assert rows['trajectory.csv'] == 100
    ticks = columns(tmp_path / 'out' / 'plant_state.csv')['tick']
    assert 160 not in ticks
    assert ticks[100] == 150


@pytest.mark.parametrize('name', ['fls_mid_corrected', 'open_loop'])
def test_a_bag_alone_is_enough_to_fly_it_again(name: str, tmp_path: Path) -> None:
    first, again = tmp_path / 'first', tmp_path / 'again'
    words = ['simulate', name, '--set', 'duration=0.2', '--set', 'seed=3', '--no-pictures']
    assert main([*words, '--out', str(first)]) == 0
    (first / 'bag').rename(tmp_path / 'bag')
    assert main(['export', str(tmp_path / 'bag'), '--out', str(tmp_path / 'tables')]) == 0
    file = str(tmp_path / 'tables' / 'scenario.yaml')
    assert main(['simulate', file, '--no-pictures', '--out', str(again)]) == 0
    assert (again / 'trajectory.csv').read_bytes() == (first / 'trajectory.csv').read_bytes()
    was, now = BagReader(tmp_path / 'bag'), BagReader(again)
    assert list(now.messages()) == list(was.messages())
    assert bag_config(now.config) == bag_config(was.config)


def test_export_of_a_damaged_bag_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = write_small(tmp_path / 'bag', small_config()).read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(sound[: len(sound) // 2])
    assert main(['export', str(tmp_path / 'cut.mcap'), '--out', str(tmp_path / 'out')]) == 1
    said = capsys.readouterr()
    assert 'only in part: ' in said.err
    assert 'damaged at byte' in said.err
    ticks = columns(tmp_path / 'out' / 'clock.csv')['tick']
    assert 0 < len(ticks) < 300
    assert f'{len(ticks)} rows  {tmp_path / "out"}/clock.csv' in said.out


def test_an_export_that_fails_leaves_nothing(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('flexarm_ros.bag.tables.export._CsvFile.write', full)
    with pytest.raises(BagError, match='cannot be written: No space left'):
        export(run, tmp_path / 'out', 'csv')
    assert not (tmp_path / 'out').exists()


def test_export_command(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / 'out')
    assert main(['export', str(run / 'bag' / 'bag_0.mcap'), '--out', out]) == 0
    assert f'600 rows  {out}/joint_command.csv' in capsys.readouterr().out
    assert main(['export', str(run), '--out', out]) == 2
    assert 'not overwritten' in capsys.readouterr().err
    assert main(['export', str(tmp_path / 'nothing'), '--out', out + '2']) == 2
    assert main(['export', str(run), '--format', 'xls', '--out', out + '2']) == 2
    assert not (tmp_path / 'out2').exists()


def test_export_parquet(run: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip('pyarrow.parquet')
    export(run, tmp_path / 'out', 'parquet')
    table = parquet.read_table(tmp_path / 'out' / 'plant_state.parquet')
    assert table.num_rows == 600
    assert [str(f.type) for f in table.schema][:3] == ['int64', 'int64', 'double']
    (block, *_) = BagReader(run).blocks(600)
    assert np.array_equal(table['position.link1'].to_numpy(), block.values[STATE][:, 4])


def test_export_mat(run: Path, tmp_path: Path) -> None:
    rows = export(run, tmp_path / 'out', 'mat').rows
    assert rows['plant_state.mat'] == rows['trajectory.mat'] == 600
    assert len(list((tmp_path / 'out').glob('*.mat'))) == len(rows)
    state = loadmat(tmp_path / 'out' / 'plant_state.mat', squeeze_me=True)['plant_state'][()]
    assert state['stamp_ns'].dtype == np.int64
    (block, *_) = BagReader(run).blocks(600)
    assert np.array_equal(state['position_link1'], block.values[STATE][:, 4])
    flown = loadmat(tmp_path / 'out' / 'trajectory.mat')['trajectory'][0, 0]
    assert flown['tau2'].shape == (600, 1)
    assert np.array_equal(flown['tau2'][:, 0], columns(run / 'trajectory.csv')['tau2'])


def test_export_parquet_without_pyarrow(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    words = ['export', str(run), '--format', 'parquet', '--out', str(tmp_path / 'out')]
    assert main(words) == 1
    assert NO_PYARROW in capsys.readouterr().err
    assert not (tmp_path / 'out').exists()


def altered(directory: Path, tick: int, topic: int, field: int, by: float) -> Path:
    config = small_config()
    codec = per_tick_topics(config)[topic].codec
    with BagWriter(directory, config) as writer:
        for k, messages in enumerate(small_messages(config)):
            for i, data in enumerate(messages):
                if (k, i) == (tick, topic):
                    stamp, values = codec.decode(data)
                    numbers = list(values)
                    numbers[field] += by
                    data = codec.encode(stamp, *numbers)
                writer.write(i, k, data)
    return directory


def test_compare_equal_and_altered(tmp_path: Path) -> None:
    write_small(tmp_path / 'a', small_config())
    altered(tmp_path / 'b', 200, COMMAND, 1, 0.5)
    same = compare(tmp_path / 'a', tmp_path / 'a')
    assert same.within
    assert sum(f.count for f in same.fields) == 300 * (1 + 13 + 5 + 5 + 5 + 3)
    result = compare(tmp_path / 'a', tmp_path / 'b')
    assert not result.within
    (found,) = [f for f in result.fields if f.beyond]
    assert (found.topic, found.name, found.beyond) == ('/joint_command', 'effort.elbow', 1)
    assert found.first_ns == found.at_ns == 200_000_000
    assert found.largest == pytest.approx(0.5)
    assert found.rms == pytest.approx(0.5 / math.sqrt(300))
    assert compare(tmp_path / 'a', tmp_path / 'b', absolute=0.500001).within
    assert not compare(tmp_path / 'a', tmp_path / 'b', absolute=0.499999).within
    assert compare(tmp_path / 'a', tmp_path / 'b', relative=1.0).within


def test_compare_numbers_that_are_none(tmp_path: Path) -> None:
    altered(tmp_path / 'a', 7, STATE, 0, math.nan)
    altered(tmp_path / 'b', 7, STATE, 0, math.inf)
    write_small(tmp_path / 'c', small_config())
    assert compare(tmp_path / 'a', tmp_path / 'a').within
    assert compare(tmp_path / 'b', tmp_path / 'b').within
    for one, other in (('a', 'b'), ('a', 'c'), ('c', 'a'), ('b', 'c')):
        result = compare(tmp_path / one, tmp_path / other, absolute=1e300, relative=0.0)
        assert [f.beyond for f in result.fields if f.beyond] == [1]


def test_compare_other_scenarios(tmp_path: Path) -> None:
    """Another length, another period, more modes: what is common is compared."""
    write_small(tmp_path / 'a', small_config())
    write_small(
        tmp_path / 'b', small_config('control_period=0.002', 'plant.modes=2', duration=0.2)
    )
    result = compare(tmp_path / 'a', tmp_path / 'b')
    assert not result.within
    assert any(text.startswith('plant.modes: 1 and 2') for text in result.parameters)
    counts = {f.count for f in result.fields}
    assert counts == {100}
    assert result.only_a['/clock'] == 200
    assert result.only_b['/clock'] == 0
    assert any('position.link1_mode2' in note for note in result.notes)


def test_compare_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_small(tmp_path / 'a', small_config())
    altered(tmp_path / 'b', 200, COMMAND, 1, 0.5)
    a, b = str(tmp_path / 'a'), str(tmp_path / 'b')
    assert main(['compare', a, a]) == 0
    assert 'all within tolerance' in capsys.readouterr().out
    assert main(['compare', a, b]) == 1
    out = capsys.readouterr().out
    assert '/joint_command effort.elbow' in out
    assert '1 of 300, first at 0.2 s' in out
    assert main(['compare', a, b, '--atol', '0.6', '--json']) == 0
    data = json.loads(capsys.readouterr().out)
    assert data['within'] is True
    assert max(f['largest'] for f in data['fields']) == pytest.approx(0.5)
    assert main(['compare', a, b, '--atol', '-1']) == 2
    assert main(['compare', a, str(tmp_path / 'nothing')]) == 2
    assert 'no such file' in capsys.readouterr().err
