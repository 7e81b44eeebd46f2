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
Rubbish on every wire of every node: the physics never sees it, and nothing falls over.

Each example publishes some hostile messages, from the publisher that the node listens to and from
a stranger's, and then the right message of the next tick: the node must answer with the bytes that
it has in a simulation.  By default some tens of examples a node; `pytest -m slow` tries thousands.
"""

from __future__ import annotations

from collections.abc import Callable
import math
from pathlib import Path
import random
import struct
import subprocess
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from flexarm_ros.core.run.parts import part_of
from flexarm_ros.nodes.runtime.joining import status
from flexarm_ros.nodes.runtime.topics.endpoints import NO_OVERRIDES
from flexarm_ros.nodes.runtime.topics.graph import (
    message_class,
    RECORDED_TOPIC,
    TICK_EVERY,
    TICK_TOPIC,
)
from flexarm_ros.nodes.runtime.topics.graph import qos_profile as qos_of
from flexarm_ros.wire.topics import Topic
from hypothesis import given, HealthCheck, Phase, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from nodetools import fast_ticks, finish, NUMBERED, ROLES, wait_for, write_scenario
import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import UInt64
from wiretools import fly_against, Peers, Wire

pytestmark = pytest.mark.nodes

TICKS = 4000
_AHEAD = 100
"""Ticks before the recorder's report, with some messages of rubbish each."""
SEEDS = st.integers(0, 2**32 - 1)
DOUBLES = (math.nan, math.inf, -math.inf, -math.nan)


def wrong_stamp(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Return the right values with a stamp of the past, the future, or no time at all."""
    stamp, values = topic.codec.decode(peers.right(topic, tick))
    ahead = [peers.timeline.period_ns, 10**9, 10**18]
    behind = [-1, -peers.timeline.period_ns, -stamp, -2 * stamp]
    # Which tick a measurement belongs to is told by its place, so an old one may be right.
    late = part_of(topic.node).LATE
    return topic.codec.encode(stamp + dice.choice(ahead if late else ahead + behind), *values)


def not_finite(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Make one value no number."""
    stamp, values = topic.codec.decode(peers.right(topic, tick))
    changed = list(values)
    if not changed:
        return cut(peers, topic, tick, dice)
    changed[dice.randrange(len(changed))] = dice.choice(DOUBLES)
    return topic.codec.encode(stamp, *changed)


def old_or_future(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Return the message of another tick, or the last one again."""
    if part_of(topic.node).LATE:
        return peers.right(topic, min(TICKS - 1, tick + 40 + dice.randrange(100)))
    other = [t for t in (0, tick - 1, tick + 1, tick + 100) if t != tick and 0 <= t < TICKS]
    return peers.right(topic, dice.choice(other))


def cut(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Break a message off; one byte at least, since Fast DDS cannot deliver none."""
    data = peers.right(topic, tick)
    return data[: dice.randrange(1, 12 if topic.name == '/clock' else len(data) - 20)]


def noise(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Return bytes of no message."""
    return b'\x00\x01\x00\x00' + dice.randbytes(dice.randrange(1, 8))


def lengths(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Let a length or count in the message promise more than there is."""
    data = bytearray(peers.right(topic, tick))
    if topic.name == '/clock':
        return cut(peers, topic, tick, dice)
    struct.pack_into('<I', data, 12, dice.choice((2**31, 2**32 - 1, 10**6, 0)))
    return bytes(data)


def other_arrays(peers: Peers, topic: Topic, tick: int, dice: random.Random) -> bytes:
    """Give a well-formed message arrays of other lengths, or other names."""
    kind = message_class(topic.type_name)
    if 'JointState' not in topic.type_name:
        return wrong_stamp(peers, topic, tick, dice)
    count = dice.choice((0, 1, 3, 7, 5000))
    made = kind(name=[f'joint{i}' for i in range(count)])
    values = [dice.uniform(-1e9, 1e9) for _ in range(dice.choice((0, 1, 2, count)))]
    made.position = made.velocity = made.effort = values
    return bytes(serialize_message(made))


RUBBISH = (wrong_stamp, not_finite, old_or_future, cut, noise, lengths, other_arrays)


def any_status(dice: random.Random) -> DiagnosticStatus | bytes:
    """Make a word of somebody who is no member, or speaks in a member's name."""
    if dice.random() < 0.3:
        return b'\x00\x01\x00\x00' + dice.randbytes(dice.randrange(1, 60))
    numbers = ('', 'abc', '-1', 'nan', 'inf', '9' * 5000, '0', '3', '1e999')
    values = {
        'phase': dice.choice(['failed', 'done', 'refused', 'running', 'ready', 'x', '']),
        'node': dice.choice(['/plant', 'x' * 5000, '\x1b[2J']),
        'last_tick': dice.choice(numbers),
        'blame': dice.choice([*ROLES, 'nobody']),
        'parameters': dice.choice(['', '{', '[' * 9000, '{"run": {}}']),
        'epoch': dice.choice(numbers),
        'pace_s': dice.choice(numbers),
        'priority': dice.choice(numbers),
    }
    kept = [KeyValue(key=k, value=v) for k, v in values.items() if dice.random() < 0.95]
    return DiagnosticStatus(
        name=dice.choice([*ROLES, '', 'ghost']),
        hardware_id=dice.choice(['', '0', 'z' * 5000]),
        values=kept,
    )


class Fuzz:
    """One node under fire."""

    def __init__(self, role: str, peers: Peers, node: subprocess.Popen[str]) -> None:
        self.role, self.peers, self.node = role, peers, node
        self.stranger = Wire('stranger')
        self.tick = self.sent = self.strange = 0
        for topic in peers.inputs:
            if topic.name != '/clock':  # every arm of a graph has one: it is told from the others'
                kind = message_class(topic.type_name)
                self.stranger.publisher(topic.name, kind, qos_of(topic.qos))
        self.stranger.publisher(status.TOPIC, DiagnosticStatus, status._QOS)
        for name in (TICK_TOPIC, RECORDED_TOPIC):
            self.stranger.publisher(name, UInt64, 1)
            peers.publisher(name, UInt64, 1)
        self.recorded = 0  # ticks, as the recorder tells
        self._reports: Any = peers.node.create_subscription(
            UInt64, RECORDED_TOPIC, lambda _: None, 10, qos_overriding_options=NO_OVERRIDES
        )

    def example(self, seed: int) -> None:
        """Publish rubbish, then what is right, and compare the node's answer."""
        dice = random.Random(seed)
        for _ in range(dice.randrange(3)):
            self.stranger.publisher(status.TOPIC, None, None).publish(any_status(dice))
        count = UInt64(data=dice.choice((0, 2**63, 2**64 - 1)))
        for name in (TICK_TOPIC, RECORDED_TOPIC):
            self.stranger.publisher(name, None, None).publish(count)
        most = dice.choice((1, 3))  # without rubbish the node comes to be on its fast path
        for topic in self.peers.inputs:
            for _ in range(dice.randrange(most)):
                data = dice.choice(RUBBISH)(self.peers, topic, self.tick, dice)
                if dice.random() < 0.8:
                    self.peers.send(topic, data)
                    self.sent += 1
                elif topic.name != '/clock':
                    self.stranger.publisher(topic.name, None, None).publish(data)
                    self.strange += 1
        self.step()
        self.tick += 1

    def step(self) -> None:
        """One tick as it should be."""
        peers = self.peers
        if self.role == 'trajectory' and self.tick % TICK_EVERY == 0:
            self._report()
        if self.role == 'plant':
            peers.publisher(RECORDED_TOPIC, None, None).publish(UInt64(data=self.tick))
            self._answer()
        for topic in peers.inputs:
            peers.send(topic, peers.right(topic, self.tick))
        if self.role != 'plant':
            self._answer()
        if self.role == 'recorder':
            self._wait_for_the_recorder()

    def _wait_for_the_recorder(self) -> None:
        """Run ahead as far as a plant does at most, lest the queues of the recorder overflow."""
        reports = self._reports.handle

        def near() -> bool:
            while (taken := reports.take_message(UInt64, False)) is not None:
                if taken[0].data <= self.tick + 1:  # not a stranger's
                    self.recorded = max(self.recorded, taken[0].data)
            assert self.node.poll() is None, self.node.communicate()[0]
            return self.tick - self.recorded < _AHEAD

        wait_for(near, 60, 'progress of the recorder')

    def _report(self) -> None:
        """Publish the plant's tick; another publisher's report may take its place in the queue."""
        if self.role == 'trajectory':
            reached = self.tick // TICK_EVERY * TICK_EVERY
            self.peers.publisher(TICK_TOPIC, None, None).publish(UInt64(data=reached))

    def _answer(self) -> None:
        for topic in self.peers.output:
            got = self.peers.hear(topic, self.node, self._report)
            right = self.peers.right(topic, self.tick)
            assert topic.codec.decode(got) == topic.codec.decode(right), (topic.name, self.tick)


IN_PYTHON = {
    'plant': 'imu.location=9',
    'encoder': 'encoder.noise_std=1e-4',
    'tip_sensor': 'tip_sensor.noise_std=1e-4',
    'controller': 'controller.compute_delay=1e-3',
}
"""What leaves a node without its fast path."""


def under_fire(role: str, tmp_path: Path, count: int, *settings_: str) -> int:
    """Fly ``role`` through ``count`` examples to a good end; return its ticks on the fast path."""
    file = write_scenario(
        tmp_path / 's.yaml', 'fls_mid_corrected', f'duration={TICKS / 1000}', 'on_invalid=ignore',
        'tick_timeout=60', *settings_,
    )  # fmt: skip
    own = ['-p', f'output:={tmp_path / "run"}'] if role == 'recorder' else []
    own += ['--log-level', f'{role}:=debug']
    peers, node = fly_against(role, file, *own)
    fuzz = Fuzz(role, peers, node)
    try:

        @settings(
            max_examples=count, deadline=None, suppress_health_check=list(HealthCheck),
            phases=[Phase.generate], database=None,
        )  # fmt: skip
        @given(SEEDS)
        def run(seed: int) -> None:
            fuzz.example(seed)

        run()
        return check_left(fuzz, tmp_path)
    finally:
        node.kill()
        node.wait()
        fuzz.stranger.close()
        peers.close()


def check_left(fuzz: Fuzz, tmp_path: Path) -> int:
    """End the run; the node leaves in good order and has counted what it passed over."""
    if fuzz.role == 'plant':  # it leaves at a tick that is whole
        fuzz.node.terminate()
        wait_for(lambda: answered_and_ended(fuzz), 60, "the plant's end")
    fuzz.peers.end(fuzz.tick)
    (text,) = finish([fuzz.node])
    assert fuzz.node.returncode == (143 if fuzz.role == 'plant' else 0), text
    assert 'Traceback' not in text
    assert '\x1b[2J' not in text
    if fuzz.sent:
        (last,) = [line for line in text.splitlines() if 'in all' in line]
        counted = int(last.split(']: ')[1].split()[0])
        assert fuzz.sent <= counted <= fuzz.sent + fuzz.strange, text
    if fuzz.role == 'recorder':
        check_recorded(fuzz, tmp_path / 'run' / 'bag' / 'bag_0.mcap')
    return fast_ticks(text)[0]


def answered_and_ended(fuzz: Fuzz) -> bool:
    """Answer the plant's next tick; whether the plant has left."""
    (command,) = fuzz.peers.inputs
    fuzz.peers.send(command, fuzz.peers.right(command, fuzz.tick))
    fuzz.tick += 1
    return fuzz.node.poll() is not None


def check_recorded(fuzz: Fuzz, file: Path) -> None:
    """Check that the bag has what was right, and nothing else."""
    topics = {topic.path: topic for topic in fuzz.peers.topics}
    count = 0
    with open(file, 'rb') as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            tick = message.sequence - 1
            assert message.data == fuzz.peers.right(topics[channel.topic], tick)
            count += 1
    assert count == fuzz.tick * len(topics)


@pytest.mark.parametrize('role', ROLES)
def test_rubbish_on_the_wire_changes_nothing(role: str, tmp_path: Path, ros_domain: int) -> None:
    fast = role in IN_PYTHON and NUMBERED
    assert bool(under_fire(role, tmp_path, 60)) == fast


@pytest.mark.parametrize('role', IN_PYTHON)
def test_rubbish_changes_nothing_on_the_path_in_python(
    role: str, tmp_path: Path, ros_domain: int
) -> None:
    assert not under_fire(role, tmp_path, 60, IN_PYTHON[role])


@pytest.mark.slow
@pytest.mark.parametrize('role', ROLES)
def test_much_rubbish_on_the_wire_changes_nothing(
    role: str, tmp_path: Path, ros_domain: int
) -> None:
    under_fire(role, tmp_path, 3500)


ONE: dict[str, Callable[..., bytes]] = {made.__name__: made for made in RUBBISH}


@pytest.mark.parametrize('kind', ['not_finite', 'old_or_future'])
def test_by_default_one_invalid_message_ends_the_run(
    kind: str, tmp_path: Path, ros_domain: int
) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip', 'duration=0.3')
    peers, node = fly_against('controller', file)
    try:
        fuzz = Fuzz('controller', peers, node)
        fuzz.stranger.close()
        fuzz.step()
        fuzz.tick = 1
        state = next(topic for topic in peers.inputs if topic.name == 'plant/state')
        peers.send(state, _shorter(ONE[kind], peers, state))
        for topic in peers.inputs:
            peers.send(topic, peers.right(topic, 1))
        (text,) = finish([node])
    finally:
        node.kill()
        node.wait()
        peers.close()
    assert node.returncode == 1
    assert 'tick 1: invalid message on plant/state: ' in text
    assert 'Traceback' not in text


def _shorter(made: Callable[..., Any], peers: Peers, topic: Topic) -> bytes:
    """Return a message of tick 1 that is wrong, within the few ticks of this run."""
    if made is old_or_future:
        return peers.right(topic, 0)
    return bytes(made(peers, topic, 1, random.Random(0)))
