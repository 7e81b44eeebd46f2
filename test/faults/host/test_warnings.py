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

"""Warnings of dependencies end no process of ours, whatever PYTHONWARNINGS says."""

from __future__ import annotations

import os
from pathlib import Path
import re
import warnings

from flexarm_ros.core.warned import allow_warnings
from flexarm_ros.launcher.reports import RunWatch
from nodetools import finish, flexarm, start_node, write_scenario
import pytest

WARNING = """
import sys
import warnings


class Warner:
    def find_spec(self, name, path=None, target=None):
        if name in ('numba', 'numpy', 'yaml', 'rclpy', 'matplotlib'):
            warnings.warn(f'{name} warns', DeprecationWarning)
        return None


sys.meta_path.insert(0, Warner())
"""

SWEEP = """
scenario: pd_tip
set: {duration: 0.01}
grid: {controller.kp: [100.0, 150.0]}
"""

SUITE = """
cases:
- {scenario: pd_tip, mode: simulate, set: {duration: 0.01}}
"""

SHORT = ('--set', 'duration=0.01')


@pytest.fixture
def strict(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let every process start with warnings as errors, and imports that warn."""
    (tmp_path / 'site').mkdir()
    (tmp_path / 'site' / 'sitecustomize.py').write_text(WARNING)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path / 'site'), prepend=os.pathsep)
    monkeypatch.setenv('PYTHONWARNINGS', 'error')
    return tmp_path


def test_filters_lose_their_errors_and_nothing_else() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        warnings.filterwarnings('ignore', category=ResourceWarning)
        warnings.filterwarnings('error', message='no')
        before = list(warnings.filters)
        allow_warnings()
        assert [rest for _, *rest in warnings.filters] == [rest for _, *rest in before]
        assert [f[0] for f in warnings.filters[:3]] == ['default', 'ignore', 'default']
        with pytest.warns(UserWarning, match='no'):
            warnings.warn('no', UserWarning, stacklevel=1)


def test_commands_without_nodes(strict: Path) -> None:
    (strict / 'sweep.yaml').write_text(SWEEP)
    (strict / 'suite.yaml').write_text(SUITE)
    for words in (
        ('simulate', 'pd_tip', *SHORT, '--out', strict / 'run'),
        ('report', strict / 'run'),
        ('sweep', strict / 'sweep.yaml', '--workers', '2', '--out', strict / 'sweep'),
        ('suite', strict / 'suite.yaml', '--out', strict / 'suite'),
    ):
        done = flexarm(*words)
        assert done.returncode == 0, done.stdout + done.stderr
        assert 'numpy warns' in done.stderr  # it is the warning that is tested


@pytest.mark.nodes
@pytest.mark.parametrize('words', [(), ('--compose',)])
def test_runs(words: tuple[str, ...], strict: Path, ros_domain: int) -> None:
    done = flexarm('run', 'pd_tip', *SHORT, *words, '--no-pictures', '--out', strict / 'run')
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.nodes
def test_a_node_by_hand(strict: Path, ros_domain: int) -> None:
    parameters = write_scenario(strict / 's.yaml', 'pd_tip', 'start_timeout=0.1')
    (said,) = finish([start_node('encoder', parameters)])
    assert 'joined within 0.1 s' in said


@pytest.mark.nodes
def test_a_node_that_cannot_be_made_says_why(
    tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error is the verdict, not the signal that rclpy ends in with a half-made node."""
    (tmp_path / 'sitecustomize.py').write_text(
        "import sys\nsys.modules['rosidl_generator_py'] = None\n"  # what makes publishers
    )
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    done = flexarm('run', 'pd_tip', *SHORT, '--no-pictures', '--out', tmp_path / 'run')
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert re.fullmatch(r'flexarm run: \w+: NoTypeSupportImportedException: .*', last), last


def test_last_words_before_a_crash(tmp_path: Path) -> None:
    (tmp_path / 'plant.log').write_text('terminate called after throwing\n  what():  x\n\n')
    for status, said in (
        (-6, 'start: ended, killed by SIGABRT: what():  x'),
        (-9, 'start: ended, killed by SIGKILL'),
    ):
        watch = RunWatch(tmp_path)
        watch.ended('plant', status)
        assert watch.blame() == f'plant: {said}'
        watch.close()
