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

"""DDS-Security: the wheels' Fast DDS has none; a run that asks for it is never unsecured."""

from __future__ import annotations

from pathlib import Path

from nodetools import finish, flexarm, start_node, write_scenario
import pytest

pytestmark = pytest.mark.nodes


@pytest.mark.parametrize('strategy', ['Enforce', 'Permissive'])
def test_security_that_cannot_be_had_is_refused_in_one_line(
    strategy: str, tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'keys' / 'enclaves').mkdir(parents=True)
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', strategy)
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path / 'keys'))
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip')
    node = start_node('controller', file)
    (text,) = finish([node])
    assert node.returncode in (1, 2)
    assert 'Traceback' not in text
    # Where Fast DDS has it, the empty keystore is what is wrong.
    assert 'security' in text.lower(), text


def test_no_run_is_unsecured_where_security_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.delenv('ROS_SECURITY_STRATEGY', raising=False)
    monkeypatch.delenv('ROS_SECURITY_KEYSTORE', raising=False)
    said = 'ROS_SECURITY_ENABLE=true: nothing can be secured, ROS_SECURITY_KEYSTORE is not set\n'
    for command in ('run', 'view'):
        done = flexarm(command, 'pd_tip', *(['--out', tmp_path / 'run'] * (command == 'run')))
        assert (done.returncode, done.stderr) == (2, f'flexarm {command}: error: {said}')
    assert not (tmp_path / 'run').exists()
    node = start_node('encoder', write_scenario(tmp_path / 's.yaml', 'pd_tip'))
    (text,) = finish([node])
    assert (node.returncode, text) == (2, f'encoder: {said}')


def test_a_run_has_its_keys_enforced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The keystore is there and empty: a run has a key for none of its nodes."""
    (tmp_path / 'keys').mkdir()
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path / 'keys'))
    monkeypatch.delenv('ROS_SECURITY_STRATEGY', raising=False)
    done = flexarm('run', 'pd_tip', '--set', 'duration=0.1', '--no-pictures',
                   '--out', tmp_path / 'run')  # fmt: skip
    assert done.returncode == 1, done.stdout
    assert 'secur' in done.stderr.lower() or 'enclave' in done.stderr.lower(), done.stderr
