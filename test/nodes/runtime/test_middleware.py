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

"""What a process tells the middleware before it starts, and what it leaves to the user."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
from xml.etree import ElementTree

from flexarm_ros.nodes.runtime.process import middleware
from flexarm_ros.nodes.runtime.process.middleware import fastdds_version, prepare, PROFILES
import pytest

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
VARIABLES = {variable for variable, _ in PROFILES.values()}
PERIOD = {3: 'heartbeat_period', 2: 'heartbeatPeriod'}


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Begin, and end, without the variables in question."""
    monkeypatch.chdir(tmp_path)
    for name in (*VARIABLES, RANGE):
        monkeypatch.setenv(name, '')  # so that it is put back afterwards
        monkeypatch.delenv(name)


@pytest.mark.parametrize('version', PROFILES)
def test_defaults_are_those_of_the_installed_version(
    version: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(middleware, 'fastdds_version', lambda: version)
    prepare()
    assert os.environ[RANGE] == 'LOCALHOST'
    variable, _ = PROFILES[version]
    assert VARIABLES & set(os.environ) == {variable}
    root = ElementTree.parse(os.environ[variable]).getroot()
    (period,) = (e for e in root.iter() if e.tag.rpartition('}')[2] == PERIOD[version])
    assert [int(part.text or '') for part in period] == [0, 100_000_000]


@pytest.mark.parametrize(
    ('text', 'version'),
    [('8.4.3', 2), ('9.3.3', 3), ('10.0.0', 3), ('x', 3)],
    ids=['Jazzy', 'Kilted', 'later', 'unreadable'],
)
def test_the_version_is_that_of_the_rmw_package(
    text: str, version: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'package.xml').write_text(f'<package><version>{text}</version></package>')
    monkeypatch.setattr(middleware, 'get_package_share_path', lambda _: tmp_path)
    assert fastdds_version() == version


def test_fast_dds_takes_the_profiles_without_a_word(ros_domain: int) -> None:
    code = (
        'from flexarm_ros.nodes.runtime.process.middleware import prepare\n'
        'prepare()\n'
        'import rclpy\n'
        'rclpy.init()\n'
        'rclpy.create_node("probe")\n'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, '', '')


@pytest.mark.parametrize('name', sorted(VARIABLES))
def test_the_users_profiles_stay(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, 'mine.xml')
    monkeypatch.setenv(RANGE, 'SUBNET')
    prepare()
    assert os.environ[RANGE] == 'SUBNET'
    assert VARIABLES & set(os.environ) == {name}
    assert os.environ[name] == 'mine.xml'


def test_a_file_where_the_user_stands_stays_the_one_that_counts(tmp_path: Path) -> None:
    (tmp_path / 'DEFAULT_FASTDDS_PROFILES.xml').write_text('<dds/>')
    prepare()
    assert not VARIABLES & set(os.environ)


def test_a_process_that_cannot_leave_ends_with_its_status() -> None:
    """Fast DDS keeps one now and then from leaving a run in which all was well."""
    code = """
import time
from flexarm_ros.nodes.runtime.process import shutdown_watchdog
shutdown_watchdog._OWN_LIMIT_S = 0.2
with shutdown_watchdog.shutdown_limit({status}):
    time.sleep(30.0)
"""
    for status in (0, 3):
        words = [sys.executable, '-c', code.format(status=status)]
        assert subprocess.run(words, timeout=20).returncode == status
