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

"""Processes as forks of one: each is what it would be by itself, but for its addresses."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import ctypes
import os
from pathlib import Path
import signal
import subprocess
import sys

from flexarm_ros.launcher.fork.parent import Adopted, can_fork, NotForked, start
from flexarm_ros.launcher.processes import NodeProcesses
from nodetools import flexarm_here, ROLES, wait_for
import pytest
from repository import PATH

pytestmark = pytest.mark.usefixtures('fresh_processes')

ENV = {**os.environ, 'PYTHONPATH': PATH}


def commands(**words: str) -> dict[str, list[str]]:
    """Return a command for each name."""
    return {
        name: [sys.executable, '-m', 'forkedchild', word, f'of {name}']
        for name, word in words.items()
    }


@contextlib.contextmanager
def running(tmp_path: Path, **words: str) -> Iterator[tuple[dict[str, Adopted], dict[str, int]]]:
    """Start a process for each word: yields them, and the other ends of their standard inputs."""
    with contextlib.ExitStack() as stack:
        files, ends = {}, {}
        for name in words:
            read, ends[name] = os.pipe()
            log = stack.enter_context(open(tmp_path / name, 'wb')).fileno()
            files[name] = (read, log, log)
        try:
            started = start(commands(**words), files, ENV, modules=())
        finally:
            for three in files.values():
                os.close(three[0])
        try:
            yield started, ends
        finally:
            for process in started.values():
                process.kill()
                process.wait()
            for end in ends.values():
                os.close(end)


def test_each_is_what_its_command_says(tmp_path: Path) -> None:
    with running(tmp_path, one='where', other='where') as (started, _):
        assert [process.wait(30) for process in started.values()] == [0, 0]
    for name in started:
        words = commands(**{name: 'where'})[name]
        said = (tmp_path / name).read_text().split(maxsplit=1)[1]
        assert said == f'{words[3:]} {words[1:]} True __main__\n'


def test_they_share_addresses_that_the_next_ones_do_not_have(tmp_path: Path) -> None:
    places = []
    for _ in range(2):
        with running(tmp_path, one='where', other='where') as (started, _):
            assert [process.wait(30) for process in started.values()] == [0, 0]
        one, other = ((tmp_path / name).read_text().split()[0] for name in ('one', 'other'))
        assert one == other
        places.append(one)
    randomized = Path('/proc/sys/kernel/randomize_va_space').read_text().strip() != '0'
    if randomized and not ctypes.CDLL(None).personality(0xFFFFFFFF) & 0x40000:
        assert places[0] != places[1]


def test_the_process_table_shows_the_command_and_us_as_parent(tmp_path: Path) -> None:
    with running(tmp_path, one='wait', another='wait') as (started, _):
        for name, process in started.items():
            shown = Path(f'/proc/{process.pid}/cmdline')
            wanted = b''.join(word.encode() + b'\0' for word in commands(**{name: 'wait'})[name])
            wait_for(lambda: shown.read_bytes() == wanted, 60, 'its command line')  # noqa: B023
            status = Path(f'/proc/{process.pid}/stat').read_text().rpartition(')')[2].split()
            assert int(status[1]) == os.getpid()


def test_exit_statuses(tmp_path: Path) -> None:
    with running(tmp_path, three='3', killed='sleep', none='0', raises='error') as (started, _):
        started['killed'].send_signal(signal.SIGTERM)
        statuses = {name: process.wait(30) for name, process in started.items()}
        assert statuses == {'three': 3, 'killed': -signal.SIGTERM, 'none': 0, 'raises': 1}
        started['none'].send_signal(signal.SIGTERM)  # nobody's process by now
    assert 'OSError: nobody foresaw it' in (tmp_path / 'raises').read_text()


def test_a_process_that_runs_has_no_status(tmp_path: Path) -> None:
    with running(tmp_path, one='wait', other='wait') as (started, ends):
        assert started['one'].poll() is None
        with pytest.raises(subprocess.TimeoutExpired):
            started['one'].wait(0.05)
        os.close(ends.pop('one'))  # the other process does not hold it open
        assert started['one'].wait(30) == 0
        assert started['other'].poll() is None


def test_none_holds_what_is_anothers(tmp_path: Path) -> None:
    with running(tmp_path, one='open', other='open') as (started, _):
        assert [process.wait(30) for process in started.values()] == [0, 0]
    # 0, 1, 2 and the folder that is being read
    assert [(tmp_path / name).read_text() for name in started] == ['4\n', '4\n']


def test_what_cannot_be_imported(tmp_path: Path) -> None:
    with open(tmp_path / 'log', 'wb') as log:
        files = dict.fromkeys(('one', 'other'), (0, log.fileno(), log.fileno()))
        with pytest.raises(NotForked, match='No module named .no_such_module'):
            start(commands(one='0', other='0'), files, ENV, modules=('no_such_module',))


def test_what_is_imported_may_print(tmp_path: Path) -> None:
    (tmp_path / 'chatty.py').write_text('print("hello")')
    env = {**ENV, 'PYTHONPATH': os.pathsep.join([ENV['PYTHONPATH'], str(tmp_path)])}
    with open(tmp_path / 'log', 'wb') as log:
        files = dict.fromkeys(('one', 'other'), (log.fileno(),) * 3)
        started = start(commands(one='3', other='4'), files, env, modules=('chatty',))
    assert [process.wait(30) for process in started.values()] == [3, 4]


def test_we_adopt_nobody_else() -> None:
    flag = ctypes.c_int(-1)
    ctypes.CDLL(None).prctl(37, ctypes.byref(flag))
    assert flag.value == 0


def test_what_is_not_forked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    both = commands(one='0', other='0')
    assert can_fork(both)
    assert not can_fork({'one': both['one']})
    assert not can_fork({**both, 'third': ['sleep', '1']})
    (tmp_path / '.lttng').mkdir()
    (tmp_path / '.lttng' / 'lttng-ust-sock-8').touch()
    monkeypatch.setenv('LTTNG_HOME', str(tmp_path))
    assert not can_fork(both)


@pytest.mark.nodes
@pytest.mark.parametrize('forks', [True, False])
def test_a_run_with_and_without(
    forks: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    if not forks:
        folder = tmp_path / 'hide'
        folder.mkdir()
        (folder / 'sitecustomize.py').write_text(
            'import os, sys\n'
            'def fork():\n'
            '    raise OSError("not today")\n'
            'if "flexarm_ros.launcher.fork.server" in sys.orig_argv:\n'
            '    os.fork = fork\n'
        )
        monkeypatch.syspath_prepend(folder)
    exits: dict[str, int] = {}
    close = NodeProcesses.__exit__

    def closing(self: NodeProcesses, *error: object) -> None:
        close(self, *error)
        exits.update(self.exits)

    monkeypatch.setattr(NodeProcesses, '__exit__', closing)
    done = flexarm_here('run', 'fls_tip', '--set', 'duration=0.3', '--no-pictures',
                        '--out', tmp_path / 'run')  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert exits == dict.fromkeys(ROLES, 0)  # not by SIGSEGV when all is done
    start_log = tmp_path / 'run' / 'logs' / 'start.log'
    assert start_log.exists() is not forks
    if not forks:
        assert 'OSError: not today' in start_log.read_text()
    done = flexarm_here('verify', tmp_path / 'run')
    assert done.returncode == 0, done.stderr
