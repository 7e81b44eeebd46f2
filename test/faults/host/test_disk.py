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

"""A full disk: one line names the path, status 1, and what was recorded stays readable."""

from __future__ import annotations

import json
from pathlib import Path
import subprocess
import sys
from typing import Any

from disktools import small_disk
from flexarm_ros import scenario
from flexarm_ros.cli import main
import pytest

LONG = ('--set', 'duration=2', '--set', 'recorder.compression=none', '--set', 'tick_timeout=3')
FULL = 'cannot be written: No space left on device'


def flexarm(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', *map(str, words)],
        capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def check_line(done: subprocess.CompletedProcess[str], *places: Path) -> None:
    """Check that one line says that the disk is full, with one of the paths, and nothing else."""
    assert done.returncode == 1, done.stderr
    lines = [line for line in done.stderr.splitlines() if 'No space left' in line]
    assert len(lines) == 1, done.stderr
    assert any(f'{place}: {FULL}' in lines[0] for place in places), lines[0]
    assert 'Traceback' not in done.stderr


def check_readable(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Check that what was recorded before the disk was full can be used."""
    summary = json.loads((run / 'summary.json').read_text())
    assert summary['stable'] is None and not summary['complete']
    assert main(['verify', str(run)]) == 0
    assert main(['recover', str(run), '--out', str(tmp_path / 'new')]) == 3
    assert 'in part: 12' in capsys.readouterr().out


def test_a_full_disk_under_a_simulation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with small_disk(tmp_path / 'disk', '600k') as disk:
        done = flexarm('simulate', 'fls_tip', *LONG, '--out', disk / 'run')
        check_line(done, disk / 'run/bag/bag_0.mcap')
        check_readable(disk / 'run', tmp_path, capsys)


def test_a_full_disk_under_the_rows_of_a_simulation(tmp_path: Path) -> None:
    """The bag is whole; the summary has the room that the rows have left."""
    with small_disk(tmp_path / 'disk', '160k') as disk:
        done = flexarm('simulate', 'fls_tip', '--set', 'duration=0.4', '--out', disk / 'run')
        check_line(done, disk / 'run/trajectory.csv')
        assert FULL in json.loads((disk / 'run/summary.json').read_text())['problem']
        assert not (disk / 'run/trajectory.csv.tmp').exists()
        assert main(['verify', str(disk / 'run')]) == 0


@pytest.mark.nodes
def test_a_full_disk_under_a_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with small_disk(tmp_path / 'disk', '600k') as disk:
        done = flexarm('run', 'fls_tip', *LONG, '--out', disk / 'run')
        check_line(done, disk / 'run/bag/bag_0.mcap')
        assert done.stderr.count('flexarm run: recorder: tick ') == 1
        check_readable(disk / 'run', tmp_path, capsys)


@pytest.mark.nodes
@pytest.mark.parametrize('size', ['8k', '12k', '16k'])
def test_a_disk_that_is_full_from_the_start(tmp_path: Path, size: str) -> None:
    with small_disk(tmp_path / 'disk', size) as disk:
        run = disk / 'run'
        check_line(flexarm('run', 'fls_tip', *LONG, '--out', run),
                   run / 'scenario.yaml', run / 'bag/bag_0.mcap')  # fmt: skip
        assert 'not finished' in json.loads((run / 'summary.json').read_text())['problem']
        assert not (run / 'bag-rescued').exists()


@pytest.mark.nodes
def test_a_disk_without_room_for_the_summary(tmp_path: Path) -> None:
    with small_disk(tmp_path / 'disk', '4k') as disk:
        done = flexarm('run', 'fls_tip', *LONG, '--out', disk / 'run')
        check_line(done, disk / 'run/summary.json')


@pytest.mark.nodes
def test_a_full_disk_under_the_logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nodes fly on without their logs; one that dies cannot say why, which is said."""
    from faulttools import NODE
    from flexarm_ros.launcher import run

    command = run.node_command
    faulty: list[str] = []

    def commanding(role: str, arguments: list[str]) -> list[str]:
        words = [sys.executable, str(NODE), role, 'import', '0', '--ros-args']
        return words if role in faulty else command(role, arguments)

    def fly(out: Path) -> Any:
        with small_disk(logs, '4k'):
            (logs / 'full').write_bytes(bytes(4096))
            return run.run_scenario(config, 'fls_tip', out, run.RunOptions())

    def prepare(directory: Path, *more: Any) -> None:
        prepare_directory(directory, *more)
        (directory / 'logs').symlink_to(logs)

    prepare_directory, logs = run.prepare_directory, tmp_path / 'logs'
    monkeypatch.setattr(run, 'node_command', commanding)
    monkeypatch.setattr(run, 'prepare_directory', prepare)
    config = scenario.load('fls_tip', ['duration=0.1', 'tick_timeout=3'])
    assert fly(tmp_path / 'fine').problem == ''
    logs.rmdir()
    faulty.append('encoder')
    assert fly(tmp_path / 'run').problem == (
        'encoder: start: ended with exit status 1: its output is lost: '
        f'{tmp_path}/run/logs/encoder.log: No space left on device'
    )


@pytest.mark.parametrize('words', [
    ['report', 'RUN', '--no-pictures', '--out', 'DISK/report'],
    ['export', 'RUN', '--out', 'DISK/csv'],
    ['recover', 'RUN', '--out', 'DISK/new'],
], ids=lambda words: words[0])  # fmt: skip
def test_a_full_disk_under_what_is_made_of_a_run(tmp_path: Path, words: list[str]) -> None:
    assert main(['simulate', 'fls_tip', '--set', 'duration=0.4', '--no-pictures',
                 '--out', str(tmp_path / 'run')]) == 0  # fmt: skip
    with small_disk(tmp_path / 'disk', '8k') as disk:
        done = flexarm(*(w.replace('DISK', str(disk)).replace('RUN', str(tmp_path / 'run'))
                         for w in words))  # fmt: skip
        assert done.returncode == 1
        (line,) = done.stderr.splitlines()
        assert f'flexarm {words[0]}: error: {disk}/' in line
        assert line.endswith('No space left on device')
