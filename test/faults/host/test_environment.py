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

"""ROS variables: read as rcl reads them, or refused in one line before anything starts."""

from __future__ import annotations

from pathlib import Path

from flexarm_ros.nodes.runtime.process.environment import environment_domain
from nodetools import finish, flexarm, start_node, write_scenario
import pytest

BAD = ['abc', '-1', '\u00b2', '300', '233', '5x', ' ', '\u0665', '1_0', '0x10']


@pytest.mark.parametrize(
    ('text', 'domain'),
    [('', None), ('0', 0), ('7', 7), (' 5', 5), ('\t+5', 5), ('232', 232)],
)
def test_a_domain_is_read_as_rcl_does(
    text: str, domain: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    assert environment_domain() == domain


@pytest.mark.parametrize('text', BAD)
@pytest.mark.parametrize('command', ['run', 'replay', 'view'])
def test_a_bad_domain_is_refused_in_one_line(
    text: str, command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    from flexarm_ros import cli

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('ROS_DOMAIN_ID', text)
    words = {'run': ['fls_tip'], 'replay': ['nowhere'], 'view': []}[command]
    assert cli.main([command, *words]) == 2
    said = f'error: ROS_DOMAIN_ID={text!r}: not a whole number from 0 to 232\n'
    assert capsys.readouterr().err == f'flexarm {command}: {said}'
    assert not list(tmp_path.iterdir())
    assert cli.main([command, *words, '--domain', text]) == 2
    assert f'--domain: {text!r}: not a whole number' in capsys.readouterr().err


@pytest.mark.nodes
@pytest.mark.parametrize('role', ['encoder', 'player', 'viewer'])
def test_a_node_refuses_a_bad_domain(
    role: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DOMAIN_ID', '-1')
    node = start_node(role, write_scenario(tmp_path / 's.yaml', 'pd_tip'))
    (text,) = finish([node])
    said = f"{role}: ROS_DOMAIN_ID='-1': not a whole number from 0 to 232\n"
    assert (node.returncode, text) == (2, said)


@pytest.mark.nodes
def test_a_discovery_server_is_pointed_out(
    tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('ROS_DISCOVERY_SERVER', '127.0.0.1:11899')
    said = (
        'ROS_DISCOVERY_SERVER=127.0.0.1:11899: nodes discover each other through this server only'
    )
    limit = ('--set', 'start_timeout=1.0')
    done = flexarm('run', 'pd_tip', *limit, '--no-pictures', '--out', tmp_path / 'run')
    assert done.returncode == 1
    assert done.stderr.splitlines()[0] == said
    assert said in (tmp_path / 'run' / 'logs' / 'plant.log').read_text()
