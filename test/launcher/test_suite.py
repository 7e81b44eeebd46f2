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

"""Suites flown: cases side by side, faults, JUnit, the live table, signals."""

from __future__ import annotations

import io
import json
import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any
import xml.etree.ElementTree as ET

from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.cli.running.suite_table import SuiteTable
from flexarm_ros.launcher import suite as launcher
from flexarm_ros.launcher.junit import write_junit
from flexarm_ros.launcher.subprocess_simulation import simulate_apart
from flexarm_ros.scenario.suites import suite as files
from nodetools import flexarm, flexarm_here, wait_for
import pytest
from report_cases import leave_pictures_empty
from repository import ROOT

GRID = """
defaults: {set: {duration: 0.3}, mode: simulate, expect: {stable: true, ticks: 300}}
cases:
  - scenario: fls_tip
    name: fls
    grid: {tip_sensor.latency: [0.0, 0.001238]}
  - {scenario: pd_tip, name: pd, expect: {max_error: {lt: 0.001}}}
compare:
  - case("fls[latency=0.0]").max_error < pd.max_error
  - pd.max_error < 0
claims:
  - {claim: as expected, verdict: holds, checks: [pd.max_error > 0]}
  - {claim: not as expected, verdict: holds, checks: [pd.max_error < 0]}
"""


def suite(text: str, name: str = 's') -> files.Suite:
    return files.from_text(text, name, ROOT)


def test_simulated_cases_side_by_side(tmp_path: Path) -> None:
    made, told = suite(GRID), []
    result = launcher.run_suite(made, tmp_path / 'out', 3, lambda case, text: told.append(text))
    assert not result.passed
    failures = result.failures()
    assert [line.split(':')[0] for line in failures] == [
        'pd',
        'pd.max_error < 0',
        'not as expected',
    ]
    assert [case.directory.name for case in result.cases] == [
        'fls[latency=0.0]', 'fls[latency=0.001238]', 'pd',
    ]  # fmt: skip
    assert told.count('starting') == 3
    assert '100 %' in told
    for case in made.cases:  # each as if it had been flown alone
        alone = simulate(case.config, tmp_path / 'alone' / case.name, case.name)
        there = launcher.case_directory(tmp_path / 'out', case.name)
        for file in ('bag/bag_0.mcap', 'trajectory.csv'):
            assert (tmp_path / 'alone' / case.name / file).read_bytes() == (
                there / file
            ).read_bytes()
        assert json.loads((there / 'summary.json').read_text())['max_error'] == alone['max_error']


def test_each_case_has_a_directory_of_its_own(tmp_path: Path) -> None:
    names = ['a[k=x]', 'a[k=x y]', 'a[k=x/y]', 'a[k=x_y]', 'a\u00e9', 'a\u00e8', 'b' * 999,
             'b' * 998]  # fmt: skip
    made = [launcher.case_directory(tmp_path, name) for name in names]
    assert len(set(made)) == len(names)
    for directory in made:
        assert directory.parent == tmp_path
        directory.mkdir()
    assert made[0].name == 'a[k=x]'


def judged(stopped: bool = False) -> launcher.SuiteResult:
    """Return the result of `GRID` without a flight."""
    made = suite(GRID)
    cases = []
    for case in made.cases:
        metrics: dict[str, Any] = {'stable': True, 'ticks': 300, 'max_error': 0.5, 'error': ''}
        if stopped and case.name == 'pd':
            metrics = {'status': 130, 'error': launcher.NOT_STARTED}
        elif case.name == 'pd':
            metrics = {**metrics, 'max_error': 0.6, 'error': 'bell \x07 & <tag>'}
        cases.append(launcher.CaseResult(case, Path(case.name), metrics, case.check(metrics), 1.5))
    return launcher.judge(made, cases)


def test_junit_has_a_test_case_for_each_case_comparison_and_claim(tmp_path: Path) -> None:
    file = tmp_path / 'new' / 'result.xml'
    write_junit(judged(), file)
    root = ET.parse(file).getroot()
    assert root.tag == 'testsuite'
    assert {key: root.get(key) for key in ('name', 'tests', 'failures', 'skipped', 'errors')} == {
        'name': 's', 'tests': '7', 'failures': '3', 'skipped': '0', 'errors': '0',
    }  # fmt: skip
    assert float(root.get('time', '')) == 4.5
    found = {case.get('name'): case for case in root}
    # Names without numbers: a CI system follows a test by its name.
    assert list(found) == [
        'fls[latency=0.0]', 'fls[latency=0.001238]', 'pd',
        'case("fls[latency=0.0]").max_error < pd.max_error', 'pd.max_error < 0',
        'as expected', 'not as expected',
    ]  # fmt: skip
    assert [n for n, case in found.items() if case.find('failure') is not None] == [
        'pd', 'pd.max_error < 0', 'not as expected',
    ]  # fmt: skip
    failure = found['pd'].find('failure')
    assert failure is not None
    assert failure.get('message') == 'max_error < 0.001: 0.6'
    said = found['pd'].findtext('system-out') or ''
    assert 'directory: pd' in said
    assert 'bell ? & <tag>' in said


def test_junit_tells_what_was_not_started(tmp_path: Path) -> None:
    result = judged(stopped=True)
    assert not result.passed
    assert 'pd: not started' in result.failures()
    write_junit(result, tmp_path / 'result.xml')
    root = ET.parse(tmp_path / 'result.xml').getroot()
    assert root.get('skipped') == '1'
    assert root.find("testcase[@name='pd']/skipped") is not None
    assert root.find("testcase[@name='pd']/failure") is None


def test_a_suite_that_is_stopped_starts_nothing_more(tmp_path: Path) -> None:
    result = launcher.run_suite(suite(GRID), tmp_path / 'out', 1, stop=lambda: True)
    assert all(case.not_started for case in result.cases)
    assert not (tmp_path / 'out').exists()


def test_a_simulation_apart_stops_when_told_and_tells_what_failed(tmp_path: Path) -> None:
    case = suite('cases: [{scenario: pd_tip, set: {duration: 1000}}]').cases[0]
    seen: list[int] = []
    summary = simulate_apart(
        case.config,
        tmp_path / 'run',
        's',
        lambda ticks, total: seen.append(ticks),
        lambda: bool(seen),
    )
    assert summary['complete'] is False
    assert summary['problem'].startswith('interrupted at tick ')
    with pytest.raises(BagError, match='not overwritten'):
        simulate_apart(case.config, tmp_path / 'run', 's', lambda *_: None, lambda: True)


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def test_the_live_table_shows_every_case_under_its_name(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, 'stderr', terminal)
    monkeypatch.setenv('TERM', 'xterm')
    monkeypatch.setenv('COLUMNS', '100')
    made = suite(GRID)
    with SuiteTable(made) as table:
        table.update(made.cases[0], '42 %')
        table.update(made.cases[2], 'FAILED')
    shown = terminal.getvalue()
    for name in ('fls[latency=0.0]', 'fls[latency=0.001238]', '42 %', 'waiting', 'FAILED'):
        assert name in shown


def test_in_a_pipe_the_table_is_lines(capsys: pytest.CaptureFixture[str]) -> None:
    made = suite(GRID)
    with SuiteTable(made) as table:
        for text in ('starting', '42 %', '43 %', 'passed'):
            table.update(made.cases[0], text)
    assert capsys.readouterr().err == 'fls[latency=0.0]: starting\nfls[latency=0.0]: passed\n'


@pytest.mark.nodes
def test_flown_side_by_side_and_delayed_a_run_is_the_same(tmp_path: Path) -> None:
    """Two runs at once, one node of one of them held up: the bytes are those of a simulation."""
    (tmp_path / 's.yaml').write_text(
        'defaults: {set: {duration: 0.3}, expect: {stable: true, status: 0}}\n'
        'cases:\n'
        '  - {scenario: pd_tip, name: a}\n'
        '  - scenario: fls_mid\n'
        '    name: b\n'
        '    faults: [{at: 0.1, node: encoder, action: delay, for: 0.5}]\n'
        'compare: [a.max_torque != b.max_torque]\n'
    )
    done = flexarm('suite', tmp_path / 's.yaml', '--out', tmp_path / 'out', '--jobs', '2',
                   '--junit', tmp_path / 's.xml')  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert '2 of 2 cases passed; suite passes' in done.stdout
    assert ET.parse(tmp_path / 's.xml').getroot().get('failures') == '0'
    for case in files.load(tmp_path / 's.yaml').cases:
        simulate(case.config, tmp_path / case.name, case.name)
        there = tmp_path / 'out' / case.name
        for file in ('bag/bag_0.mcap', 'trajectory.csv'):
            assert (there / file).read_bytes() == (tmp_path / case.name / file).read_bytes()
        assert {log.name for log in (there / 'logs').iterdir()} >= {'plant.log', 'controller.log'}


@pytest.mark.parametrize(
    ('number', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_signal_ends_a_suite_with_its_results(number: int, status: int, tmp_path: Path) -> None:
    """The signal goes to the whole group, as Ctrl-C does, and as CI systems end a job."""
    (tmp_path / 's.yaml').write_text(
        'defaults: {mode: simulate, set: {duration: 5000}, expect: {stable: true}}\n'
        'cases: [{scenario: pd_tip, name: a}, {scenario: pd_tip, name: b}]\n'
    )
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'suite', tmp_path / 's.yaml', '--jobs', '1',
         '--out', tmp_path / 'out', '--junit', tmp_path / 's.xml'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        start_new_session=True,
    )  # fmt: skip
    try:
        bag = tmp_path / 'out' / 'a' / 'bag' / 'bag_0.mcap'
        wait_for(lambda: bag.exists() and bag.stat().st_size > 50_000, 60, 'the case flies')
        os.killpg(process.pid, number)
        text, _ = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
    assert process.returncode == status, text
    assert 'Traceback' not in text
    summary = json.loads((tmp_path / 'out' / 'a' / 'summary.json').read_text())
    assert summary['complete'] is False
    assert summary['problem'].startswith('interrupted at tick ')
    root = ET.parse(tmp_path / 's.xml').getroot()
    assert (root.get('tests'), root.get('failures'), root.get('skipped')) == ('2', '1', '1')


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        (['nothing'], 'nothing'),
        (['smoke', '--jobs', '0'], '--jobs'),
        (['smoke', '--mode', 'simulate'], 'case killed has faults'),
        (['smoke', '--junit', '/'], '--junit /: is a directory'),
    ],
)
def test_bad_usage_flies_nothing(words: list[str], said: str, tmp_path: Path) -> None:
    done = flexarm('suite', *words, '--out', tmp_path / 'out')
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) <= 2
    assert not (tmp_path / 'out').exists()


PAPER = """
defaults:
  mode: simulate
  set: {duration: 2.0, trajectory.side_time: 0.5, trajectory.side: 1.0}
cases:
  - {scenario: pd_collocated}
  - {scenario: pd_tip}
  - {scenario: fls_collocated}
  - {scenario: fls_tip}
claims:
  - claim: all are stable
    verdict: holds
    checks: [pd_tip.stable == 1]
"""


def test_a_suite_with_claims_ends_with_the_paper_s_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_pictures_empty(monkeypatch)
    (tmp_path / 's.yaml').write_text(PAPER, 'utf-8')
    done = flexarm_here('suite', tmp_path / 's.yaml', '--out', tmp_path / 'out')
    assert (done.returncode, done.stderr.count('Traceback')) == (0, 0)
    report = tmp_path / 'out' / 'report'
    *_, page, last = done.stdout.splitlines()
    assert page == f'report {report / "report.html"}' and (report / 'report.html').is_file()
    named = last.split(': ')[1].split(', ')
    assert {'figure_5.png', 'figure_5.svg', 'figure_6.png', 'figure_6.svg'} <= set(named)
    assert all((report / name).is_file() for name in named)
