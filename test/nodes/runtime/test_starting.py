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

"""A run that cannot begin says why within seconds, and every node says the same."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import shlex
import subprocess
import sys

from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.compatibility import connects, shown
from flexarm_ros.nodes.runtime.joining.status import HEARD, Phase
from flexarm_ros.nodes.runtime.topics.graph import qos_profile
from nodetools import finish, flexarm, flexarm_here, ROLES, start_node, wait_for, write_scenario
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from repository import ROOT
from sensor_msgs.msg import JointState
from wiretools import Joining, Wire

pytestmark = pytest.mark.nodes

EXTERNAL = """
import sys
sys.path.insert(0, sys.argv[1])
import minimal_controller, rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

kind = sys.argv[2]

class External(minimal_controller.MinimalController):
    def create_publisher(self, message, name, qos, **more):
        if name == 'joint_command' and kind == 'reliability':
            qos = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
        if name == 'joint_command' and kind == 'type':
            message = String
        return super().create_publisher(message, name, qos, **more)

    def create_subscription(self, message, name, call, qos, **more):
        if name == 'plant/state' and kind == 'durability':
            qos = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        return super().create_subscription(message, name, call, qos, **more)

rclpy.init()
try:
    rclpy.spin(External())
except BaseException:
    pass
"""
"""The example, one of whose endpoints the middleware never connects to ours."""

SAID = {
    'reliability': 'joint_command: incompatible QoS of /my_controller: reliability: best effort '
    'publisher and reliable subscription',
    'durability': 'plant/state: incompatible QoS of /my_controller: durability: volatile '
    'publisher and transient local subscription',
    'type': 'joint_command: /my_controller has type std_msgs/msg/String, not '
    'sensor_msgs/msg/JointState',
}


def external(tmp_path: Path, kind: str) -> str:
    """Return the command of such a controller."""
    script = tmp_path / 'external.py'
    script.write_text(EXTERNAL)
    return f'{sys.executable} {script} {ROOT / "examples"} {kind}'


@pytest.mark.parametrize('kind', list(SAID))
def test_an_endpoint_that_cannot_connect_is_named(
    kind: str, tmp_path: Path, ros_domain: int
) -> None:
    # Whatever takes longer than 20 s after the last newcomer says that instead.
    out = tmp_path / 'run'
    words = ('--set', 'start_timeout=20', '--no-pictures', '--out', out)
    node = f'controller={external(tmp_path, kind)}'
    done = flexarm_here('run', 'pd_collocated', *words, '--node', node)
    assert done.returncode == 1
    assert f'flexarm run: controller: start: {SAID[kind]}\n' in done.stderr


@pytest.mark.parametrize('kind', ['reliability', 'durability'])
def test_a_replay_names_a_controller_that_cannot_connect(
    kind: str, tmp_path: Path, ros_domain: int
) -> None:
    out = tmp_path / 'run'
    flexarm_here('simulate', 'pd_tip', '--set', 'duration=0.1', '--no-pictures', '--out', out)
    controller = subprocess.Popen(shlex.split(external(tmp_path, kind)))
    try:
        done = flexarm('replay', out, '--without', 'controller', timeout=50.0)
    finally:
        controller.kill()
        controller.wait()
    assert done.returncode == 1
    assert f'player: after 0 ticks: {SAID[kind]}\n' in done.stderr


def test_a_listener_that_hears_nothing_stops_no_run(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    node, _ = rclpy_node
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(JointState, 'plant/state', lambda _: None, latched)
    out = tmp_path / 'run'
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.1')
    run = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', str(file), '--compose', '--no-pictures',
         '--without', 'controller', '--domain', str(ros_domain), '--out', str(out)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip
    log, nodes = out / 'logs' / 'compose.log', [run]
    try:  # the run does not begin before the plant has found the listener
        wait_for(
            lambda: log.exists() and 'requesting incompatible QoS' in log.read_text(),
            60, 'the plant has found the listener',
        )  # fmt: skip
        nodes.append(start_node('controller', file))
    finally:
        texts = finish(nodes)
    assert [node.returncode for node in nodes] == [0, 0], texts
    assert 'a subscription gets no messages: plant/state: incompatible QoS of /test_node: ' in (
        log.read_text()
    )


def test_nodes_that_disagree_all_end_with_the_difference(tmp_path: Path, ros_domain: int) -> None:
    files = [
        write_scenario(tmp_path / f'{name}.yaml', 'pd_tip', f'duration={name}')
        for name in ('0.2', '0.3')
    ]
    nodes = [start_node(role, files[role == 'controller']) for role in ROLES]
    texts = finish(nodes, 55.0)  # the limit on joining is 60 s
    assert [node.returncode for node in nodes] == [1] * len(nodes), texts
    for text in texts:
        assert 'the nodes disagree: /**.duration is 0.' in text


@pytest.fixture
def joining(tmp_path: Path, ros_domain: int) -> Iterator[Joining]:
    """Yield a controller on its way into a run; the other nodes are the test's."""
    made = Joining(write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3'))
    yield made
    made.close()


def test_a_peer_that_knew_this_node_is_heeded(joining: Joining) -> None:
    member, board = joining.second.membership, joining.second.board
    plant = joining.peers.boards['plant']

    def told(text: str, *heard: str, **extra: str) -> None:
        extra[HEARD] = ','.join(heard)
        plant.publish(phase=Phase.FAILED, text=text, blame='recorder', extra=extra)
        wait_for(lambda: board.update() or plant_says() == (text, extra), 60, 'it is heard')

    def plant_says() -> tuple[str, dict[str, str]]:
        (status,) = [s for s in board.others.values() if s.role == 'plant']
        return status.text, status.extra

    me = board.mine.identity
    told('start: no disk', 'somebody')  # of an attempt before this node came
    assert not member.join(0.0)
    assert board.mine.text == 'no plant has joined'
    told('interrupted at tick 0', me)
    assert not member.join(0.0)
    told('tick 7: no disk', me, plant='1')  # of a run that this node comes too late for
    assert not member.join(0.0)
    told('start: no disk', 'somebody', me)
    with pytest.raises(RunFailed, match='start: no disk') as caught:
        member.join(0.1)
    assert (caught.value.blame, caught.value.reported_by) == ('recorder', 'plant')


def test_a_node_that_runs_tells_what_the_plant_waits_for(joining: Joining) -> None:
    member, board = joining.second.membership, joining.second.board
    assert member.waited_for('plant') == ''
    joining.peers.boards['plant'].publish(text='joint_command is not connected')
    wait_for(lambda: board.update() or member.waited_for('plant') != '', 60, 'the word is here')
    assert member.waited_for('plant') == ': joint_command is not connected'


def test_a_best_effort_sensor_is_named_on_the_first_look(joining: Joining) -> None:
    wire = Wire('my_encoder')
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    wire.publisher('joint_states', JointState, best_effort)
    second = joining.second
    try:

        def seen() -> bool:
            found = second.get_publishers_info_by_topic('/joint_states')
            return any(e.node_name == 'my_encoder' for e in found)

        wait_for(seen, 60, 'the sensor is in the graph')
        with pytest.raises(RunFailed, match='incompatible QoS of /my_encoder: rel') as caught:
            second.membership.join(0.0)
    finally:
        wire.close()
    assert caught.value.blame == 'encoder'


def test_our_own_endpoints_are_compatible_as_the_graph_shows_them(joining: Joining) -> None:
    second = joining.second
    for entry in second.inputs.values():
        for found in second.get_publishers_info_by_topic(entry.subscription.topic_name):
            assert connects(found.qos_profile, shown(qos_profile(entry.topic.qos)))
