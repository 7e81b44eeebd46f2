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
from xml.etree import ElementTree

from flexarm_ros.nodes.middleware import prepare, PROFILES_FILE
import pytest

OLD_NAME = 'FASTRTPS_DEFAULT_PROFILES_FILE'
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Begin, and end, without the variables in question."""
    monkeypatch.chdir(tmp_path)
    for name in (PROFILES_FILE, OLD_NAME, RANGE):
        monkeypatch.setenv(name, '')  # so that it is put back afterwards
        monkeypatch.delenv(name)


def test_defaults() -> None:
    prepare()
    assert os.environ[RANGE] == 'LOCALHOST'
    root = ElementTree.parse(os.environ[PROFILES_FILE]).getroot()
    (period,) = root.iter('{http://www.eprosima.com}heartbeat_period')
    assert [int(part.text or '') for part in period] == [0, 100_000_000]


@pytest.mark.parametrize('name', [PROFILES_FILE, OLD_NAME])
def test_the_users_profiles_stay(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(name, 'mine.xml')
    monkeypatch.setenv(RANGE, 'SUBNET')
    prepare()
    assert os.environ[RANGE] == 'SUBNET'
    assert [os.environ.get(other) for other in (PROFILES_FILE, OLD_NAME)].count(None) == 1
    assert os.environ[name] == 'mine.xml'


def test_a_file_where_the_user_stands_stays_the_one_that_counts(tmp_path: Path) -> None:
    (tmp_path / 'DEFAULT_FASTDDS_PROFILES.xml').write_text('<dds/>')
    prepare()
    assert PROFILES_FILE not in os.environ
