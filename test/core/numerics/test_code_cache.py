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

"""Compiled code that is kept between processes: never stale, never the reason for a failure."""

from __future__ import annotations

import os
from pathlib import Path
import shutil
import subprocess
import sys

from disktools import small_disk
from flexarm_ros import code_cache
import pytest

PROGRAM = (
    'from flexarm_ros.core.arm.kinematics import rigid_point\n'
    'print(rigid_point(1.0, 1.0, 0.0, 0.0, 0.0, 0.0))'
)
RIGHT = '(2.0, 0.0, -0.0, 0.0)'


class Copy:
    """A copy of the package, and a place for its user's cache."""

    def __init__(self, directory: Path) -> None:
        self.package = directory / 'flexarm_ros'
        ignored = shutil.ignore_patterns('__pycache__')
        shutil.copytree(code_cache.PACKAGE, self.package, ignore=ignored)
        self.home = directory / 'home'

    def answer(self, **environment: str) -> str:
        """Return what a process that uses the copy prints."""
        return self.run(**environment).stdout.strip()

    def run(self, program: str = PROGRAM, **environment: str) -> subprocess.CompletedProcess[str]:
        """Return a process that has used the copy."""
        own = {k: v for k, v in os.environ.items() if k != 'NUMBA_CACHE_DIR'}
        own |= {'PYTHONPATH': str(self.package.parent), 'XDG_CACHE_HOME': str(self.home)}
        return subprocess.run(
            [sys.executable, '-c', program], env=own | environment, cwd=self.package.parent,
            capture_output=True, text=True, check=True, timeout=120,
        )  # fmt: skip

    def states(self) -> list[Path]:
        """Return the directories of compiled code in the copy."""
        return sorted((self.package / '__pycache__').glob(f'{code_cache.PREFIX}*'))


@pytest.fixture(scope='module')
def copy(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    made = Copy(tmp_path_factory.mktemp('copy'))
    assert made.answer() == RIGHT
    assert len(made.states()) == 1 and list(made.states()[0].rglob('*.nbc'))
    return made


def test_a_changed_callee_gives_the_new_number(copy: Copy) -> None:
    """Numba alone looks at the caller's file only: that one is not touched."""
    callee = copy.package / 'core' / 'numerics' / 'elementary.py'
    before = callee.read_text('utf-8')
    callee.write_text(before.replace('return x, 1.0', 'return x, 3.0'), 'utf-8')
    assert copy.answer() == '(6.0, 0.0, -0.0, 0.0)'
    assert len(copy.states()) == 2
    callee.write_text(before, 'utf-8')
    assert copy.answer() == RIGHT


def test_old_states_are_cleared(copy: Copy) -> None:
    stale = [copy.package / '__pycache__' / f'{code_cache.PREFIX}old{i}' for i in range(6)]
    for number, path in enumerate(stale):
        path.mkdir()
        os.utime(path, (number, number))
    left = copy.package / 'core' / '__pycache__' / 'left.py311.1.nbc'
    left.parent.mkdir(exist_ok=True)
    left.touch()
    for state in copy.states():
        if any(state.rglob('*.nbi')):
            shutil.rmtree(state)
    assert copy.answer() == RIGHT
    assert len(copy.states()) == code_cache.KEPT
    assert not stale[0].exists() and not left.exists()


@pytest.mark.parametrize(('suffix', 'share'), [('nbi', 0.0), ('nbc', 0.5)])
def test_a_file_cut_short_is_written_anew(copy: Copy, suffix: str, share: float) -> None:
    assert copy.answer() == RIGHT
    files = [path for state in copy.states() for path in state.rglob(f'*.{suffix}')]
    whole = {path: path.stat().st_size for path in files}
    for path, size in whole.items():
        os.truncate(path, int(share * size))
    assert copy.answer() == RIGHT
    assert any(path.stat().st_size == size for path, size in whole.items())


def test_what_cannot_be_written_is_passed_over(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    (copy.package / '__pycache__').touch()  # no directory can be made there
    assert copy.answer() == RIGHT
    assert list(copy.home.glob(f'flexarm_ros/{code_cache.PREFIX}*/**/*.nbc'))
    assert copy.answer(XDG_CACHE_HOME='/dev/null') == RIGHT


def test_the_users_own_place_is_used(copy: Copy, tmp_path: Path) -> None:
    assert copy.answer(NUMBA_CACHE_DIR=str(tmp_path)) == RIGHT
    assert list(tmp_path.glob(f'{code_cache.PREFIX}*/**/*.nbc'))


def test_that_nothing_can_be_kept_is_said_once(tmp_path: Path) -> None:
    copy = Copy(tmp_path)
    (copy.package / '__pycache__').touch()
    again = f'import subprocess, sys\nsubprocess.run([sys.executable, "-c", {PROGRAM!r}])'
    done = copy.run(f'{PROGRAM}\n{again}', XDG_CACHE_HOME='/dev/null')
    assert done.stdout.split('\n') == [RIGHT, RIGHT, '']
    (line,) = done.stderr.splitlines()
    assert line.startswith(code_cache.COMPLAINT)
    assert f'{copy.package}/__pycache__/' in line and '/dev/null/flexarm_ros/' in line


def test_a_full_disk_under_the_cache_is_named_once(copy: Copy, tmp_path: Path) -> None:
    more = 'from flexarm_ros.core.control.fls import fls_lambda\nfls_lambda(0.1, 0.1)'
    with small_disk(tmp_path / 'disk', '8k') as disk:
        done = copy.run(f'{PROGRAM}\n{more}', NUMBA_CACHE_DIR=str(disk))
        assert done.stdout.strip() == RIGHT
        (line,) = done.stderr.splitlines()
        assert line.startswith(f'{code_cache.COMPLAINT}{disk}/')
        assert line.endswith('(No space left on device)')
        assert not list(disk.rglob('*.tmp*'))
        assert copy.answer(NUMBA_CACHE_DIR=str(disk)) == RIGHT  # what there is of it is whole


@pytest.mark.slow
@pytest.mark.nodes
def test_a_full_disk_under_the_cache_of_a_run_is_named_once(tmp_path: Path) -> None:
    """Its nodes are forks of a process whose output is not the terminal's."""
    words = ['run', 'pd_tip', '--set', 'duration=0.01', '--no-pictures']
    with small_disk(tmp_path / 'disk', '128k') as disk:
        done = subprocess.run(
            [sys.executable, '-m', 'flexarm_ros.cli', *words, '--out', str(tmp_path / 'run')],
            env=os.environ | {'NUMBA_CACHE_DIR': str(disk)},
            capture_output=True, text=True, check=False, timeout=120,
        )  # fmt: skip
    assert done.returncode == 0, done.stderr
    said = [line for line in done.stderr.splitlines() if code_cache.COMPLAINT in line]
    assert len(said) == 1 and f'{disk}/' in said[0]


def test_what_is_compiled_needs_no_scipy_linalg() -> None:
    """Where numba imports it, a process takes 0.2 s longer to start. It is there for others."""
    code = (
        'import sys\n'
        'from flexarm_ros import scenario\n'
        "scenario.load('fls_tip', [])\n"  # calls the inverse kinematics
        "print('scipy.linalg' in sys.modules)\n"
        'import scipy.linalg.cython_blas\n'
    )
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stdout) == (0, 'False\n'), done.stderr
