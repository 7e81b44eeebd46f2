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

"""The fast path beside the path in Python: it runs, and what is not plain ends as without it."""

from __future__ import annotations

from collections import deque
import math
from pathlib import Path
import time
from types import SimpleNamespace
from typing import Any

from bagtools import small_messages
from flexarm_ros import scenario
from flexarm_ros.core.sensing.parts import EncoderPart
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.topics.channels import Input
from flexarm_ros.wire.fused_step import answer_step
from flexarm_ros.wire.topics import JOINT_STATES, per_tick_topics, STATE
from nodetools import fast_ticks, finish, NUMBERED, ROLES, start_node, write_scenario
import pytest
from rcltools import Endpoint, Rcl, Taken

OURS, OTHER = b'o' * 16, b'x' * 16
CONFIG = scenario.load('fls_tip', ['duration=0.02'])
TOPICS = per_tick_topics(CONFIG)
STAMPED = TOPICS[STATE].codec
LIMIT_S = 60.0
WAITING: Any = SimpleNamespace(advanced=lambda *_: None)


@pytest.fixture
def rcl(monkeypatch: pytest.MonkeyPatch) -> Rcl:
    return Rcl(monkeypatch)


def taken(tick: int, data: bytes | None = None, number: int = 0, sender: bytes = OURS) -> Taken:
    """Return the message of ``tick``, or ``data`` in its place, as the middleware gives it."""
    return data or small_messages(CONFIG)[tick][STATE], {
        'publication_sequence_number': number or tick + 1,
        'publisher_gid': {'data': sender + bytes(8)},
    }


def input_of(queue: Endpoint, rejected: list[str], named: bool = True) -> Input:
    """Return the encoder's input; ``named``: messages show whether they are its publisher's."""
    entry = Input.__new__(Input)
    entry._take, entry._type, entry.handle = queue.take_message, None, queue
    entry._reject = lambda topic, fault: rejected.append(f'{topic}: {fault}')
    entry.near, entry._rising, entry._unnamed, entry._sender = False, False, not named, b''
    entry.accepted = OURS if named else b''
    entry.source, entry.sender = 'plant', '/plant'
    entry._unwanted = "a publisher that is not this run's plant"
    entry.arrived, entry._returned = deque(), deque()
    entry.reset()
    entry.configure(TOPICS[STATE], Timeline.of(CONFIG.run))
    return entry


def receive(
    rcl: Rcl, messages: list[Taken], fast: bool, named: bool = True
) -> tuple[list[bytes], list[str], str, int]:
    """Return accepted messages, rejections, failure, and the number of ticks on the fast path."""
    queue, rejected, answers, ticks = Endpoint(rcl, messages), list[str](), list[bytes](), 0
    entry = input_of(queue, rejected, named)
    step = answer_step(EncoderPart(CONFIG), [TOPICS[STATE]], [TOPICS[JOINT_STATES]], 1_000_000)
    assert step is not None
    path = FastPath(step, [entry], [Endpoint(rcl)], rcl)  # type: ignore[arg-type]
    tick = 0
    try:
        while queue.left or entry._returned:
            if entry.fetch(tick):
                answers.append(entry.data)
                tick += 1
            while fast and path.enter(tick, time.monotonic(), time.monotonic() + LIMIT_S):
                before, (tick, _) = tick, path.run(tick, tick + 1)
                path.leave(tick, WAITING)
                if tick == before:
                    break
                answers.append(step.inputs[0].bytes())
                ticks += 1
    except RunFailed as failure:
        return answers, rejected, failure.reason, ticks
    return answers, rejected, '', ticks


def other(tick: int, place: int = 0, value: float = 1.0, later_ns: int = 0) -> bytes:
    """Return the message of ``tick`` with another value, or another stamp."""
    stamp, values = STAMPED.decode(small_messages(CONFIG)[tick][STATE])
    changed = (*values[:place], value, *values[place + 1 :])
    return STAMPED.encode(stamp + later_ns, *changed)


def following(first: int, shift: int = 0) -> list[Taken]:
    return [taken(tick, number=tick + 1 + shift) for tick in range(first, 12)]


FAULTS: dict[str, list[Taken]] = {
    'none': following(6),
    'value that is not finite': [taken(6, other(6, 3, math.nan)), *following(6, 1)],
    'stamp of a tick before': [taken(6, small_messages(CONFIG)[5][STATE]), *following(6, 1)],
    'stamp of a tick ahead': [taken(6, other(6, later_ns=1_000_000)), *following(6, 1)],
    'cut': [taken(6, small_messages(CONFIG)[6][STATE][:40]), *following(6, 1)],
    'longer': [taken(6, small_messages(CONFIG)[6][STATE] + bytes(4)), *following(7)],
    'other layout': [taken(6, b'\0\1\0\0' + bytes(STAMPED.size - 4)), *following(6, 1)],
    'another sender': [taken(6, sender=OTHER), *following(6)],
    'lost message': following(7),
    'repeated number': [taken(6, number=6), *following(6)],
}


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_ends_as_without_the_fast_path(rcl: Rcl, fault: str) -> None:
    messages = [*(taken(tick) for tick in range(6)), *FAULTS[fault]]
    *found, ticks = receive(rcl, messages, fast=True)
    *expected, none = receive(rcl, messages, fast=False)
    assert found == expected
    assert (ticks > 4, none) == (True, 0)
    rejections, failure = found[1:]
    assert bool(rejections or failure) == (fault not in ('none', 'longer'))


@pytest.mark.parametrize('fault', FAULTS)
def test_a_fault_ends_alike_where_messages_do_not_name_their_publisher(
    rcl: Rcl, fault: str
) -> None:
    """As with rclpy of Jazzy."""
    messages = [
        (data, {key: value for key, value in info.items() if key != 'publisher_gid'})
        for data, info in (*(taken(tick) for tick in range(6)), *FAULTS[fault])
    ]
    *found, ticks = receive(rcl, messages, fast=True, named=False)
    *expected, none = receive(rcl, messages, fast=False, named=False)
    assert found == expected
    assert (ticks > 4, none) == (True, 0)


def test_a_block_of_messages_ends_as_one_by_one(rcl: Rcl) -> None:
    """The recorder's way, with whatever is not the publisher's next message in its middle."""
    for fault, messages in FAULTS.items():
        every = [*(taken(tick) for tick in range(6)), *messages]
        rejected, block = list[str](), list[bytes]()
        entry = input_of(Endpoint(rcl, every), rejected)
        entry._sequence, failure = 0, ''
        try:
            entry.fetch_block(11, block)
        except RunFailed as error:
            failure = error.reason
        assert (block, rejected, failure) == tuple(receive(rcl, every, fast=False)[:3]), fault


@pytest.mark.nodes
def test_a_normal_run_is_on_the_fast_path(tmp_path: Path, ros_domain: int) -> None:
    file = write_scenario(tmp_path / 's.yaml', 'fls_tip', 'duration=0.5')
    own = ['-p', f'output:={tmp_path / "run"}']
    nodes = []
    for role in ROLES:
        words = ['--log-level', f'{role}:=debug', *(own if role == 'recorder' else [])]
        nodes.append(start_node(role, file, *words))
    for role, node, text in zip(ROLES, nodes, finish(nodes), strict=True):
        assert node.returncode == 0, text
        fast, ticks = fast_ticks(text)
        assert ticks == 500
        if role in ('plant', 'encoder', 'tip_sensor', 'controller'):
            assert fast > 250 if NUMBERED else fast == 0, (role, text)
