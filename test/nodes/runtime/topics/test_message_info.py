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

"""
Runs where messages tell less of their publisher: as on Jazzy, on Cyclone DDS, unnumbered.

The middleware here tells all; `test/message_info` takes it away in every process.  The same
variable puts all tests of nodes on such a middleware:
``FLEXARM_TEST_MESSAGE_INFO='handle unnumbered' pytest -m nodes``.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import threading

from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.joining.status import Phase, Status, StatusBoard
from flexarm_ros.nodes.runtime.topics.channels import Input
from nodetools import finish, flexarm, flexarm_here, start_node, wait_for, write_scenario
import pytest
from repository import STANDIN

pytestmark = pytest.mark.nodes

VARIABLE = 'FLEXARM_TEST_MESSAGE_INFO'
KINDS = ('none', 'handle unnumbered', 'none unnumbered')
"""Jazzy's rclpy; Cyclone DDS; the least that is thinkable."""

each_way = pytest.mark.parametrize(
    ('kind', 'way'),
    [
        *(pytest.param(kind, [], id=f'six processes-{kind}') for kind in KINDS),
        pytest.param(KINDS[-1], ['--compose'], id=f'composed-{KINDS[-1]}'),
        *(
            pytest.param(kind, ['--compose'], id=f'composed-{kind}', marks=pytest.mark.slow)
            for kind in KINDS[:-1]
        ),
    ],
    indirect=['kind'],
)
"""Composed nodes hand most messages over themselves: the least that is told of them will do."""

PROBE = """
import rclpy
from flexarm_ros.nodes.runtime.joining.status import StatusBoard
rclpy.init()
node = rclpy.create_node("probe")
board = StatusBoard(node, "plant")
board.publish()
while board.sender_info is None:
    board.update()
print(board.sender_info.value)
"""


@pytest.fixture
def kind(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Let every process that the test starts see messages of this kind."""
    monkeypatch.setenv(VARIABLE, request.param)
    monkeypatch.setenv('PYTHONPATH', str(STANDIN.parent))
    return str(request.param)


@pytest.mark.parametrize('kind', KINDS, indirect=True)
def test_a_node_measures_what_messages_tell(kind: str, ros_domain: int) -> None:
    words = [sys.executable, '-c', PROBE]
    done = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert done.stdout == kind.split()[0] + '\n', done.stderr


@each_way
def test_a_run_has_the_bytes_of_a_simulation(
    kind: str, way: list[str], tmp_path: Path, ros_domain: int
) -> None:
    words = ('pd_tip', '--set', 'duration=0.3', '--no-pictures', '--out')
    done = flexarm('run', *words[:3], *way, *words[3:], tmp_path / 'run')
    assert done.returncode == 0, done.stderr
    assert flexarm_here('simulate', *words, tmp_path / 'sim').returncode == 0
    bags = [(tmp_path / name / 'bag' / 'bag_0.mcap').read_bytes() for name in ('run', 'sim')]
    assert bags[0] == bags[1]


@pytest.mark.parametrize('kind', KINDS, indirect=True)
def test_one_of_two_plants_of_one_name_is_refused(
    kind: str, tmp_path: Path, ros_domain: int
) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3')
    plants = [start_node('plant', file) for _ in range(2)]
    try:
        wait_for(lambda: any(node.poll() is not None for node in plants), 60, 'one has left')
        (gone,) = [node for node in plants if node.poll() is not None]
        (text,) = finish([gone])
        assert gone.returncode == 1
        assert 'refused: another plant (/plant) takes part in this run' in text
    finally:
        for node in plants:
            node.kill()
            node.communicate()


@each_way
def test_a_publisher_outside_the_run_is_noticed(
    kind: str, way: list[str], tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    from sensor_msgs.msg import JointState

    node, executor = rclpy_node
    states: list = []
    node.create_subscription(JointState, '/plant/state', states.append, 10)
    done: list = []
    words = ('run', 'pd_tip', *way, '--rtf', '0.02', '--set', 'duration=2', '--no-pictures',
             '--out', tmp_path / 'run')  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        wait_for(lambda: executor.spin_once(0.01) or states, 60, 'the run has begun')
        stranger = node.create_publisher(JointState, '/joint_command', 10)
        wait_for(lambda: stranger.get_subscription_count() >= 2, 60, 'plant and recorder hear it')
        stranger.publish(JointState(effort=[1e6, 1e6]))
    finally:
        run.join(120)
    assert done[0].returncode == 1
    assert 'invalid message on joint_command' in done[0].stderr


@pytest.mark.parametrize('kind', ['deaf'], indirect=True)
def test_a_middleware_that_cannot_do_is_refused_by_name(
    kind: str, tmp_path: Path, ros_domain: int
) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3')
    plant = start_node('plant', file)
    (text,) = finish([plant])  # at the limit on joining it says something else
    assert plant.returncode == 1
    assert "start: rmw_fastrtps_cpp does not deliver a node's own messages" in text


class _Topic:
    """A topic of which the middleware has connected so many publishers."""

    name, every, late = 'joint_command', 1, False

    def __init__(self, publishers: int) -> None:
        self.publishers = publishers

    def get_publisher_count(self) -> int:
        return self.publishers


def _unnamed_input(exact: bool, publishers: int) -> Input:
    """Return an input before tick 1 whose messages do not tell their publisher."""
    entry = Input.__new__(Input)
    entry.topic = entry.handle = _Topic(publishers)
    entry.source, entry.tick, entry.accepted = 'controller', 0, b''
    entry._unnamed, entry._exact, entry._unwanted = True, exact, 'another publisher'
    entry._rising, entry._gap, entry._jumped, entry._sender = False, False, False, b''
    entry._first_ns, entry._period_ns, entry._last_stamp = 10**9, 10**6, 10**9
    entry._sequence = 7
    return entry


def _takes(entry: Input, number: int, stamp: int) -> bool:
    """Whether the message with this number and stamp is that of tick 1."""
    if not entry._in_sequence({'publication_sequence_number': number}, 1):
        return False
    return not entry._judge(b'', stamp, (1.0,))


def test_a_message_of_a_publisher_that_has_left_is_none_of_the_runs() -> None:
    entry = _unnamed_input(exact=True, publishers=1)
    assert not _takes(entry, 1, 0)
    assert _takes(entry, 8, 1_001_000_000)
    sensor = _unnamed_input(exact=False, publishers=1)
    assert not _takes(sensor, 1, 1_000_000_000)
    assert _takes(sensor, 8, 1_000_500_000)


@pytest.mark.parametrize('exact', [True, False])
def test_a_gap_of_the_only_publisher_is_a_lost_message(exact: bool) -> None:
    with pytest.raises(RunFailed, match='a message on joint_command is lost'):
        _takes(_unnamed_input(exact, publishers=1), 9, 1_002_000_000)


def test_a_node_that_was_never_found_in_the_graph_is_forgotten() -> None:
    status = Status('encoder', '7', '/encoder', Phase.READY)
    board = StatusBoard.__new__(StatusBoard)
    board.others, board._senders, board._sources = {'7': status}, {'7': b''}, {}
    board._seen = {'7'}
    board._publishers = list  # type: ignore[method-assign]
    board.source = lambda _: b''  # type: ignore[method-assign]
    board.forget_the_gone()
    assert not board.others


def test_nodes_that_never_met_are_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where the middleware loses a link while it makes it: the second start has another."""
    apart = tmp_path / 'apart'
    apart.touch()
    monkeypatch.setenv('FLEXARM_TEST_APART', str(apart))
    monkeypatch.setenv('PYTHONPATH', str(STANDIN.parent))
    words = ('--set', 'duration=0.1', '--set', 'start_timeout=4', '--no-pictures', '--out')
    run = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'pd_tip', *words, tmp_path / 'run'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    assert run.stdout is not None
    said = []
    for line in run.stdout:
        said.append(line)
        if 'starting the nodes again' in line:
            apart.unlink()
    assert run.wait(60) == 0, said
    (again,) = [line for line in said if 'starting the nodes again' in line]
    assert 'is not connected within 4 s (publishers found: /' in again
    assert flexarm_here('verify', tmp_path / 'run').returncode == 0
    logs = (tmp_path / 'run' / 'logs-first-start').glob('*.log')
    assert any('not connected' in log.read_text() for log in logs)


def test_nodes_are_started_again_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / 'apart').touch()
    monkeypatch.setenv('FLEXARM_TEST_APART', str(tmp_path / 'apart'))
    monkeypatch.setenv('PYTHONPATH', str(STANDIN.parent))
    words = ('--set', 'duration=0.1', '--set', 'start_timeout=2', '--no-pictures', '--out')
    done = flexarm('run', 'pd_tip', *words, tmp_path / 'run')
    assert done.returncode == 1
    assert done.stderr.count('starting the nodes again') == 1
    assert done.stderr.count('is not connected within 2 s') == 2
