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

"""A recorded run published again: pace, steps, loops, a part of it, a controller against it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
import signal
import subprocess
import sys
import threading
from types import MappingProxyType
from typing import Any

from bagtools import small_config, small_messages, write_small
from flexarm_ros.core.ending import ENDING
from flexarm_ros.nodes.player.pace import Pace
from flexarm_ros.wire.topics import per_tick_topics
from nodetools import finish, wait_for
import pytest
from repository import ROOT
from rosbag2tools import received, write_mcap
from std_srvs.srv import Trigger

pytestmark = pytest.mark.nodes
CONFIG = small_config(duration=0.3, chunk=0.1)
T0, MS = 10**9, 10**6


@pytest.fixture(scope='module')
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('run')
    write_small(directory / 'bag', CONFIG)
    return directory


class Listener:
    """A node of the test's own: what came on each topic, services, a controller's seat."""

    def __init__(self) -> None:
        import rclpy

        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = rclpy.create_node('listener', context=self.context)
        self.executor = rclpy.executors.SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.thread = threading.Thread(target=self._spin)
        self.came: dict[str, list[bytes]] = {}
        self.stop = threading.Event()

    def _spin(self) -> None:
        while not self.stop.is_set():
            self.executor.spin_once(timeout_sec=0.1)

    def hear(self, *indices: int, under: Mapping[str, str] = MappingProxyType({})) -> None:
        """Take the messages of these topics as bytes; ``under`` has names that are others."""
        from flexarm_ros.nodes.runtime.topics.graph import message_class, qos_profile

        for index in indices:
            topic = per_tick_topics(CONFIG)[index]
            heard = self.came[topic.path] = []
            self.node.create_subscription(
                message_class(topic.type_name), under.get(topic.path, topic.path), heard.append,
                qos_profile(topic.qos), raw=True,
            )  # fmt: skip
        self.thread.start()

    def stamps(self) -> list[int]:
        """Return the ticks of the messages that came on ``/clock``."""
        codec = per_tick_topics(CONFIG)[0].codec
        return [(codec.decode(data)[0] - T0) // MS for data in list(self.came['/clock'])]

    def begin(self, namespace: str = '') -> None:
        """
        Let a player go on that waits for its readers, `--paused`.

        Who has an answer from it is known to it, and so are the subscriptions that were made
        before the client.
        """
        for name in ('pause', 'resume'):
            assert self.call(name, Trigger, namespace).success

    def call(self, name: str, kind: Any, namespace: str = '', **request: object) -> Any:
        """Call a service of the player."""
        client = self.node.create_client(kind, f'{namespace}/player/{name}')
        assert client.wait_for_service(60)
        future = client.call_async(kind.Request(**request))
        wait_for(future.done, 20, name)
        return future.result()

    def close(self) -> None:
        import rclpy

        self.stop.set()
        if self.thread.ident is not None:
            self.thread.join(60)
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def listener(ros_domain: int) -> Iterator[Listener]:
    made = Listener()
    yield made
    made.close()


def replay(*words: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'replay', *map(str, words)],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip


def test_other_names_a_duration_and_topics_left_out(run: Path, listener: Listener) -> None:
    listener.hear(0, 1, 3, 5, under={
        '/plant/state': '/left/plant/state', '/tip_sensor/odometry': '/left/tip_sensor/odometry',
        '/joint_command': '/torque',
    })  # fmt: skip
    player = replay(
        run, '--rate', '0', '--delay', '0', '--paused', '--start', '0.1', '--duration', '0.05',
        '--exclude', 'tip_sensor/odometry', '--namespace', 'left', '-m', 'joint_command:=/torque',
    )  # fmt: skip
    try:
        listener.begin('/left')
    finally:
        (text,) = finish([player])
    assert player.returncode == 0, text
    assert 'played 51 ticks' in text  # both ends, as `ros2 bag play` has it
    wait_for(lambda: len(listener.came['/joint_command']) == 51, 60, 'the last torque')
    assert listener.stamps() == list(range(100, 151))
    truth = small_messages(CONFIG)[100:151]
    assert listener.came['/plant/state'] == [tick[1] for tick in truth]
    assert listener.came['/joint_command'] == [tick[5] for tick in truth]
    assert listener.came['/tip_sensor/odometry'] == []


@pytest.mark.parametrize(
    ('words', 'complaint'),
    [
        (['--exclude', 'nix'], "exclude: 'nix' is not in the bag"),
        (['--remap', 'nix'], 'nix: not a remapping rule OLD:=NEW'),
        (['--duration', 'nan'], 'nan: a number from -1e+06 to 1e6'),
    ],
)
def test_a_bad_option_is_named(run: Path, words: list[str], complaint: str) -> None:
    (text,) = finish([player := replay(run, '--delay', '0', *words)])
    assert player.returncode == 2
    assert complaint in text


def test_of_several_runs_that_in_the_player_s_namespace_is_played(
    tmp_path: Path, ros_domain: int
) -> None:
    right = received(CONFIG, lambda k, t: k < 200, namespace='/right', others=False)
    messages = [*received(CONFIG, namespace='/left'), *right]
    bag = write_mcap(tmp_path / 'x.mcap', messages)
    words = ('--scenario', 'fls_tip', '--set', 'duration=0.3', '--rate', '0', '--delay', '0')
    for more, status, said in (
        (['--namespace', 'right'], 0, '/left/plant/state'),  # left out
        (['--namespace', 'here', '--from-namespace', 'left'], 0, '/right/plant/state'),
        ([], 2, 'choose one: /left, /right'),
    ):
        (text,) = finish([player := replay(bag, *words, *more)])
        assert said in (text if status else text.partition('topics are left out')[2])
        assert player.returncode == status


def test_pause_step_rate_and_a_part_of_the_topics(run: Path, listener: Listener) -> None:
    from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
    from rcl_interfaces.srv import DescribeParameters, SetParameters

    listener.hear(0, 1, 5)
    player = replay(run, '--paused', '--rate', '1e-6', '--topics', 'joint_command')
    try:
        wait_for(lambda: listener.node.count_publishers('/joint_command') == 1, 60, 'the player')
        for count in (1, 2, 3):
            assert listener.call('play_next', Trigger).success
            wait_for(lambda n=count: len(listener.came['/joint_command']) == n, 60, 'a step')
        assert listener.call('toggle_paused', Trigger).message == 'playing'
        assert not listener.call('play_next', Trigger).success  # not paused
        assert listener.call('pause', Trigger).message == 'paused'
        # At a millionth of real time nothing else has come but the first tick after the pause.
        wait_for(lambda: listener.stamps() == [0, 1, 2, 3], 60, 'the tick after the pause')
        assert listener.call('resume', Trigger).success
        for value, accepted in ((-1, False), (0, True)):  # integers, as `ros2 param set` sends
            held = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=value)
            change = [Parameter(name='rate', value=held)]
            answer = listener.call('set_parameters', SetParameters, parameters=change)
            assert answer.results[0].successful is accepted, answer
        names = ['rate', 'start', 'bag']
        told = listener.call('describe_parameters', DescribeParameters, names=names).descriptors
        assert [d.read_only for d in told] == [False, True, True]
        for rate_or_start in told[:2]:
            (limits,) = rate_or_start.floating_point_range
            assert (limits.from_value, limits.to_value) == (0.0, 1e6)
        assert told[1].description.endswith('[s]')
    except BaseException:
        player.kill()
        raise
    finally:
        (text,) = finish([player])
    assert player.returncode == 0, text
    wait_for(lambda: len(listener.came['/joint_command']) == 300, 60, 'every torque')
    torques = [messages[5] for messages in small_messages(CONFIG)]
    assert listener.came['/joint_command'] == torques
    assert listener.stamps() == list(range(300))
    assert listener.came['/plant/state'] == []


@pytest.mark.parametrize(
    ('number', 'status'),
    [
        (signal.SIGINT, 130),
        (signal.SIGHUP, 129),
        pytest.param(signal.SIGTERM, 143, marks=pytest.mark.slow),
    ],
)
def test_a_loop_from_the_middle_ends_with_a_signal(
    number: int, status: int, run: Path, listener: Listener
) -> None:
    listener.hear(0)
    player = replay(run, '--loop', '--start', '0.25', '--rate', '5')
    try:
        wait_for(lambda: len(listener.came['/clock']) > 170, 60, 'more than three rounds')
    finally:
        player.send_signal(number)
        (text,) = finish([player])
    assert player.returncode == status, text
    assert 'Traceback' not in text
    stamps = listener.stamps()
    first = stamps.index(250)  # the listener may have been found in the first round
    assert stamps[first:][:100] == [*range(250, 300), *range(250, 300)]


class Answers:
    """A controller that answers ``plant/state`` as the test wants."""

    def __init__(self, listener: Listener, change: Callable[[Any, int], None]) -> None:
        from sensor_msgs.msg import JointState

        self._kind, self._change, self.count = JointState, change, 0
        self._torque = listener.node.create_publisher(JointState, 'joint_command', 1000)
        listener.node.create_subscription(JointState, 'plant/state', self._answer, 1000)

    def _answer(self, state: Any) -> None:
        command = self._kind(name=['shoulder', 'elbow'], effort=[1.0, 2.0])
        command.header.stamp = state.header.stamp
        self._change(command, self.count)
        self.count += 1
        self._torque.publish(command)


def late_stamp(command: Any, count: int) -> None:
    if count == 3:
        command.header.stamp.nanosec += 7


def short_array(command: Any, count: int) -> None:
    if count == 3:
        command.effort = [1.0]


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (
            late_stamp,
            'tick 3: no joint_command within 2 s; one with stamp 1003000007 ns arrived, expected',
        ),
        (short_array, 'tick 3: joint_command: '),
    ],
)
def test_a_controller_that_breaks_the_protocol_is_told(
    change: Callable[[Any, int], None], words: str, run: Path, listener: Listener
) -> None:
    Answers(listener, change)
    listener.hear(0)
    player = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.nodes', 'player', '--ros-args', '-p', f'bag:={run}',
         '-p', 'without:=controller', '-p', 'rate:=0', '-p', 'tick_timeout:=2.0'],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip
    (text,) = finish([player])
    assert player.returncode == 1, text
    assert words in text
    assert 'Traceback' not in text
    assert listener.stamps() == [0, 1, 2, 3]  # in lock-step: no tick ahead of the torque


def test_somebody_elses_controller_against_a_recorded_run(run: Path, listener: Listener) -> None:
    answers = Answers(listener, lambda command, count: None)
    listener.hear(0)
    player = replay(run, '--without', 'controller', '--rate', '0')
    (text,) = finish([player])
    assert player.returncode == 0, text
    assert '300 torques, 0 equal to the recorded ones' in text
    assert answers.count == 300


@pytest.fixture
def played(ros_domain: int, capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run the player in this process: ``(status, what it said)``."""
    from flexarm_ros.nodes.player.player import play

    def run_it(*assignments: str) -> tuple[int, str]:
        words = [word for text in assignments for word in ('-p', text)]
        status = play(['--ros-args', *words])
        return status, capfd.readouterr().err

    held = [signal.getsignal(s) for s in ENDING]
    yield run_it
    for number, handler in zip(ENDING, held, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize(
    ('given', 'words'),
    [
        ([], 'bag: missing'),
        (['bag:=RUN', 'rate:=-1'], 'player.rate: -1 is out of range'),
        (['bag:=RUN', 'rate:=.nan'], 'player.rate: .nan is not a finite number'),
        (['bag:=RUN', 'rate:=fast'], "player.rate: 'fast' is not a number"),
        (['bag:=RUN', 'rate:=true'], 'player.rate: true is not a number'),
        (['bag:=RUN', 'start:=0.3'], "start: 0.3 s is not before the run's end at 0.3 s"),
        (['bag:=RUN', 'loop:=1'], 'player.loop: 1 is not true or false'),
        (['bag:=RUN', 'topics:=clock, nothing'], "topics: 'nothing' is not in the bag: /clock"),
        (['bag:=RUN', 'without:=plant'], "without: 'plant' is not allowed"),
        (['bag:=RUN', 'without:=controller', 'loop:=true'], 'loop: true is not allowed'),
        (['bag:=RUN', 'speed:=2'], 'player.speed: unknown key'),
        (['bag:=/nothing/there'], 'no such file'),
        (['bag'], "Couldn't parse"),
    ],
)
def test_bad_parameters_of_the_player(
    given: list[str], words: str, run: Path, played: Callable[..., tuple[int, str]]
) -> None:
    status, text = played(*(word.replace('RUN', str(run)) for word in given))
    assert status == 2
    assert words in text
    assert 'Traceback' not in text
    assert 'played' not in text


def test_a_damaged_bag_is_played_as_far_as_it_goes(
    run: Path, tmp_path: Path, played: Callable[..., tuple[int, str]]
) -> None:
    sound = (run / 'bag' / 'bag_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(sound[: len(sound) // 2])
    status, text = played(f'bag:={tmp_path / "cut.mcap"}', 'rate:=0', 'delay:=0')
    assert status == 1
    assert 'player: after 100 ticks: ' in text
    assert 'damaged at byte' in text


def test_messages_of_one_tick_go_out_in_the_order_of_the_bag(
    run: Path, monkeypatch: pytest.MonkeyPatch, played: Callable[..., tuple[int, str]]
) -> None:
    from flexarm_ros.nodes.player.player import PlayerNode

    sent: list[tuple[str, bytes]] = []
    made = PlayerNode.create_publisher

    def create_publisher(self: PlayerNode, kind: Any, topic: str, *rest: Any, **more: Any) -> Any:
        publisher = made(self, kind, topic, *rest, **more)
        if isinstance(rest[0], int) or topic in names:  # not /rosout and the like
            monkeypatch.setattr(publisher, 'publish', lambda data: sent.append((topic, data)))
        return publisher

    names = [topic.name for topic in per_tick_topics(CONFIG)]
    monkeypatch.setattr(PlayerNode, 'create_publisher', create_publisher)
    status, _ = played(f'bag:={run}', 'rate:=0', 'delay:=0')
    assert status == 0
    expected = [pair for tick in small_messages(CONFIG) for pair in zip(names, tick, strict=True)]
    assert sent == expected


@pytest.mark.parametrize('words', [(), ('scenario:=fls_tip', 'set:=duration=0.3')])
def test_a_bag_of_another_recorder_is_played_by_its_stamps(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    played: Callable[..., tuple[int, str]],
) -> None:  # fmt: skip
    """Begun late, without a clock, with the reference in bursts: in order, and with a clock."""
    from flexarm_ros.nodes.player.player import PlayerNode

    sent: list[tuple[str, bytes]] = []
    made = PlayerNode.create_publisher

    def create_publisher(self: PlayerNode, kind: Any, topic: str, *rest: Any, **more: Any) -> Any:
        publisher = made(self, kind, topic, *rest, **more)
        if topic in names:
            monkeypatch.setattr(publisher, 'publish', lambda data: sent.append((topic, data)))
        return publisher

    names = [topic.name for topic in per_tick_topics(CONFIG)]
    monkeypatch.setattr(PlayerNode, 'create_publisher', create_publisher)
    bag = write_mcap(
        tmp_path / 'x.mcap', list(received(CONFIG, lambda k, t: t > 0 and k >= 100)), chunked=False
    )
    status, text = played(f'bag:={bag}', 'rate:=0', 'delay:=0', *words)
    assert status == 0, text
    assert 'played 200 ticks' in text
    assert 'starts at tick 100' in text and 'left out: /chatter' in text
    truth = small_messages(CONFIG)[100:]
    assert sent == [pair for tick in truth for pair in zip(names, tick, strict=True)]


@pytest.mark.parametrize(
    ('words', 'status', 'complaint'),
    [
        (('without:=controller',), 2, 'a controller needs every tick: starts at tick 100'),
        (('set:=duration=0.3',), 2, 'set: needs scenario'),
        (('scenario:=/not/there.yaml',), 2, 'there.yaml: no such file'),
        (('namespace:=arm',), 2, 'no run in namespace /arm'),
        (('topics:=reference',), 2, "topics: 'reference' is not in the bag: /clock"),
        (('start:=0.2999',), 1, 'no tick from 0.2999 s on'),
    ],
)
def test_what_of_another_recorder_s_bag_cannot_be_played(
    words: tuple[str, ...], status: int, complaint: str, tmp_path: Path,
    played: Callable[..., tuple[int, str]],
) -> None:  # fmt: skip
    messages = received(CONFIG, lambda k, t: 100 <= k < 299)
    bag = write_mcap(tmp_path / 'x.mcap', [m for m in messages if m.topic != '/reference'])
    scenario = [] if 'scenario' in words[0] or 'set' in words[0] else ['scenario:=fls_tip']
    found, text = played(f'bag:={bag}', 'delay:=0', 'rate:=0', *scenario, *words)
    assert complaint in text
    assert found == status


def test_a_bag_without_a_message_is_an_error(
    tmp_path: Path, played: Callable[..., tuple[int, str]]
) -> None:
    from flexarm_ros.bag.writer import BagWriter

    with BagWriter(tmp_path / 'none', CONFIG):
        pass
    status, text = played(f'bag:={tmp_path / "none"}', 'delay:=0', 'rate:=0')
    assert (status, text.count('no tick from 0 s on')) == (1, 1)


def test_a_pace_keeps_time_over_many_ticks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Late ticks are caught up, a long hold-up is not; a clock of the test's own."""
    clock = [100.0]
    monkeypatch.setattr('flexarm_ros.nodes.player.pace.time.monotonic', lambda: clock[0])
    pace = Pace(2.0, False, lambda: False)

    def slept(seconds: float) -> None:
        clock[0] += seconds

    monkeypatch.setattr(pace._wake, 'wait', slept)
    pace.wait(0.01)
    start = clock[0]
    for _ in range(100):
        clock[0] += 0.002  # work between the ticks, less than the 5 ms that each has
        pace.wait(0.01)
    assert clock[0] - start == pytest.approx(0.5)
    clock[0] += 0.05  # behind by ten ticks
    for _ in range(20):
        pace.wait(0.01)
    assert clock[0] - start == pytest.approx(0.6)
    clock[0] += 60.0  # a hold-up: no burst of a minute's ticks behind it
    for _ in range(100):
        pace.wait(0.01)
    assert clock[0] - start == pytest.approx(60.6 + 0.5 - 0.1, abs=0.011)
    pace.set_rate(0.0)
    before = clock[0]
    pace.wait(1e9)
    assert clock[0] == before


def test_a_paused_pace_waits_and_steps() -> None:
    stop = threading.Event()
    pace = Pace(0.0, True, stop.is_set)
    out: list[int] = []

    def go() -> None:
        for tick in range(100):
            pace.wait(0.001)
            if stop.is_set():
                return
            out.append(tick)

    thread = threading.Thread(target=go)
    thread.start()
    assert pace.step()
    assert pace.step()
    wait_for(lambda: out == [0, 1], 60, 'two steps')
    stop.set()
    thread.join(60)
    assert not thread.is_alive()
    assert out == [0, 1]
    pace.pause(False)
    assert not pace.step()


@pytest.mark.parametrize('paused', [False, True])
def test_a_stopped_pace_does_not_wait(paused: bool) -> None:
    pace = Pace(1.0, paused, lambda: True)

    def go() -> None:
        pace.wait(3600.0)
        pace.wait(3600.0)

    thread = threading.Thread(target=go, daemon=True)
    thread.start()
    thread.join(60)
    assert not thread.is_alive()
