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

"""Ctrl-C, SIGTERM, SIGHUP and SIGKILL to the launcher, and SIGKILL to one of its children."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import termios
import time

from faulttools import check_bag, load, NODE
from flexarm_ros import scenario
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.launcher import run
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.nodes.plant import RECORDER_WINDOW
from flexarm_ros.scenario.suites.suite import Fault
from mcap.exceptions import McapError
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from nodetools import finish, ROLES, start_node, wait_for, write_scenario
import pytest
from repository import ROOT

pytestmark = pytest.mark.nodes

SETTINGS = ('duration=0.5', 'recorder.chunk_time=0.01')
RTF = '0.2'
SLOW = '0.05'
STALL_S = 5.0
"""For which a busy machine may not run a process."""
BAG = 'bag/bag_0.mcap'


def start(
    out: Path,
    *more: str,
    terminal: int | None = None,
    pictures: str = '--no-pictures',
    rtf: str = SLOW,
) -> subprocess.Popen[str]:
    """
    Start `flexarm run` of half a second of arm time: `SLOW`, 10 s of wall time, with `RTF` 2.5 s.

    It is the leader of a session with the ``terminal``, where one is given; ``pictures`` is the
    option for them.
    """
    words = [word for text in SETTINGS for word in ('--set', text)]
    return subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'fls_tip', *words, '--rtf', rtf,
         *pictures.split(), '--out', str(out), *more],
        stdin=terminal, stdout=terminal or subprocess.PIPE, stderr=terminal or subprocess.PIPE,
        text=True, cwd=ROOT, start_new_session=terminal is not None,
        preexec_fn=(lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0)) if terminal else None,
    )  # fmt: skip


def children(pid: int) -> dict[str, int]:
    """Return ``{role: pid}`` of the nodes that a launcher has started."""
    found = {}
    for task in Path(f'/proc/{pid}/task').iterdir():
        with contextlib.suppress(OSError):
            for child in (task / 'children').read_text().split():
                words = Path(f'/proc/{child}/cmdline').read_bytes().split(b'\0')
                for role in ROLES:
                    if role.encode() in words:
                        found[role] = int(child)
    return found


def chunks(out: Path) -> int:
    """Return how many chunks of the bag have been written so far."""
    count = 0
    with contextlib.suppress(OSError, McapError, EOFError), open(out / BAG, 'rb') as file:
        for record in StreamReader(file, emit_chunks=True).records:
            count += isinstance(record, Chunk)
    return count


def reach(launcher: subprocess.Popen[str], out: Path, moment: str) -> dict[str, int]:
    """Wait until the run has come to ``moment``; return its nodes."""
    wait_for(lambda: len(children(launcher.pid)) == len(ROLES), 60, 'six nodes')
    nodes = children(launcher.pid)
    if moment == 'start':
        return nodes
    wait_for(lambda: chunks(out) >= 3, 60, 'the middle of the run')
    return nodes


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize('moment', ['start', 'middle'])
def test_a_signal_ends_the_run_in_good_order(
    tmp_path: Path, number: signal.Signals, moment: str
) -> None:
    out = tmp_path / 'run'
    launcher = start(out)
    try:
        nodes = reach(launcher, out, moment)
        launcher.send_signal(number)
        said = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 128 + number, said
    assert 'Traceback' not in said[1]
    assert not [pid for pid in nodes.values() if Path(f'/proc/{pid}').exists()]
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['problem'] == 'interrupted'
    check_bag(out, scenario.load('fls_tip', list(SETTINGS)), summary['ticks'])
    assert not (out / 'bag-damaged').exists()  # the recorder was given the time to finish it
    if moment == 'middle':
        assert summary['ticks'] > 0


def test_a_closed_terminal_ends_the_run_in_good_order(tmp_path: Path) -> None:
    """The kernel sends SIGHUP, and the progress bar has nowhere to go any more."""
    out = tmp_path / 'run'
    master, terminal = os.openpty()
    launcher = start(out, terminal=terminal)
    os.close(terminal)
    try:
        nodes = reach(launcher, out, 'middle')
        os.close(master)
        launcher.wait(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 129
    assert not [pid for pid in nodes.values() if Path(f'/proc/{pid}').exists()]
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['problem'] == 'interrupted'
    check_bag(out, scenario.load('fls_tip', list(SETTINGS)), summary['ticks'])


@pytest.mark.parametrize('role', ['plant', 'recorder'])
def test_a_node_in_a_closed_terminal_leaves_in_good_order(
    role: str, tmp_path: Path, ros_domain: int
) -> None:
    words = ['-p', f'output:={tmp_path / "run"}'] if role == 'recorder' else []
    node = start_node(role, write_scenario(tmp_path / 's.yaml', 'fls_tip'), *words)
    try:
        wait_for(lambda: caught(node.pid, signal.SIGTERM), 60, 'the node is up')
    finally:
        node.send_signal(signal.SIGHUP)
        (text,) = finish([node])
    assert node.returncode == 129, text
    assert 'Traceback' not in text


def caught(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal; see proc(5)."""
    status = Path(f'/proc/{pid}/status').read_text()
    (mask,) = re.findall(r'^SigCgt:\s*(\w+)$', status, re.M)
    return bool(int(mask, 16) >> (number - 1) & 1)


def test_a_signal_after_the_last_tick_is_told_by_the_status(tmp_path: Path) -> None:
    """While files and the end are dealt with, a signal loses nothing."""
    out = tmp_path / 'run'
    launcher = start(out, rtf=RTF)
    try:
        reach(launcher, out, 'middle')
        wait_for(lambda: (out / 'bag' / 'metadata.yaml').exists(), 60, "the bag's end")
        launcher.send_signal(signal.SIGINT)
        said = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode in (0, 130), said
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['ticks'] == 500
    check_bag(out, scenario.load('fls_tip', list(SETTINGS)), 500)


def test_nodes_leave_when_the_launcher_is_killed(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    launcher = start(out)
    try:
        nodes = reach(launcher, out, 'middle')
    finally:
        launcher.kill()
        launcher.wait()
    wait_for(lambda: not [p for p in nodes.values() if alive(p)], 60, 'the nodes leave')
    assert (out / 'bag' / 'metadata.yaml').exists()  # the recorder finished its bag
    summary = json.loads((out / 'summary.json').read_text())
    assert summary['stable'] is None  # nobody was there to say how it went
    assert 'not finished' in summary['problem']
    again = subprocess.run(
        [sys.executable, '-m', 'flexarm_ros.cli', 'verify', str(out)],
        capture_output=True, text=True, timeout=60, cwd=ROOT, check=False,
    )  # fmt: skip
    assert again.returncode == 0, again.stdout + again.stderr


def test_the_users_own_node_leaves_when_the_launcher_is_killed(tmp_path: Path) -> None:
    example = ROOT / 'examples' / 'minimal_controller.py'
    out = tmp_path / 'run'
    launcher = start(out, '--node', f'controller={sys.executable} {example}')

    def own() -> list[int]:
        made = Path(f'/proc/{launcher.pid}/task/{launcher.pid}/children').read_text().split()
        lines = {int(pid): Path(f'/proc/{pid}/cmdline').read_bytes() for pid in made}
        return [pid for pid, line in lines.items() if example.name.encode() in line]

    try:
        wait_for(lambda: len(own()) == 1, 60, "the user's node")
        (node,) = own()
        wait_for(lambda: chunks(out) >= 3, 60, 'the middle of the run')
        ours = children(launcher.pid)
    finally:
        launcher.kill()
        launcher.wait()
    wait_for(lambda: not [p for p in (node, *ours.values()) if alive(p)], 60, 'all leave')


def test_a_killed_child_is_named_on_one_line(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    launcher = start(out)
    try:
        nodes = reach(launcher, out, 'middle')
        os.kill(nodes['tip_sensor'], signal.SIGKILL)
        _, errors = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 1
    (line,) = [line for line in errors.splitlines() if line.startswith('flexarm run:')]
    assert line.startswith('flexarm run: tip_sensor: tick ')
    assert line.endswith('ended, killed by SIGKILL')
    assert not [pid for pid in nodes.values() if Path(f'/proc/{pid}').exists()]


def test_a_stopped_node_is_named_within_the_limit(tmp_path: Path) -> None:
    """Before its bag is closed or mended, once, and no pictures are drawn of a failed run."""
    out = tmp_path / 'run'
    launcher = start(out, '--set', 'tick_timeout=2.0', pictures='', rtf=RTF)
    try:
        nodes = reach(launcher, out, 'middle')
        os.kill(nodes['recorder'], signal.SIGSTOP)
        stopped = time.monotonic()
        assert launcher.stderr is not None
        for line in launcher.stderr:
            if line.startswith('flexarm run:'):
                break
        took = time.monotonic() - stopped
        printed, errors = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert re.match(r'flexarm run: recorder: tick \d+: nothing recorded within 2 s$', line)
    window_s = RECORDER_WINDOW / 1000 / float(RTF)  # the plant flies so far ahead of it
    assert took < 2.0 + window_s + 2.0 * load() + STALL_S
    assert launcher.returncode == 1
    assert 'flexarm run' not in errors
    problem = json.loads((out / 'summary.json').read_text())['problem']
    assert line == f'flexarm run: {problem}\n'
    assert problem in printed
    assert 'picture' not in printed
    assert not (out / 'pictures').exists()


@pytest.mark.parametrize(('role', 'kind'), [('recorder', 'pause'), ('encoder', 'kill')])
def test_a_verdict_does_not_wait_for_the_files(tmp_path: Path, role: str, kind: str) -> None:
    config = scenario.load('fls_tip', ['duration=0.5', 'tick_timeout=2.0'])
    out = tmp_path / 'run'
    told: list[str] = []

    def verdict(text: str) -> None:
        told.append(text)
        assert 'still running' in (out / 'summary.json').read_text()
        assert not (out / 'bag' / 'metadata.yaml').exists()

    outcome = run.run_scenario(
        config, 'fls_tip', out, run.RunOptions(rtf=0.5), verdict=verdict,
        faults=FaultPlan([Fault(0.2, role, kind)], Timeline.of(config.run)),
    )  # fmt: skip
    assert told == [outcome.problem]
    assert outcome.problem.startswith(f'{role}: tick ')
    assert outcome.summary['problem'] == outcome.problem
    assert (out / 'bag' / 'metadata.yaml').exists()


def test_the_mending_of_a_bag_is_reported(tmp_path: Path) -> None:
    out = tmp_path / 'run'
    launcher = start(out)
    try:
        nodes = reach(launcher, out, 'middle')
        os.kill(nodes['recorder'], signal.SIGKILL)
        _, errors = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    said = [line for line in errors.splitlines() if 'recorder' in line]
    assert said[0].startswith('flexarm run: recorder: tick ')
    assert said[1:] == ['fls_tip: repairing the bag, which the recorder did not finish: 0% done']
    assert (out / 'bag-damaged').exists()


def test_a_stopped_launcher_does_not_stop_the_nodes(tmp_path: Path) -> None:
    """Ctrl-Z in the terminal: the nodes are not its foreground job and fly on."""
    out = tmp_path / 'run'
    launcher = start(out, rtf=RTF)
    try:
        reach(launcher, out, 'middle')
        launcher.send_signal(signal.SIGSTOP)
        wait_for(lambda: (out / 'bag' / 'metadata.yaml').exists(), 60, "the bag's end")
        launcher.send_signal(signal.SIGCONT)
        said = launcher.communicate(timeout=60)
    finally:
        launcher.kill()
        launcher.wait()
    assert launcher.returncode == 0, said
    check_bag(out, scenario.load('fls_tip', list(SETTINGS)), 500)


@pytest.mark.parametrize(('role', 'seconds'), [('controller', 4.0), ('recorder', 6.0)])
def test_a_node_that_is_stopped_for_a_while_changes_nothing(
    role: str, seconds: float, tmp_path: Path
) -> None:
    """
    As by Ctrl-Z and fg, or where an overloaded machine does not let it run.

    Fast DDS has then dropped messages to it.  The others have flown to the end long before the
    recorder goes on: they stay until it has what they sent.  Now and then Fast DDS loses a link
    for good and the run ends by its limit (docs/reliability.md): one more try.
    """
    config = scenario.load('fls_tip', ['duration=0.5', 'tick_timeout=10.0'])
    for attempt in ('first', 'second'):
        out = tmp_path / attempt
        fault = Fault(0.25, role, 'delay', seconds=seconds)
        outcome = run.run_scenario(
            config, 'fls_tip', out, run.RunOptions(),
            faults=FaultPlan([fault], Timeline.of(config.run)),
        )  # fmt: skip
        if not re.search('no [a-z]+ on [a-z_/]+ within 10 s$', outcome.problem):
            break
    assert outcome.problem == ''
    check_bag(out, config, 500)


def test_a_node_that_is_done_but_cannot_leave_is_no_fault_of_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = scenario.load('fls_tip', ['duration=0.1'])
    command = run.node_command

    def commanding(name: str, arguments: list[str]) -> list[str]:
        if name != 'plant':
            return command(name, arguments)
        return [sys.executable, str(NODE), name, 'linger', '0', '--ros-args', *arguments]

    monkeypatch.setattr(run, 'node_command', commanding)
    monkeypatch.setattr(run, 'LEAVING_S', 2.0)
    began = time.monotonic()
    outcome = run.run_scenario(config, 'fls_tip', tmp_path / 'run', run.RunOptions())
    assert time.monotonic() - began >= run.LEAVING_S
    assert outcome.problem == ''
    assert outcome.stable
    check_bag(tmp_path / 'run', config, 100)


def test_a_node_that_dies_at_the_start_gives_its_last_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from faulttools import NODE
    from flexarm_ros.launcher import run

    command = run.node_command

    def commanding(role: str, arguments: list[str]) -> list[str]:
        words = [sys.executable, str(NODE), role, 'import', '0', '--ros-args']
        return words if role == 'encoder' else command(role, arguments)

    monkeypatch.setattr(run, 'node_command', commanding)
    config = scenario.load('fls_tip', list(SETTINGS))
    outcome = run.run_scenario(config, 'fls_tip', tmp_path / 'run', run.RunOptions())
    assert outcome.problem == (
        'encoder: start: ended with exit status 1: ImportError: no such module, on purpose'
    )


def test_an_exception_in_a_service_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from faulttools import faulty_run

    done = faulty_run(monkeypatch, tmp_path / 'run', 'controller', 'service', 100)
    assert done.problem.startswith('controller: tick ')
    assert done.problem.endswith('in a service: ZeroDivisionError: a fault on purpose')


def test_a_law_without_a_finite_torque_is_named_with_its_tick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from faulttools import faulty_run
    from flexarm_ros.bag.checks.verify import verify

    done = faulty_run(monkeypatch, tmp_path / 'run', 'controller', 'nan', 100)
    assert done.problem == 'controller (fls): tick 100: torque at the shoulder is nan N m'
    assert done.ticks == 100
    assert verify(done.directory).same


def alive(pid: int) -> bool:
    """Whether a process runs; one that has ended and waits for its parent does not."""
    try:
        stat = Path(f'/proc/{pid}/stat').read_text()
    except OSError:
        return False
    return stat.rpartition(')')[2].split()[0] not in 'ZX'
