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

"""Neighbours: two runs at once, nodes that come a minute late."""

from __future__ import annotations

from pathlib import Path
import re
import subprocess
import sys

from nodetools import finish, flexarm_here, ROLES, start_node, write_scenario
import pytest
from repository import ROOT

pytestmark = pytest.mark.nodes


def test_two_runs_at_once_do_not_meet(tmp_path: Path) -> None:
    runs = {
        name: subprocess.Popen(
            [sys.executable, '-m', 'flexarm_ros.cli', 'run', name, '--set', 'duration=0.3',
             '--no-pictures', '--out', str(tmp_path / name)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
        )
        for name in ('pd_tip', 'fls_mid')
    }  # fmt: skip
    texts = finish(list(runs.values()), 120.0)
    assert [run.returncode for run in runs.values()] == [0, 0], texts
    domains = {re.findall(r'ROS_DOMAIN_ID=(\d+)', text)[0] for text in texts}
    assert len(domains) == 2
    for name in runs:
        out = tmp_path / f'{name}-simulated'
        words = ('--set', 'duration=0.3', '--no-pictures', '--out', out)
        assert flexarm_here('simulate', name, *words).returncode == 0
        mcap = 'bag/bag_0.mcap'
        assert (tmp_path / name / mcap).read_bytes() == (out / mcap).read_bytes()


@pytest.mark.slow
def test_nodes_that_come_a_minute_apart(tmp_path: Path, ros_domain: int) -> None:
    """The limit on joining counts from the last newcomer: each may be almost a minute late."""
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3', 'start_timeout=70')
    nodes = [start_node(role, file) for role in ('controller', 'plant')]
    with pytest.raises(subprocess.TimeoutExpired):
        nodes[0].wait(60.0)  # it waits, which is what is tested
    rest = [role for role in ROLES if role not in ('controller', 'plant')]
    out = ['-p', f'output:={tmp_path / "run"}']
    nodes += [start_node(role, file, *(out if role == 'recorder' else [])) for role in rest]
    texts = finish(nodes, 120.0)
    assert [node.returncode for node in nodes] == [0] * len(nodes), texts
    assert (
        flexarm_here('simulate', file, '--no-pictures', '--out', tmp_path / 'sim').returncode == 0
    )
    csv = 'trajectory.csv'
    assert (tmp_path / 'run' / csv).read_bytes() == (tmp_path / 'sim' / csv).read_bytes()
