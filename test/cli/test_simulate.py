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

"""``flexarm simulate`` as a user starts it."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
import re
import signal
import subprocess
import sys
import time
from typing import Any

import flexarm_ros.cli as cli
import pytest

COMMAND = [sys.executable, '-m', 'flexarm_ros.cli', 'simulate']
QUICK = ['--set', 'duration=0.25', '--no-pictures']


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def summary(directory: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((directory / 'summary.json').read_text())
    return found


def rows(directory: Path) -> list[list[str]]:
    with open(directory / 'trajectory.csv', newline='') as file:
        return list(csv.reader(file))


def test_a_run_leaves_its_files_and_prints_its_metrics(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = here / 'out'
    assert cli.main(['simulate', 'fls_tip', *QUICK, '--out', str(out)]) == 0
    assert sorted(path.name for path in out.iterdir()) == ['bag', 'summary.json', 'trajectory.csv']
    assert len(rows(out)) == 251
    found = summary(out)
    assert (found['stable'], found['complete'], found['ticks']) == (True, True, 250)
    assert found['scenario']['/**']['duration'] == 0.25
    printed = capsys.readouterr().out
    assert f'{found["rms_error"]:.5g} m' in printed
    assert str(out / 'bag') in printed


def test_without_a_bag_the_other_files_are_the_same(here: Path) -> None:
    assert cli.main(['simulate', 'fls_tip', *QUICK, '--out', 'a']) == 0
    assert cli.main(['simulate', 'fls_tip', *QUICK, '--out', 'b', '--no-bag']) == 0
    assert not (here / 'b' / 'bag').exists()
    assert (here / 'a/trajectory.csv').read_bytes() == (here / 'b/trajectory.csv').read_bytes()
    first, second = summary(here / 'a'), summary(here / 'b')
    timed = {'wall_s', 'rtf'}
    assert {k: v for k, v in first.items() if k not in timed} == {
        k: v for k, v in second.items() if k not in timed
    }


def test_no_run_is_ever_overwritten(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for _ in range(2):
        assert cli.main(['simulate', 'pd_tip', *QUICK, '--no-bag']) == 0
    assert sorted(path.name for path in (here / 'runs').iterdir()) == ['pd_tip', 'pd_tip-2']
    before = (here / 'runs/pd_tip/summary.json').read_bytes()
    assert cli.main(['simulate', 'pd_tip', *QUICK, '--out', 'runs/pd_tip']) == 2
    assert 'exists already' in capsys.readouterr().err
    assert (here / 'runs/pd_tip/summary.json').read_bytes() == before
    (here / 'empty').mkdir()
    assert cli.main(['simulate', 'pd_tip', *QUICK, '--no-bag', '--out', 'empty']) == 0


@pytest.mark.parametrize('extra', [[], ['--no-bag']])
def test_an_unstable_run_ends_with_status_1_and_says_why(
    here: Path, capsys: pytest.CaptureFixture[str], extra: list[str]
) -> None:
    words = ['simulate', 'fls_tip_physical', '--no-pictures', '--out', 'out', *extra]
    assert cli.main(words) == 1
    found = summary(here / 'out')
    assert (found['stable'], found['complete']) == (False, True)
    assert found['ticks'] == found['unstable_tick'] == len(rows(here / 'out')) - 1
    assert 'deflection' in found['problem']
    assert 'UNSTABLE' in capsys.readouterr().out


def test_the_same_scenario_gives_the_same_bytes_in_another_process(here: Path) -> None:
    assert cli.main(['simulate', 'fls_tip', *QUICK, '--out', 'a']) == 0
    subprocess.run([*COMMAND, 'fls_tip', *QUICK, '--out', 'b'], check=True, timeout=120)
    for name in ('trajectory.csv', 'bag/bag_0.mcap', 'bag/metadata.yaml'):
        assert (here / 'a' / name).read_bytes() == (here / 'b' / name).read_bytes()


@pytest.mark.parametrize(
    ('signum', 'status', 'extra'),
    [
        (signal.SIGINT, 130, []),
        (signal.SIGTERM, 143, []),
        (signal.SIGHUP, 129, []),
        (signal.SIGINT, 130, ['--no-bag']),
    ],
)
def test_an_interrupted_run_keeps_what_it_has_and_says_so(
    here: Path, signum: int, status: int, extra: list[str]
) -> None:
    out = here / 'out'
    process = subprocess.Popen(
        [*COMMAND, 'pd_tip', '--set', 'duration=100000', '--out', str(out), *extra],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    growing = out / ('trajectory.csv.tmp' if extra else 'bag/bag_0.mcap')
    deadline = time.monotonic() + 60.0
    while not (growing.exists() and growing.stat().st_size > 100_000):
        assert process.poll() is None, process.stderr.read() if process.stderr else ''
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(signum)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == status
    assert 'Traceback' not in errors
    found = summary(out)
    assert (found['complete'], found['stable']) == (False, None)
    assert found['ticks'] == len(rows(out)) - 1 > 0
    assert found['problem'] == f'interrupted at tick {found["ticks"]}'


def test_list_laws_prints_one_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    from flexarm_ros.core.control import BUILT_IN
    from flexarm_ros.core.parameters.sections import ControllerParameters, specs

    assert cli.main(['simulate', '--list-laws']) == 0
    assert capsys.readouterr().out.splitlines() == list(BUILT_IN)
    assert set(specs(ControllerParameters)['law'][1].choices) == set(BUILT_IN)


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        ([None] * 70, '-'),
        ([0.5, None], '0.5 -'),
        ([0.5, None, 2] + [None] * 69, '0.5 - 2 -'),
        ([0, 1.5], '0 1.5'),
        ([], ''),
        (None, '-'),
    ],
)
def test_what_is_not_known_is_one_dash(value: object, text: str) -> None:
    from flexarm_ros.cli.options.output import format_metric

    assert format_metric(value) == text


def test_progress_has_no_figure_before_there_is_one(capsys: pytest.CaptureFixture[str]) -> None:
    from flexarm_ros import scenario
    from flexarm_ros.cli.options import progress

    with progress.Progress(scenario.load('fls_tip'), 'fls_tip') as shown:
        shown.update(1, 16000)
        shown._last_line -= 60.0
        shown.update(1, 16000)
        shown._start = time.monotonic() - 50.0  # a slow machine, not one that stands still
        shown._last_line -= 60.0
        shown.update(501, 16000)
    with progress.CountProgress('sweep', 10, 4) as counted:
        counted._last_line -= 60.0
        counted.update(4)
    said = capsys.readouterr().err.splitlines()
    assert [said[0], said[2]] == ['fls_tip: 0.00 of 16 s simulated', 'sweep: 4 of 10 runs']
    assert re.fullmatch(
        r'fls_tip: 0.50 of 16 s simulated, 0\.01 times real time, 15\d\d s left', said[1]
    )


def test_progress_in_a_pipe_is_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    from flexarm_ros import scenario
    from flexarm_ros.cli.options import progress

    with progress.Progress(scenario.load('fls_tip'), 'fls_tip') as shown:
        shown.update(1, 16000)
        shown._last_line -= 60.0
        shown.update(8000, 16000)
        shown.say('done')
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith('fls_tip: 8.00 of 16 s simulated, ')
    assert first.endswith('s left')
    assert second == 'done'


def test_work_after_a_run_is_shown_at_once_and_as_it_goes(
    capsys: pytest.CaptureFixture[str],
) -> None:
    from flexarm_ros import scenario
    from flexarm_ros.cli.options import progress

    with progress.Progress(scenario.load('fls_tip'), 'fls_tip') as shown:
        for share in (0.0, 0.1, 0.2):
            shown.work('mending', share)
        shown._last_line -= 60.0
        shown.work('mending', 0.3)
    said = capsys.readouterr().err.splitlines()
    assert said == ['fls_tip: mending: 0% done', 'fls_tip: mending: 30% done']


@pytest.mark.parametrize('tick', [7, 19], ids=['on the way', 'in the last tick'])
def test_a_law_without_a_finite_torque_is_named_with_its_tick(
    tick: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It read "unstable: shoulder: nan", or in the last tick "stable"."""
    import flexarm_ros as fa
    from flexarm_ros.analysis.sweep.worker import simulate_row
    from flexarm_ros.bag.checks.verify import verify
    from flexarm_ros.core.control import Law, LAWS, Sample

    class Broken(Law):
        def torque(self, k: int, sample: Sample) -> tuple[float, float]:
            return 1.0, math.nan if k == tick else 2.0

    monkeypatch.setitem(LAWS, 'pd', Broken)
    said = f'unstable: controller (pd): tick {tick}: torque at the elbow is nan N m'
    words = ['simulate', 'pd_collocated', '--set', 'duration=0.02', '--no-pictures', '--out']
    assert cli.main([*words, str(tmp_path / 'bag')]) == 1
    assert cli.main([*words, str(tmp_path / 'none'), '--no-bag']) == 1
    assert capsys.readouterr().out.count(said.replace('unstable', 'UNSTABLE')) == 2
    config = fa.configure('pd_collocated', duration=0.02)
    found = [json.loads((tmp_path / d / 'summary.json').read_text()) for d in ('bag', 'none')]
    found.append(dict(fa.simulate(config).summary))
    for summary in found:
        assert (summary['stable'], summary['problem']) == (False, said)
        assert (summary['ticks'], summary['unstable_tick']) == (tick + 1, tick + 1)
    row = simulate_row(config)
    assert (row['outcome'], f'unstable: {row["error"]}') == ('unstable', said)
    assert verify(tmp_path / 'bag').same
