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

"""``run.launch.py``: its arguments, the watching of its nodes, and the real launch where it is."""

from __future__ import annotations

from importlib.util import find_spec
import json
import os
from pathlib import Path
import signal
import subprocess
import sys

from flexarm_ros import scenario
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options.progress import Progress
from flexarm_ros.cli.running.launched import ARGUMENTS, LaunchedRun, read_rtf, split_overrides
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.launcher.reports import RunWatch
from flexarm_ros.launcher.run import Reported
from flexarm_ros.nodes.runtime.process.supervisor import ALIVE_FD, REPORT_FD, Supervisor
from flexarm_ros.scenario import ScenarioError
from nodetools import finish, wait_for
import pytest
from repository import ROOT

ROLES = roles(RunConfig())
LAUNCH_FILE = ROOT / 'launch' / 'run.launch.py'
DEFAULTS = {name: argument.default for name, argument in ARGUMENTS.items()}
LAUNCH = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

file, *words = sys.argv[1:]
given = [tuple(word.split(':=', 1)) for word in words]
source = PythonLaunchDescriptionSource(file)
service = LaunchService(argv=words)
service.include_launch_description(
    LaunchDescription([IncludeLaunchDescription(source, launch_arguments=given)])
)
sys.exit(service.run())
"""
"""What `ros2 launch FILE NAME:=VALUE...` does."""

real_launch = pytest.mark.skipif(
    find_spec('launch_ros') is None, reason='launch and launch_ros are not installed'
)


def ready(**given: str) -> LaunchedRun:
    """Return a run with these launch arguments."""
    return LaunchedRun({**DEFAULTS, **given})


def test_overrides_are_split_as_a_shell_does() -> None:
    assert split_overrides('') == []
    text = 'plant.payload_mass=1 "plant.length=[4.0, 5.0]" trajectory.kind=hold'
    assert split_overrides(text) == [
        'plant.payload_mass=1', 'plant.length=[4.0, 5.0]', 'trajectory.kind=hold',
    ]  # fmt: skip
    with pytest.raises(UsageError, match='^set:=a="b: no closing quotation$'):
        split_overrides('a="b')


@pytest.mark.parametrize('text', ['fast', '-1', 'nan', 'inf', ''])
def test_a_bad_rtf_is_named(text: str) -> None:
    with pytest.raises(UsageError, match=f'^rtf:={text}: not a number from 0'):
        read_rtf(text)


@pytest.mark.parametrize(
    ('given', 'error'),
    [
        ({'scenario': 'nosuch'}, 'nosuch: neither a file'),
        ({'set': 'plant.payload_mas=1'}, "did you mean 'plant.payload_mass'"),
        ({'set': 'duration'}, 'duration'),
        ({'rtf': 'fast'}, 'rtf:=fast'),
        ({'out': 'taken'}, 'out:=taken: exists already'),
    ],
)
def test_bad_arguments_leave_nothing_behind(
    given: dict[str, str], error: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'taken').write_text('a file\n')
    with pytest.raises((ScenarioError, UsageError), match=error) as caught:
        ready(**given)
    assert '\n' not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ['taken']


@pytest.mark.parametrize('out', ['1e3', 'true', 'a b', "it's: #1", '{x}', 'é中😀', 'sub/dir'])
def test_any_text_is_a_directory(
    out: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = ready(out=out, set='duration=0.1')
    assert (tmp_path / out / 'scenario.yaml').exists()
    (flag, value) = run.ros_arguments('recorder')[2:4]
    name, _, text = value.partition(':=')
    assert (flag, name) == ('-p', 'recorder:output')
    assert json.loads(text) == str(tmp_path / out)
    run.nodes.close()


@pytest.mark.parametrize(
    ('given', 'around', 'directory'),
    [
        ('', '', 'fls_tip'),
        ('arm', '', 'arm-fls_tip'),
        ('arm', '/left', 'left-arm-fls_tip'),
        ('/arm', '/left', 'arm-fls_tip'),
        ('', '/left', 'left-fls_tip'),
    ],
)
def test_the_default_directory_bears_the_namespace(
    given: str, around: str, directory: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    run = LaunchedRun({**DEFAULTS, 'namespace': given, 'set': 'duration=0.1'}, around)
    assert run.directory == Path('runs', directory)
    run.nodes.close()


def test_the_pace_of_the_scenario_reaches_the_plant(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = 'duration=0.1 real_time_factor=1e-5 step_ticks=3 start_paused=true'
    for rtf, factor in (('0.0', '1.0e-05'), ('2', '2.0')):
        run = ready(set=text, rtf=rtf)
        assert run.ros_arguments('plant')[2:] == [
            '-p', f'plant:real_time_factor:={factor}', '-p', 'plant:step_ticks:=3',
            '-p', 'plant:start_paused:=true',
        ]  # fmt: skip
        run.nodes.close()


def test_a_tilde_is_the_home_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    run = ready(out='~/run', set='duration=0.1')
    assert run.directory == tmp_path / 'run'
    run.nodes.close()


def test_pipes_are_found_by_their_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    watch = RunWatch(tmp_path)
    for name, value in watch.environment_by_path.items():
        monkeypatch.setenv(name, value)
    node = Supervisor()
    node.report('recorder', tick=7)
    watch.take_reports()
    assert watch.report.tick == 7
    assert node.present
    assert not node.gone
    watch.close()
    assert node.gone


def test_a_node_without_a_launcher_reports_to_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (REPORT_FD, ALIVE_FD):
        monkeypatch.setenv(name, '/proc/0/fd/0')
    node = Supervisor()
    node.report('recorder', tick=7)
    assert not node.present
    assert not node.gone


def test_what_the_plant_has_to_say_is_passed_on_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    watch = RunWatch(tmp_path)
    for name, value in watch.environment_by_path.items():
        monkeypatch.setenv(name, value)
    progress = Progress(scenario.load('pd_tip'), 'pd_tip')
    passed_on = Reported(progress.update, progress.say, progress.timing)
    node = Supervisor()
    node.report('plant', remark='real time: SCHED_FIFO 10')
    node.report('plant', timing='3 late ticks')
    monkeypatch.setattr('flexarm_ros.cli.options.progress._LINE_EVERY_S', 0.0)
    for ticks in (1, 400):
        node.report('recorder', tick=ticks)
        watch.take_reports()
        passed_on(watch, 16000)
    said = capsys.readouterr().err
    assert said.count('real time: SCHED_FIFO 10') == 1
    (line,) = (line for line in said.splitlines() if '0.40 of 16 s simulated' in line)
    assert ', 3 late ticks' in line
    watch.close()


def test_a_death_is_the_first_thing_to_blame(tmp_path: Path) -> None:
    watch = RunWatch(tmp_path)
    assert not watch.failing
    watch.ended('encoder', -9)
    watch.report.failures = [{'role': 'plant', 'blame': 'controller', 'text': 'tick 3: no torque'}]
    assert watch.failing
    watch.breaking_off()
    watch.ended('plant', 1)
    assert watch.blame() == 'encoder: start: ended, killed by SIGKILL'
    watch.close()


@pytest.mark.parametrize('text', ['failed', 'died'])
def test_a_node_that_the_run_can_do_without(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = RunWatch(tmp_path)
    watch.dispensable = frozenset({'controller'})
    for name, value in watch.environment_by_path.items():
        monkeypatch.setenv(name, value)
    node = Supervisor()
    node.report('plant', phase='running')
    if text == 'failed':
        node.report('controller', phase='failed', blame='', text='it cannot')
        watch.take_reports()
    else:
        watch.ended('controller', -9)
    assert not watch.failing and not watch.blame()
    (said,) = watch.report.remarks
    assert said.startswith('controller: ') and said.endswith('; the run goes on')
    watch.ended('encoder', -9)
    assert watch.failing
    watch.close()


@pytest.mark.nodes
def test_nodes_that_inherit_nothing_report(
    tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(tmp_path)
    run = ready(scenario='pd_collocated', out='1e3: a rün 😀', set='duration=0.3')
    command = [sys.executable, '-m', 'flexarm_ros.nodes']
    environment = {**os.environ, **run.nodes.environment_by_path}
    nodes = {
        role: subprocess.Popen(
            [*command, role, '--ros-args', *run.ros_arguments(role)], env=environment
        )
        for role in ROLES
    }
    finish(list(nodes.values()))
    for role, node in nodes.items():
        run.nodes.ended(role, node.returncode)
    run.look()
    assert run.nodes.report.done == set(ROLES)
    assert run.finish(interrupted=False) == ''
    assert 'stable; 300 ticks' in capsys.readouterr().out
    assert summary(tmp_path / '1e3: a rün 😀')['wall_s'] is not None


@pytest.fixture
def launch(tmp_path: Path, ros_domain: int):
    """Yield a function that starts the launch file in ``tmp_path``; end what still runs."""
    started = []

    def start(*words: str) -> subprocess.Popen[str]:
        started.append(
            subprocess.Popen(
                [sys.executable, '-c', LAUNCH, str(LAUNCH_FILE), *words], cwd=tmp_path, text=True,
                stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        )  # fmt: skip
        return started[-1]

    yield start
    for process in started:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.communicate(timeout=60)


def summary(directory: Path) -> dict[str, object]:
    """Return ``summary.json`` of a run."""
    return dict(json.loads((directory / 'summary.json').read_text()))


def pids(process: subprocess.Popen[str]) -> dict[str, int]:
    """Return ``{role: process id}`` of the nodes that a launch has started."""
    found = {}
    for child in Path(f'/proc/{process.pid}/task/{process.pid}/children').read_text().split():
        words = Path(f'/proc/{child}/cmdline').read_bytes().split(b'\0')
        found |= {role: int(child) for role in ROLES if f'__node:={role}'.encode() in words}
    return found


def begun(directory: Path) -> None:
    """Wait until the recorder has written something."""
    bag = directory / 'bag' / 'bag_0.mcap'
    wait_for(lambda: bag.exists() and bag.stat().st_size > 0, 120, 'the run has begun')


@real_launch
@pytest.mark.nodes
def test_launch_flies_records_and_shows_the_metrics(tmp_path: Path, launch) -> None:
    process = launch(
        'scenario:=pd_collocated', 'out:=1e3: a run', 'namespace:=arm', 'rtf:=100.0',
        'set:=duration=0.3 "plant.payload_mass=0.5"',
    )  # fmt: skip
    text, _ = process.communicate(timeout=120)
    assert process.returncode == 0, text
    told = summary(tmp_path / '1e3: a run')
    assert (told['stable'], told['ticks']) == (True, 300)
    assert told['scenario']['plant']['payload_mass'] == 0.5
    assert 'stable; 300 ticks' in text
    assert 'max error' in text


@real_launch
@pytest.mark.nodes
@pytest.mark.parametrize('bad', ['set:=plant.payload_mas=1', 'rtf:=fast', 'scenario:=nosuch'])
def test_launch_starts_nothing_with_bad_arguments(tmp_path: Path, launch, bad: str) -> None:
    process = launch(bad)
    text, _ = process.communicate(timeout=60)
    assert process.returncode == 1, text
    assert len([line for line in text.splitlines() if '[ERROR]' in line]) == 1
    assert 'Traceback' not in text
    assert 'process started' not in text
    assert not (tmp_path / 'runs').exists()


@real_launch
@pytest.mark.nodes
def test_launch_names_a_node_that_died_and_fails(tmp_path: Path, launch) -> None:
    process = launch('out:=run', 'set:=duration=60')
    begun(tmp_path / 'run')
    os.kill(pids(process)['encoder'], signal.SIGKILL)
    text, _ = process.communicate(timeout=60)
    assert process.returncode == 1, text
    told = summary(tmp_path / 'run')
    assert 'encoder: ' in str(told['problem'])
    assert 'killed by SIGKILL' in str(told['problem'])
    assert f'fls_tip: the run failed: {told["problem"]}' in text


@real_launch
@pytest.mark.nodes
def test_ctrl_c_ends_the_run_in_good_order(tmp_path: Path, launch) -> None:
    process = launch('out:=run', 'set:=duration=60')
    begun(tmp_path / 'run')
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does
    text, _ = process.communicate(timeout=60)
    assert process.returncode == 1, text
    assert 'fls_tip: the run failed: interrupted' in text
    assert str(summary(tmp_path / 'run')['problem']).startswith('interrupted')
    assert (tmp_path / 'run' / 'bag' / 'metadata.yaml').exists()


@real_launch
@pytest.mark.nodes
def test_nodes_leave_when_launch_is_killed(tmp_path: Path, launch) -> None:
    process = launch('out:=run', 'set:=duration=60')
    begun(tmp_path / 'run')
    nodes = pids(process)
    assert set(nodes) == set(ROLES)
    process.kill()
    wait_for(
        lambda: not any(Path(f'/proc/{pid}').exists() for pid in nodes.values()),
        60, 'all nodes have left',
    )  # fmt: skip
    assert (tmp_path / 'run' / 'bag' / 'metadata.yaml').exists()
