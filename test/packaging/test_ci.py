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

"""`.ci/run`, `scripts/test.sh` and `make pythons` where something is missing or fails."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest
from repository import ROOT

GOALS = ['make --no-print-directory test', 'make --no-print-directory pythons']


def script(directory: Path, name: str, body: str) -> None:
    path = directory / name
    path.write_text(f'#!/bin/sh\n{body}\n')
    path.chmod(0o755)


@pytest.fixture
def tools(tmp_path: Path) -> Path:
    """Return a directory that is all of PATH: no browser, and programs that note their use."""
    found = shutil.which('dirname')
    assert found is not None
    (tmp_path / 'dirname').symlink_to(found)
    script(tmp_path, 'id', 'echo 0')
    script(tmp_path, 'make', f'echo "make $*" >>{tmp_path}/log; [ "$*" != "$MAKE_FAILS" ]')
    return tmp_path


def run_ci(tools: Path, failing: str = '') -> tuple[subprocess.CompletedProcess[str], list[str]]:
    done = subprocess.run(
        ['/bin/bash', str(ROOT / '.ci' / 'run')],
        env={**os.environ, 'PATH': str(tools), 'MAKE_FAILS': failing},
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return done, (tools / 'log').read_text().splitlines()


@pytest.mark.parametrize('status', [0, 1])
def test_what_tests_need_is_installed_where_that_goes(tools: Path, status: int) -> None:
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log; exit {status}')
    done, log = run_ci(tools)
    assert done.returncode == 0
    for package in ('chromium', 'iproute2'):
        assert (f'no {package}: ' in done.stdout) == (status != 0)
    asked = [line for line in log if line.startswith('apt-get')]
    assert asked[0] == 'apt-get -qq update'
    assert [line.split()[-1] for line in asked[1:]] == ['chromium', 'iproute2']
    assert log[-2:] == GOALS


def test_nothing_is_installed_where_all_is_there(tools: Path) -> None:
    script(tools, 'chromium', 'exit 0')
    script(tools, 'ip', 'exit 0')
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log')
    done, log = run_ci(tools)
    assert done.returncode == 0
    assert log == GOALS


def test_nobody_but_root_is_asked_to_install(tools: Path) -> None:
    script(tools, 'id', 'echo 1000')
    script(tools, 'apt-get', f'echo "apt-get $*" >>{tools}/log')
    assert run_ci(tools)[1] == GOALS


@pytest.mark.parametrize('goal', ['test', 'pythons'])
def test_all_parts_run_and_one_that_fails_fails_all(tools: Path, goal: str) -> None:
    script(tools, 'id', 'echo 1000')
    done, log = run_ci(tools, failing=f'--no-print-directory {goal}')
    assert done.returncode == 1
    assert log == GOALS


TRIED = """
from pathlib import Path
import pytest

@pytest.mark.nodes
@pytest.mark.parametrize('passes_at', [1, 2, 3])
def test_it(passes_at):
    tries = Path(f'tries-{passes_at}')
    count = len(tries.read_text()) + 1 if tries.exists() else 1
    tries.write_text('x' * count)
    assert count >= passes_at

@pytest.mark.nodes
def test_it_too():
    assert not Path('fails').exists()

def test_without_nodes():
    assert not Path('fails-without-nodes').exists()
"""
"""Tests of which one passes at its first try, one at the second and one at the third."""


def run_tests(root: Path, *words: str, jobs: str = '0') -> tuple[int, str]:
    """Run `scripts/test.sh` on `TRIED` in a tree of its own."""
    (root / 'scripts').mkdir()
    (root / 'venv' / 'bin').mkdir(parents=True)
    shutil.copy(ROOT / 'scripts' / 'test.sh', root / 'scripts')
    script(root / 'venv' / 'bin', 'python', f'exec {sys.executable} "$@"')
    (root / 'pytest.ini').write_text('[pytest]\nmarkers =\n    nodes\n    slow\n')
    (root / 'test_tried.py').write_text(TRIED)
    done = subprocess.run(
        [root / 'scripts' / 'test.sh', *words],
        env={
            **os.environ, 'VENV': 'venv', 'TEST_JOBS': '0', 'NODE_JOBS': jobs,
            'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'PYTEST_PLUGINS': 'xdist.plugin',  # quicker
        },
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120,
    )  # fmt: skip
    return done.returncode, done.stdout


@pytest.mark.parametrize('jobs', ['0', '2'])
def test_a_test_of_nodes_has_a_second_try_which_is_told(tmp_path: Path, jobs: str) -> None:
    status, said = run_tests(tmp_path, '-k', 'not 3', jobs=jobs)
    assert status == 0, said
    last = said.splitlines()[-1]
    assert last == 'passed only at the second try: test_tried.py::test_it[2] '
    tries = {path.name: len(path.read_text()) for path in tmp_path.glob('tries-*')}
    assert tries == {'tries-1': 1, 'tries-2': 2}


def test_a_test_of_nodes_has_no_third_try(tmp_path: Path) -> None:
    status, said = run_tests(tmp_path)
    assert status == 1
    assert said.splitlines()[-1] == 'passed only at the second try: test_tried.py::test_it[2] '
    assert (tmp_path / 'tries-3').read_text() == 'xx'


def test_only_tests_of_nodes_have_a_second_try(tmp_path: Path) -> None:
    (tmp_path / 'fails-without-nodes').touch()
    status, said = run_tests(tmp_path, '-k', 'not 3')
    assert status == 1
    assert 'passed only at the second try' in said


def test_where_the_first_failure_ends_the_tests_there_is_no_second_try(tmp_path: Path) -> None:
    status, said = run_tests(tmp_path, '-x')
    assert status == 1
    assert 'second try' not in said
    assert not (tmp_path / 'tries-3').exists()


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    """Return a tree with `scripts/pythons.sh`, Python 3.10 and 3.12, where nothing fails."""
    root = tmp_path / 'tree'
    (root / 'scripts').mkdir(parents=True)
    (root / 'bin').mkdir()
    shutil.copy(ROOT / 'scripts' / 'pythons.sh', root / 'scripts')
    script(root / 'scripts', 'lock.sh', 'exit "${LOCK:-0}"')
    script(
        root / 'scripts', 'env.sh',
        'mkdir -p "$VENV/bin"; cp bin/flexarm bin/python "$VENV/bin"\n'
        'echo "$WHEELS $PYTHON" >>log',
    )  # fmt: skip
    script(
        root / 'bin', 'flexarm',
        '[ "$1" = "${FAILS:-}" ] && echo "said by $*" >&2 && exit 1\n'
        'case "$1 $2" in digest*${OTHER:-none}*) echo 2;; digest*) echo 1;; esac',
    )  # fmt: skip
    script(
        root / 'bin', 'python',
        'case "$*" in *pytest*) echo "pytest in $0"; [ -z "${PYTEST:-}" ];;'
        ' *) echo Python 3.x;; esac',
    )  # fmt: skip
    for name in ('python3.10', 'python3.12'):
        script(root / 'bin', name, f'echo /opt/{name}')
    for name in ('python3.11', 'python3.13'):  # as pyenv leaves them where there is none
        script(root / 'bin', name, 'exit 127')
    return root


def run_pythons(tree: Path, **variables: str) -> tuple[int, list[str]]:
    kept = {name: os.environ[name] for name in ('PATH', 'HOME') if name in os.environ}
    kept['PATH'] = f'{tree / "bin"}:{kept["PATH"]}'
    done = subprocess.run(
        [tree / 'scripts' / 'pythons.sh'], env={**kept, **variables},
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    return done.returncode, done.stdout.splitlines()


def test_each_python_has_a_line_and_one_that_is_missing_says_so(tree: Path) -> None:
    status, lines = run_pythons(tree)
    assert status == 0, lines
    told = sorted(line for line in lines if line.startswith('Python'))  # two stages at a time
    assert [line.split()[1:3] for line in told] == [
        ['3.10', 'kilted'], ['3.11', 'kilted'], ['3.12', 'jazzy'], ['3.12', 'kilted'],
        ['3.13', 'kilted'],
    ]  # fmt: skip
    assert [' ok: ' in line for line in told] == [True, False, True, True, False]
    assert all(f'cannot run: no python{line.split()[1]}' in line for line in (told[1], told[4]))
    assert sorted((tree / 'log').read_text().splitlines()) == [
        'jazzy /opt/python3.12', 'kilted /opt/python3.10', 'kilted /opt/python3.12',
    ]  # fmt: skip
    assert [line for line in lines if line.startswith('pytest')] == [
        'pytest in .venvs/jazzy-3.12/bin/python'
    ]


@pytest.mark.parametrize(
    ('variables', 'failed', 'shown'),
    [
        ({'FAILS': 'run'}, 'run', 'said by run fls_tip'),
        ({'FAILS': 'verify'}, 'verify', 'said by verify'),
        ({'FAILS': 'digest'}, 'digest', 'said by digest'),
        ({'OTHER': 'jazzy'}, 'same_bytes', './jazzy-3.12.digest:2'),
        ({'PYTEST': 'fails'}, 'tests', 'pytest in'),
        ({'LOCK': '1'}, 'not what scripts/lock.sh writes', ''),
    ],
)
def test_a_stage_that_fails_is_named_and_fails_all(
    tree: Path, variables: dict[str, str], failed: str, shown: str
) -> None:
    status, lines = run_pythons(tree, **variables)
    assert status == 1
    assert any(line.endswith(f'FAILED: {failed}') for line in lines)
    assert any(line.startswith(shown) for line in lines)
    assert sum(line.startswith('Python') for line in lines) == 5


def test_where_a_ros_2_is_sourced_the_wheels_are_not_tried(tree: Path) -> None:
    status, lines = run_pythons(tree, ROS_DISTRO='jazzy')
    assert status == 0
    assert lines == ['Runs on every Python: cannot run: ROS 2 jazzy is sourced']
    assert not (tree / 'log').exists()
