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

"""Where logs are written: below the run's directory, or where the user wants them."""

from __future__ import annotations

from pathlib import Path
import shutil
import sys

from flexarm_ros.nodes.runtime.process.environment import environment_notes, log_directory
from nodetools import finish, flexarm, ROLES, start_node, write_scenario
import pytest
from repository import ROOT

RUN = ('run', 'pd_tip', '--set', 'duration=0.01', '--no-pictures', '--out')
NOWHERE = '/dev/null/nowhere'


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let nothing be said of logs, in an empty home directory."""
    monkeypatch.delenv('ROS_LOG_DIR')
    monkeypatch.delenv('ROS_HOME', raising=False)
    monkeypatch.setenv('HOME', str(tmp_path / 'home'))
    (tmp_path / 'home').mkdir()
    return tmp_path / 'home'


@pytest.mark.parametrize(
    ('variables', 'place'),
    [
        ({}, ''),
        ({'ROS_LOG_DIR': '', 'ROS_HOME': ''}, ''),
        ({'ROS_HOME': '{home}/ros'}, 'ros/log'),
        ({'ROS_HOME': '{home}/ros', 'ROS_LOG_DIR': '~/mine'}, 'mine'),
    ],
)
def test_a_log_directory_is_found_as_rcl_does(
    variables: dict[str, str], place: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value.format(home=home))
    assert log_directory() == (str(home / place) if place else '')
    assert environment_notes() == []
    assert not place or not list((home / place).iterdir())


@pytest.mark.nodes
def test_nothing_is_written_in_the_home_directory(
    home: Path, tmp_path: Path, ros_domain: int
) -> None:
    out = tmp_path / 'run'
    controller = f'controller={sys.executable} {ROOT}/examples/minimal_controller.py'
    done = flexarm(*RUN, out, '--node', controller)
    assert done.returncode == 0, done.stdout + done.stderr
    own = {f'{role}.log' for role in ROLES}
    logs = {path.name for path in (out / 'logs').iterdir()}
    assert own <= logs
    assert len(logs - own) == 1, logs  # rcl's file of the external node
    done = flexarm('replay', out, '--rate', '0', '--delay', '0')
    assert done.returncode == 0, done.stderr
    assert 'played 10 ticks' in done.stderr
    parameters = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'start_timeout=0.1')
    (said,) = finish([start_node('encoder', parameters)])
    assert 'joined within' in said
    assert list(home.iterdir()) == []


@pytest.mark.nodes
@pytest.mark.parametrize(
    ('name', 'value'),
    [('HOME', None), ('HOME', NOWHERE), ('ROS_LOG_DIR', NOWHERE)],
)
def test_a_place_that_cannot_be_written_ends_no_run(
    name: str, value: str | None, home: Path, tmp_path: Path, ros_domain: int,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    if value is None:
        monkeypatch.delenv(name)
    else:
        monkeypatch.setenv(name, value)
    note = f'{NOWHERE}: not writable: no log files there (ROS_LOG_DIR, ROS_HOME)'
    out = tmp_path / 'run'
    for words in ((*RUN, out), ('replay', out, '--rate', '0', '--delay', '0')):
        done = flexarm(*words)
        assert done.returncode == 0, done.stdout + done.stderr
        assert done.stderr.count(note) == (name == 'ROS_LOG_DIR')


@pytest.mark.nodes
def test_the_users_log_directory_is_used(
    home: Path, tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Relative to where the command is started; the nodes start elsewhere."""
    place = Path('test-log-directory')
    monkeypatch.setenv('ROS_LOG_DIR', str(place))
    try:
        done = flexarm(*RUN, tmp_path / 'run')
        assert done.returncode == 0, done.stderr
        assert len(list((ROOT / place).glob('*.log'))) == len(ROLES)
    finally:
        shutil.rmtree(ROOT / place)
