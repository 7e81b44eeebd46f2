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

"""Runs read back: where they are found, what spoilt ones give, and what they are called."""

from __future__ import annotations

from pathlib import Path
import shutil

from flexarm_ros import scenario
from flexarm_ros.analysis.report.runs import (
    COLLOCATED,
    CORRECTED,
    labels,
    load_run,
    NONCOLLOCATED,
    ReportedRun,
    RunError,
)
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.core.run.results.columns import COLUMNS
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from report_cases import cut_rows, edit_summary, fly

SHORT = ('duration=2.0', 'trajectory.side_time=0.5', 'trajectory.side=1.0')


@pytest.fixture(scope='module')
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp('runs') / 'fls_tip', 'fls_tip', *SHORT)


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    return fly(tmp_path / 'copy', 'fls_tip', 'duration=0.1')


def made(
    law: str, feedback: str, delay: float = 0.0, name: str = 'x', **plant: object
) -> ReportedRun:
    """Return a run without rows."""
    scenario = {
        'plant': dict(plant),
        'tip_sensor': {'location': 9.0},
        'trajectory': {'delay': delay},
        'controller': {'law': law, 'feedback': feedback},
    }
    return ReportedRun(Path('/runs') / name, {c: np.zeros(0) for c in COLUMNS}, {}, scenario)


def test_a_run_is_found_from_its_directory_its_bag_and_files_in_them(directory: Path) -> None:
    (directory / 'bag').mkdir(exist_ok=True)
    (directory / 'bag' / 'bag_0.mcap').touch()
    for path in ('', 'bag', 'bag/bag_0.mcap', 'summary.json'):
        assert load_run(directory / path).directory == directory


def test_columns_are_those_of_the_file(directory: Path) -> None:
    run = load_run(directory)
    table = np.loadtxt(directory / 'trajectory.csv', delimiter=',', skiprows=1)
    assert run.rows == 2000
    assert list(run.columns) == list(COLUMNS)
    for i, name in enumerate(COLUMNS):
        assert np.array_equal(run.columns[name], table[:, i])


def test_switches_are_the_reference_s_corners(directory: Path) -> None:
    assert load_run(directory).switches() == [0.5, 1.0, 1.5]


@pytest.mark.parametrize(
    'overrides',
    [('trajectory.time_law=smooth',), ('trajectory.kind=hold',)],
    ids=['smooth', 'hold'],
)
def test_switches_of_other_references(tmp_path: Path, overrides: tuple[str, ...]) -> None:
    run = load_run(fly(tmp_path / 'run', 'pd_collocated', *SHORT, *overrides))
    expected = [] if 'hold' in overrides[0] else [0.5, 1.0, 1.5]
    assert run.switches() == pytest.approx(expected, abs=2e-3)


def test_errors_are_those_of_the_summary(directory: Path) -> None:
    run = load_run(directory)
    assert run.error().max() == pytest.approx(run.summary['max_error'], rel=1e-12)
    assert run.tip_error().max() == pytest.approx(run.summary['tip_max_error'], rel=1e-12)


def test_a_run_starts_without_an_error(directory: Path) -> None:
    run = load_run(directory)
    x, y = run.columns['rigid_x'] - run.columns['ref_x'], run.columns['rigid_y']
    assert np.hypot(x, y - run.columns['ref_y'])[0] > 0.0, 'the rounding is there'
    assert run.error()[0] == run.tip_error()[0] == 0.0
    assert run.error()[1] > 0.0


def test_a_row_that_was_cut_off_is_left_out(copy: Path) -> None:
    cut_rows(copy, 7, rest='0.007,1.25,')
    assert load_run(copy).rows == 7


@pytest.mark.parametrize(
    ('file', 'content', 'complaint'),
    [
        ('summary.json', '{', 'summary.json cannot be read'),
        ('summary.json', '[]', 'not a JSON object'),
        ('summary.json', '[' * 100_000, 'summary.json cannot be read'),
        ('summary.json', '\xff', 'summary.json cannot be read'),
        ('trajectory.csv', '', 'no column t'),
        ('trajectory.csv', 't,theta1\n0,1\n', 'no column theta2'),
        ('trajectory.csv', ','.join(COLUMNS) + '\n1,2\n' + '0,' * 19 + '0\n', 'row 1 has 2'),
        ('trajectory.csv', ','.join(COLUMNS) + '\n' + 'x,' * 19 + '0\n', 'could not convert'),
        ('trajectory.csv', '\0' * 100, 'no column t'),
    ],
)
def test_spoilt_files_are_refused_in_one_line(
    copy: Path, file: str, content: str, complaint: str
) -> None:
    (copy / file).write_text(content, 'latin-1')
    with pytest.raises(RunError) as caught:
        load_run(copy)
    assert complaint in str(caught.value) and file in str(caught.value)
    assert '\n' not in str(caught.value) and len(str(caught.value)) < 500


@given(st.text(max_size=300))
def test_any_text_as_rows_is_read_or_refused(text: str) -> None:
    from flexarm_ros.analysis.report.runs import _table

    try:
        table = _table(text.splitlines(), len(COLUMNS))
    except ValueError:
        return
    assert table.shape[1] == len(COLUMNS)


@pytest.mark.parametrize(
    'scenario', [None, 7, [], {'controller': 3}, {'controller': {'law': 5, 'feedback': []}}]
)
def test_a_summary_may_lack_everything(copy: Path, scenario: object) -> None:
    edit_summary(copy, lambda s: (s.clear(), s.update(scenario=scenario, stable='yes')))
    run = load_run(copy)
    assert (run.law, run.role, run.location, run.stable) == ('', '', None, None)
    assert labels([run]) == ['Unknown law']


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record a run with its bag."""
    directory = tmp_path_factory.mktemp('recorded') / 'run'
    simulate(scenario.load('fls_tip', list(SHORT)), directory, 'fls_tip')
    return directory


@pytest.mark.parametrize('lost', ['trajectory.csv', 'summary.json'])
@pytest.mark.parametrize('path', ['', 'bag'])
def test_a_bag_alone_is_a_run(recorded: Path, tmp_path: Path, lost: str, path: str) -> None:
    whole = load_run(recorded)
    shutil.copytree(recorded, tmp_path / 'copy')
    (tmp_path / 'copy' / lost).unlink()
    run = load_run(tmp_path / 'copy' / path)
    for name in COLUMNS:
        assert np.array_equal(run.columns[name], whole.columns[name], equal_nan=True)
    unknown = {'wall_s', 'rtf'}
    assert {k: v for k, v in run.summary.items() if k not in unknown} == {
        k: v for k, v in whole.summary.items() if k not in unknown
    }


def test_a_bag_that_was_cut_off_gives_what_is_left(recorded: Path, tmp_path: Path) -> None:
    (bag,) = (recorded / 'bag').glob('*.mcap')
    data = bag.read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(data[: len(data) * 2 // 3])
    run = load_run(tmp_path / 'cut.mcap')
    assert 0 < run.rows < 2000 and run.stable is None
    assert np.array_equal(run.columns['tau1'], load_run(recorded).columns['tau1'][: run.rows])


@pytest.mark.parametrize(
    ('path', 'reason'), [('nowhere', 'no such file'), ('', 'no trajectory.csv'), ('a\0b', 'null')]
)
def test_what_is_not_a_run_says_why(tmp_path: Path, path: str, reason: str) -> None:
    with pytest.raises(RunError, match=reason):
        load_run(tmp_path / path)


def test_roles_come_from_the_scenario() -> None:
    assert made('pd', 'encoder').role == COLLOCATED
    assert made('pd', 'tip_sensor').role == NONCOLLOCATED
    assert made('fls', 'tip_sensor', 0.001).role == CORRECTED
    assert made('open_loop', 'encoder').role == ''


def test_equal_cases_are_told_apart_by_what_differs_then_by_name() -> None:
    runs = [
        made('pd', 'encoder'),
        made('pd', 'encoder', hub_inertia=[10.0, 10.0]),
        made('fls', 'tip_sensor', name='a'),
        made('fls', 'tip_sensor', name='b'),
    ]
    assert labels(runs) == [
        'PD, collocated, hub_inertia default',
        'PD, collocated, hub_inertia 10/10',
        'FLS, noncollocated (NMP), sensor at 9 m, a',
        'FLS, noncollocated (NMP), sensor at 9 m, b',
    ]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(['pd', 'fls', '']),
            st.sampled_from(['a', 'b']),
            st.one_of(st.none(), st.floats(1.0, 9.0), st.text(max_size=5)),
        ),
        max_size=12,
    )
)
def test_labels_are_all_different(cases: list[tuple[str, str, object]]) -> None:
    runs = [made(law, 'encoder', name=name, hub=hub) for law, name, hub in cases]
    texts = labels(runs)
    assert len(set(texts)) == len(runs)
