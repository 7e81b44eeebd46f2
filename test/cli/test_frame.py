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

"""The command line's frame: exit statuses, short errors, quick help, pipes and signals."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from flexarm_ros import scenario
import flexarm_ros.cli as cli
from flexarm_ros.cli.signals import Deferred, Interrupted
import pytest

COMMAND = [sys.executable, '-m', 'flexarm_ros.cli']


def flexarm(*words: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(  # type: ignore[call-overload, no-any-return]
        [*COMMAND, *words], capture_output=True, text=True, timeout=120, **options
    )


def test_help_names_every_command_and_imports_none_of_them() -> None:
    code = (
        "import sys; from flexarm_ros.cli import main; status = main(['--help'])\n"
        "heavy = {'numpy', 'numba', 'yaml', 'rclpy', 'rich', 'matplotlib'} & set(sys.modules)\n"
        "sys.exit(f'imported: {heavy}' if heavy else status)"
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, '')
    for name in ('list', 'simulate', 'run'):
        assert f'\n    {name} ' in done.stdout


@pytest.mark.parametrize('name', sorted(cli.COMMANDS))
def test_every_command_has_help(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([name, '--help']) == 0
    assert f'usage: flexarm {name}' in capsys.readouterr().out


@pytest.mark.parametrize(
    'words',
    [
        [], ['simulat'], ['list', '--foo'], ['simulate'], ['simulate', 'fls_tpi'],
        ['simulate', 'fls_tip', '--set', 'plant.modes=9'],
        ['simulate', 'fls_tip', '--set', 'kp=1'],
        ['simulate', 'fls_tip', '--set', 'trajectory.side=99'],
        ['simulate', 'fls_tip', '--out'],
        ['simulate', 'none/there.yaml'],
    ],
)  # fmt: skip
def test_bad_usage_ends_with_status_2_and_at_most_two_lines(
    words: list[str],
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert cli.main(words) == 2
    shown = capsys.readouterr()
    assert shown.out == ''
    assert 1 <= len(shown.err.splitlines()) <= 2
    assert 'Traceback' not in shown.err
    assert not list(tmp_path.iterdir())


def test_list_shows_a_line_for_each_shipped_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(['list']) == 0
    lines = capsys.readouterr().out.splitlines()
    shipped = [*scenario.shipped(), *scenario.shipped_suites(), *scenario.shipped_sweeps()]
    assert [line.split()[0] for line in lines] == shipped
    assert all(len(line.split(maxsplit=2)) == 3 for line in lines), 'a file lacks a description'
    assert cli.main(['list', '--paths']) == 0
    paths = [Path(line.split()[2]) for line in capsys.readouterr().out.splitlines()]
    assert all(path.is_file() for path in paths)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(['--version']) == 0
    assert capsys.readouterr().out.startswith('flexarm ')


def test_output_to_a_reader_that_left_is_no_error() -> None:
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run([*COMMAND, 'list'], stdout=write, stderr=subprocess.PIPE, timeout=60)
    os.close(write)
    assert (done.returncode, done.stderr) == (0, b'')


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='needs /dev/full')
def test_output_to_a_full_disk_is_an_error() -> None:
    with open('/dev/full', 'w') as full:
        done = subprocess.run([*COMMAND, 'list'], stdout=full, stderr=subprocess.PIPE, timeout=60)
    assert done.returncode == 1
    assert done.stderr == b'flexarm list: error: No space left on device\n'


@pytest.mark.parametrize(
    ('error', 'status', 'text'),
    [
        (scenario.ScenarioError('a.b: 1 is bad'), 2, 'flexarm list: error: a.b: 1 is bad\n'),
        (cli.UsageError('no'), 2, 'flexarm list: error: no\n'),
        (OSError(28, 'No space left', '/x'), 1, 'flexarm list: error: /x: No space left\n'),
        (
            RuntimeError('odd\nthing'), 1,
            'flexarm list: internal error: RuntimeError: odd\\nthing\n'
            '(FLEXARM_DEBUG=1 shows where)\n',
        ),
        (Interrupted(signal.SIGINT), 130, 'flexarm: stopped by SIGINT\n'),
        (Interrupted(signal.SIGTERM), 143, 'flexarm: stopped by SIGTERM\n'),
        (Interrupted(signal.SIGHUP), 129, 'flexarm: stopped by SIGHUP\n'),
    ],
)  # fmt: skip
def test_an_error_within_a_command_becomes_a_status_and_a_line(
    error: BaseException,
    status: int,
    text: str,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail() -> None:
        raise error

    monkeypatch.delenv('FLEXARM_DEBUG', raising=False)
    monkeypatch.setattr('flexarm_ros.scenario.locate.shipped', fail)
    assert cli.main(['list']) == status
    assert capsys.readouterr().err == text


def test_flexarm_debug_shows_the_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail() -> None:
        raise RuntimeError('odd')

    monkeypatch.setenv('FLEXARM_DEBUG', '1')
    monkeypatch.setattr('flexarm_ros.scenario.locate.shipped', fail)
    with pytest.raises(RuntimeError, match='odd'):
        cli.main(['list'])


def test_a_hang_up_that_nohup_ignores_stays_ignored() -> None:
    old = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with Deferred() as signals:
            os.kill(os.getpid(), signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
        assert signals.status == 0
    finally:
        signal.signal(signal.SIGHUP, old)


@pytest.mark.parametrize(
    ('signum', 'status'), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)]
)
def test_a_deferred_signal_is_noted_and_nothing_is_raised(signum: int, status: int) -> None:
    with Deferred() as signals:
        assert signals.status == 0
        os.kill(os.getpid(), signum)
        deadline = time.monotonic() + 5.0
        while not signals.signum and time.monotonic() < deadline:
            pass
    assert signals.status == status
