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

"""Paths of any bytes, locales and streams of any kind: it works, or one line says why not."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys

from flexarm_ros import scenario
from flexarm_ros.scenario.yaml.rclyaml import quoted
import pytest
from repository import ROOT

SHORT = ('--set', 'duration=0.01', '--no-pictures')
REPLAY = ('--rate', '0', '--delay', '0')
ARM, RAW = 'o_\U0001f9be', os.fsdecode(b'o_\xff')
C_LOCALE = {'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}
ASCII = {'PYTHONIOENCODING': 'ascii'}
SWEEP = 'scenario: pd_tip\nset: {duration: 0.01}\ngrid: {controller.kp: [100.0, 150.0]}\n'


def flexarm(place: Path, *words: str, closed: bool = False, **variables: str) -> tuple[int, str]:
    """Run a command; return its exit status and what it printed, bytes as Python escapes."""

    def close() -> None:
        os.closerange(0, 3)

    done = subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', *map(os.fsencode, words)],
        env={**os.environ, 'PYTHONPATH': str(ROOT), **variables}, cwd=place, timeout=120,
        check=False, preexec_fn=close if closed else None,
        stdout=None if closed else subprocess.PIPE,
        stderr=None if closed else subprocess.STDOUT,
    )  # fmt: skip
    said = (done.stdout or b'').decode(errors='backslashreplace')
    assert 'Traceback' not in said and 'internal error' not in said, said
    return done.returncode, said


@pytest.mark.parametrize('variables', [ASCII, C_LOCALE], ids=['ascii', 'C'])
def test_commands_without_nodes(variables: dict[str, str], tmp_path: Path) -> None:
    name = 'o' if variables is C_LOCALE else ARM
    (tmp_path / 'sweep.yaml').write_text(SWEEP)
    for words in (
        ('simulate', 'pd_tip', *SHORT, '--out', name),
        ('verify', name),
        ('report', name, '--no-pictures'),
        ('recover', name, '--out', f'{name}/rescued'),
        ('export', name, '--out', f'{name}/table'),
        ('sweep', 'sweep.yaml', '--workers', '1', '--no-pictures', '--out', f'{name}/sweep'),
        ('list',),
        ('--help',),
    ):
        status, said = flexarm(tmp_path, *words, **variables)
        assert status == 0, said


@pytest.mark.parametrize(('name', 'variables'), [(RAW, {}), (ARM, C_LOCALE)], ids=['raw', 'C'])
def test_what_is_no_text_is_refused_in_one_line(
    name: str, variables: dict[str, str], tmp_path: Path
) -> None:
    (tmp_path / 'sweep.yaml').write_text(SWEEP)
    (tmp_path / f'{name}.yaml').write_bytes((ROOT / 'config' / 'pd_tip.yaml').read_bytes())
    before = sorted(tmp_path.iterdir())
    for words in (
        ('run', 'pd_tip', *SHORT, '--out', name),
        ('simulate', 'pd_tip', *SHORT, '--out', name),
        ('simulate', f'{name}.yaml', *SHORT, '--out', 'run'),
        ('sweep', 'sweep.yaml', '--out', name),
        ('suite', 'smoke', '--out', name),
        ('replay', name),
    ):
        status, said = flexarm(tmp_path, *words, **variables)
        assert (status, said.count('\n')) == (2, 1), said
        assert 'not UTF-8, or the locale is not (try LC_ALL=C.UTF-8)' in said
    assert sorted(tmp_path.iterdir()) == before


def test_runs_below_a_path_that_is_no_text_are_read(tmp_path: Path) -> None:
    assert flexarm(tmp_path, 'simulate', 'pd_tip', *SHORT, '--out', 'run')[0] == 0
    (tmp_path / 'run').rename(tmp_path / RAW)
    for words in (
        ('verify', RAW),
        ('report', RAW),
        ('recover', RAW, '--out', f'{RAW}/rescued'),
        ('export', RAW, '--out', f'{RAW}/table'),
    ):
        status, said = flexarm(tmp_path, *words)
        assert status == 0, said


@pytest.mark.nodes
def test_a_run_without_standard_streams(tmp_path: Path, ros_domain: int) -> None:
    for words in (
        ('run', 'pd_tip', *SHORT, '--out', 'run'),
        ('simulate', 'pd_tip', *SHORT, '--out', 'simulated'),
        ('compare', 'run', 'simulated'),
        ('replay', 'run', *REPLAY),
        ('list',),
        ('--help',),
    ):
        assert flexarm(tmp_path, *words, closed=True)[0] == 0, words
    assert (tmp_path / 'run' / 'summary.json').is_file()


@pytest.mark.nodes
def test_a_run_in_the_ascii_of_its_streams(tmp_path: Path, ros_domain: int) -> None:
    for words in (('run', 'pd_tip', *SHORT, '--out', ARM), ('replay', ARM, *REPLAY)):
        status, said = flexarm(tmp_path, *words, **ASCII)
        assert status == 0, said


@pytest.mark.parametrize('text', ['a\U0001f9be"\\ud83e\n', '\x7f\x85\ufeff', ['é', 1e-5, True]])
def test_quoted_text_reads_back(text: object) -> None:
    import yaml

    assert yaml.safe_load(quoted(text)) == (
        text if isinstance(text, str) else ['é', '1e-05', True]
    )


def test_a_settings_file_may_have_any_name(tmp_path: Path) -> None:
    file = tmp_path / f'{ARM}.csv'
    file.write_bytes((ROOT / 'config' / 'open_loop.csv').read_bytes())
    config = scenario.load('open_loop', [f'controller.torque_file={quoted(str(file))}'])
    assert config.torques
