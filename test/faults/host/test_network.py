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

"""Two machines: the same bytes as on one, over good links and bad; a cut link ends the run."""

from __future__ import annotations

import json
import os
from pathlib import Path
import re
import subprocess
import sys

from nettools import Machines, two_machines
from nodetools import finish, flexarm_here, ROLES, wait_for, write_scenario
import pytest
from repository import ROOT

pytestmark = pytest.mark.nodes

AFAR = ('controller',)
LOSSY = {
    'FASTDDS_DEFAULT_PROFILES_FILE': str(ROOT / 'examples' / 'lossy_network.xml'),
    'RMW_FASTRTPS_USE_QOS_FROM_XML': '1',
}


def start_all(
    machines: Machines, file: Path, out: Path, **environment: str
) -> dict[str, subprocess.Popen[str]]:
    """Start the plant and the sensors on one machine, the controller on the other."""
    # Both "machines" share /dev/shm: only sockets are to carry anything.
    env = {
        **os.environ, 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SUBNET',
        'FASTDDS_BUILTIN_TRANSPORTS': 'UDPv4', **environment,
    }  # fmt: skip
    nodes = {}
    for role in ROLES:
        own = ['-p', f'output:={out}', '-p', 'name:=s'] if role == 'recorder' else []
        nodes[role] = subprocess.Popen(
            [*machines.command(int(role in AFAR)), sys.executable, '-m', 'flexarm_ros.nodes', role,
             '--ros-args', '--params-file', str(file), *own],
            env=env, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
    return nodes


def check_same(tmp_path: Path, file: Path) -> None:
    """Check that the run's files are those of a simulation."""
    done = flexarm_here('simulate', file, '--no-pictures', '--out', tmp_path / 'sim')
    assert done.returncode == 0, done.stderr
    for name in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (tmp_path / 'run' / name).read_bytes() == (tmp_path / 'sim' / name).read_bytes()


def test_two_machines_give_the_bytes_of_one(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'fls_mid_corrected', 'duration=0.2')
    with two_machines() as machines:
        nodes = start_all(machines, file, tmp_path / 'run')
        texts = finish(list(nodes.values()))
    assert [node.returncode for node in nodes.values()] == [0] * len(ROLES), texts
    check_same(tmp_path, file)


@pytest.mark.slow
def test_a_bad_link_gives_the_same_bytes_later(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(
        tmp_path / 's.yaml', 'fls_mid_corrected', 'duration=0.2', 'tick_timeout=20'
    )
    with two_machines(loss=0.05, delay_s=0.005) as machines:
        nodes = start_all(machines, file, tmp_path / 'run', **LOSSY)
        texts = finish(list(nodes.values()), 240.0)
        relay = machines.relay
    assert [node.returncode for node in nodes.values()] == [0] * len(ROLES), texts
    if relay is not None:
        assert relay.lost > 20
    summary = json.loads((tmp_path / 'run' / 'summary.json').read_text())
    print(f'{machines.kind}: 200 ticks in {summary["wall_s"]:.2f} s')
    check_same(tmp_path, file)


def test_a_cut_link_ends_the_run(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(
        tmp_path / 's.yaml', 'pd_tip', 'duration=600', 'tick_timeout=2', 'recorder.chunk_time=0.05'
    )
    bag = tmp_path / 'run' / 'bag' / 'bag_0.mcap'
    with two_machines() as machines:
        nodes = start_all(machines, file, tmp_path / 'run')
        try:
            wait_for(lambda: bag.exists() and bag.stat().st_size > 60_000, 60, 'a running run')
            machines.cut()
        finally:
            texts = dict(zip(nodes, finish(list(nodes.values()), 60.0), strict=True))
    assert {role: node.returncode for role, node in nodes.items()} == dict.fromkeys(ROLES, 1), (
        texts
    )
    assert 'controller: tick ' in texts['plant']
    assert 'no torque on joint_command within 2 s' in texts['plant']
    # Which of its inputs the cut was first to take is chance.
    assert re.search(r'(plant|encoder|tip_sensor): tick \d+: no message on', texts['controller'])
    assert not [text for text in texts.values() if 'Traceback' in text]
    done = flexarm_here('verify', tmp_path / 'run')
    assert done.returncode == 0, done.stdout + done.stderr
