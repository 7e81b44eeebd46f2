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

"""The pytest plugin, and nodes of the user's that the launcher starts."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from flexarm_ros.launcher.processes import NodeProcesses
from flexarm_ros.scenario import ScenarioError
from nodetools import flexarm_here
import pytest
from repository import ROOT

EXAMPLES = ROOT / 'examples'
EXAMPLE = [sys.executable, EXAMPLES / 'minimal_controller.py']
Fly = Callable[..., Any]

SUITE = """
defaults: {set: {duration: 0.3}}
cases:
  - scenario: pd_collocated
    name: killed
    faults: [{at: 0.1, node: controller, action: kill}]
    expect:
      {stable: null, status: 1, ticks: 100, problem: {contains: "controller: tick 100: ended"}}
"""


@pytest.mark.nodes
def test_the_example_test_passes(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, '-m', 'pytest', '-p', 'no:cacheprovider', '-rP', '-c', '/dev/null',
         f'--rootdir={tmp_path}', f"--basetemp={tmp_path / 'runs'}",
         EXAMPLES / 'test_my_controller.py'],
        cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout
    assert '1 passed' in done.stdout
    assert 'flexarm: pd_collocated: completed; see ' in done.stdout


def test_the_page_shows_the_example_that_is_tested() -> None:
    text = (EXAMPLES / 'test_my_controller.py').read_text()
    body = text.partition('def test_')[2].strip()
    assert body
    assert f'def test_{body}' in (ROOT / 'docs' / 'testing.md').read_text()


@pytest.mark.nodes
def test_a_node_that_dies_is_named_with_its_last_words(flexarm_run: Fly) -> None:
    code = "raise SystemExit('no torque today')"
    flight = flexarm_run(
        'pd_tip', {'duration': 1.0}, nodes={'controller': [sys.executable, '-c', code]}
    )
    assert flight.problem == 'controller: start: ended with exit status 1: no torque today'
    assert not flight.stable
    assert flight['complete'] is False
    assert flight['external'] == ['controller']
    assert flight.log('controller') == 'no torque today\n'


@pytest.mark.nodes
def test_a_suite_flies_the_users_node(flexarm_suite: Fly, tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text(SUITE)
    result = flexarm_suite(tmp_path / 'mine.yaml', nodes={'controller': EXAMPLE})
    assert not result.failures(), result.failures()
    assert result.passed
    verdict = flexarm_here('verify', tmp_path / 'mine' / 'killed')
    assert verdict.returncode == 0, verdict.stdout
    assert 'external, taken as recorded: controller' in verdict.stdout


def test_a_simulation_needs_no_ros(flexarm_run: Fly) -> None:
    first = flexarm_run('fls_tip', {'duration': 0.2, 'plant.length': [4.4, 4.6]}, mode='simulate')
    second = flexarm_run('fls_tip', {'duration': 0.2}, mode='simulate')
    assert first.stable
    assert first['ticks'] == 200
    assert first['scenario']['plant']['length'] == [4.4, 4.6]
    assert first.directory != second.directory
    assert first['max_error'] != second['max_error']
    assert len(first.trajectory['theta1']) == 200
    assert first.trajectory['t'][-1] == 0.199
    assert first.verify().same


def test_what_cannot_be_flown_is_an_error(flexarm_run: Fly, tmp_path: Path) -> None:
    with pytest.raises(ScenarioError, match='controler'):
        flexarm_run('fls_tip', {'controler.kp': 1.0})
    with pytest.raises(ValueError, match="mode 'fly' is not allowed"):
        flexarm_run('fls_tip', mode='fly')
    with pytest.raises(ValueError, match='starts no nodes'):
        flexarm_run('fls_tip', nodes={'controller': EXAMPLE}, mode='simulate')
    with pytest.raises(ValueError, match='plant: not a node to replace'):
        flexarm_run('fls_tip', nodes={'plant': EXAMPLE})
    with pytest.raises(FileNotFoundError, match='no such command'):
        flexarm_run('fls_tip', nodes={'controller': ['no-such-command']})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('command', ['run', 'suite'])
@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ('plant=true', "'plant' is not one of encoder"),
        ('controller', "no such command: ''"),
        ('controller=no-such-command -x', "no such command: 'no-such-command'"),
        ("controller='", 'no closing quotation'),
    ],
)
def test_a_bad_node_is_refused(command: str, given: str, words: str, tmp_path: Path) -> None:
    out = tmp_path / 'out'
    done = flexarm_here(
        command, 'pd_tip' if command == 'run' else 'smoke', '--node', given, '--out', out
    )
    assert done.returncode == 2
    assert words in done.stderr
    assert not out.exists()


@pytest.mark.nodes
@pytest.mark.parametrize('mode', [['--compose'], pytest.param([], marks=pytest.mark.slow)])
def test_run_starts_and_ends_the_users_node(mode: list[str], tmp_path: Path) -> None:
    command = f'{sys.executable} examples/minimal_controller.py'
    done = flexarm_here('run', 'pd_collocated', '--set', 'duration=0.2', '--no-pictures', *mode,
                        '--node', f'controller={command}', '--out', tmp_path / 'run')  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / 'run' / 'trajectory.csv').read_text().splitlines()) == 201
    assert re.search(r'^external +controller$', done.stdout, re.MULTILINE)
    summary = json.loads((tmp_path / 'run' / 'summary.json').read_text())
    assert summary['external'] == ['controller'] and 'controller' not in summary['scenario']
    verdict = flexarm_here('verify', tmp_path / 'run')
    assert verdict.returncode == 0, verdict.stdout
    assert 'external, taken as recorded: controller' in verdict.stdout


def test_a_users_node_may_leave_behind_the_last_tick_only(tmp_path: Path) -> None:
    quits = [sys.executable, '-c', 'pass']
    for done, deaths in ((set(), [('controller', 0)]), ({'plant'}, [])):
        with NodeProcesses({}, {}, tmp_path / 'logs', {'controller': quits}) as nodes:
            nodes.report.done |= done
            while nodes.running:
                nodes.poll(0.05)
            assert nodes.deaths == deaths
            assert nodes.ours == []
