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

"""The compiled loops of the nodes over a stand-in of rcl: the bytes of a simulation, and ends."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

from bagtools import small_messages
from flexarm_ros import scenario
from flexarm_ros.core.arm.plant import instability
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.parts import part_of
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.nodes.runtime.fast_path import FastPath
from flexarm_ros.nodes.runtime.topics import rcl_ports
from flexarm_ros.wire.fused_step import (
    answer_step,
    DUE,
    plant_step,
    reference_step,
    SENT,
    UNSTABLE,
)
from flexarm_ros.wire.rcl_calls import LINK
from flexarm_ros.wire.topics import per_tick_topics, Topic
import pytest
from rcltools import Endpoint, Rcl, Taken

LIMIT_S = 60.0
CASES = (
    ('fls_tip',),
    ('pd_mid_corrected', 'encoder.resolution=1e-3', 'encoder.latency=2.5e-3'),
    ('pd_tip', 'tip_sensor.latency_model=pade2', 'controller.velocity_source=encoder'),
    ('fls_mid', 'tip_sensor.measurand=elastic', 'controller.torque_limit=200'),
    ('pd_collocated', 'plant.model=full', 'plant.modes=2', 'controller.feedback=encoder'),
    ('pd_tip', 'trajectory.delay=2.5e-3', 'clock_rate=250'),
)
each_case = pytest.mark.parametrize('case', CASES, ids=lambda case: case[-1])


class Loop:
    """The fast path of one role, with the bytes of a simulation in its queues."""

    def __init__(self, rcl: Rcl, role: str, *case: str) -> None:
        self.config = scenario.load(case[0], ['duration=0.15', *case[1:]])
        self.ticks = len(small_messages(self.config))
        self.topics = per_tick_topics(self.config)
        named = {topic.name: topic for topic in self.topics}
        kind: Any = part_of(role)
        self.reads = [named[name] for name in kind.reads(self.config)]
        self.writes = [topic for topic in self.topics if topic.node == role]
        self.inputs = [Endpoint(rcl, self.taken(topic)) for topic in self.reads]
        self.outputs = {topic.name: Endpoint(rcl) for topic in self.writes}
        self.tick = Endpoint(rcl)
        self.entries: list[Any] = [
            input_stub(topic, handle)
            for topic, handle in zip(self.reads, self.inputs, strict=True)
        ]
        self.role, self.plant = role, make_plant(self.config)
        self.open(rcl)

    def open(self, rcl: Rcl) -> None:
        """Make the fast path."""
        period_ns = Timeline.of(self.config.run).period_ns
        kind: Any = part_of(self.role)
        handles: Any = list(self.outputs.values())
        step: Any
        if self.role == 'plant':
            handles = [self.tick, self.outputs['plant/state'], self.outputs['/clock']]
            step = plant_step(self.plant, self.config, self.topics, 4)
        else:
            step = answer_step(kind(self.config), self.reads, self.writes, period_ns)
        assert step is not None
        self.step = step
        self.path = FastPath(step, self.entries, handles, rcl)  # type: ignore[arg-type]

    def message(self, topic: Topic, tick: int) -> bytes:
        return small_messages(self.config)[tick][self.topics.index(topic)]

    def expected(self, topic: Topic, first: int, last: int) -> list[bytes]:
        return [self.message(topic, t) for t in range(first, last) if topic.due(t)]

    def taken(self, topic: Topic) -> list[Taken]:
        sender = {'publisher_gid': {'data': b'o' * 16}}
        return [
            (self.message(topic, t), {'publication_sequence_number': t + 1, **sender})
            for t in range(self.ticks)
        ]

    def run(self, tick: int, last: int, until_s: float = LIMIT_S) -> Any:
        now = time.monotonic()
        for entry in self.entries:
            entry.number = tick
        assert self.path.enter(tick, now, now + until_s)
        return self.path.run(tick, last)


def input_stub(topic: Topic, handle: Endpoint) -> Any:
    """Return what a `FastPath` needs of an input whose publisher is named."""
    entry = SimpleNamespace(topic=topic, handle=handle, plain=True, tick=-1, number=0)

    def lend(port: Any) -> None:
        port['number'], port['named'], port['state'] = entry.number, 1, 0
        port['sender'] = int.from_bytes(b'o' * 8, 'little')

    entry.lend = lend
    return entry


@pytest.fixture
def rcl(monkeypatch: pytest.MonkeyPatch) -> Rcl:
    return Rcl(monkeypatch)


@each_case
@pytest.mark.parametrize('role', ['encoder', 'tip_sensor', 'controller'])
def test_an_answering_node_publishes_the_bytes_of_a_simulation(
    rcl: Rcl, role: str, case: tuple[str, ...]
) -> None:
    loop = Loop(rcl, role, *case)
    assert loop.run(0, loop.ticks) == (loop.ticks, False)
    for topic in loop.writes:
        assert loop.outputs[topic.name].published == loop.expected(topic, 0, loop.ticks)
    assert rcl.waits == [loop.inputs[0]] * loop.ticks  # one wait a tick, for the last to come


@each_case
def test_the_plant_publishes_the_bytes_of_a_simulation(rcl: Rcl, case: tuple[str, ...]) -> None:
    loop = Loop(rcl, 'plant', *case)
    last = loop.ticks - 1
    assert loop.run(0, last) == (last, DUE)  # state 0 and the last one are Python's
    for topic in loop.writes:
        assert loop.outputs[topic.name].published == loop.expected(topic, 1, last)
    told = [int.from_bytes(data[4:], 'little') for data in loop.tick.published]
    assert told == list(range(4, last, 4))
    assert {data[:4] for data in loop.tick.published} == {b'\0\1\0\0'}
    assert loop.plant.q.tolist() == scenario_state(loop, last)


def scenario_state(loop: Loop, tick: int) -> list[float]:
    state = next(topic for topic in loop.topics if topic.name == 'plant/state')
    return list(state.codec.decode(loop.message(state, tick))[1][: len(loop.plant.q)])


@each_case
def test_the_trajectory_publishes_the_bytes_of_a_simulation(
    rcl: Rcl, case: tuple[str, ...]
) -> None:
    loop = Loop(rcl, 'trajectory', *case)
    assert [loop.path.run(0, 5), loop.path.run(5, loop.ticks)] == [5, loop.ticks]
    (topic,) = loop.writes
    assert loop.outputs[topic.name].published == loop.expected(topic, 0, loop.ticks)


def test_the_delay_of_the_reference_is_that_of_the_step(rcl: Rcl) -> None:
    loop = Loop(rcl, 'trajectory', 'pd_tip', 'trajectory.delay=0.01')
    part: Any = part_of('trajectory')
    late = part(loop.config).reference
    step = reference_step(late, loop.writes[0], 1_000_000)
    assert step is not None
    assert step.record.delay_ns == 10_000_000  # type: ignore[union-attr]


@pytest.mark.parametrize('role', ['encoder', 'controller', 'plant'])
def test_a_loop_ends_where_a_message_is_missing(rcl: Rcl, role: str) -> None:
    loop = Loop(rcl, role, 'fls_tip')
    kept = [loop.inputs[-1].left.pop() for _ in range(loop.ticks - 20)]
    assert kept
    end = loop.run(0, loop.ticks - 1)
    assert end == (20, SENT if role == 'plant' else False)
    topic = next(t for t in loop.writes if t.name != '/clock')
    first = 1 if role == 'plant' else 0
    assert loop.outputs[topic.name].published == loop.expected(
        topic, first, 21 if role == 'plant' else 20
    )


@pytest.mark.parametrize('role', ['encoder', 'controller', 'plant'])
def test_a_loop_ends_when_it_is_asked_to(rcl: Rcl, role: str) -> None:
    loop = Loop(rcl, role, 'fls_tip')

    def at_tick_7() -> None:
        if len(rcl.waits) == 7:
            assert loop.path.ticks == 6
            loop.path.stop()

    rcl.on_wait = at_tick_7
    assert loop.run(0, loop.ticks - 1) == (7, DUE if role == 'plant' else False)
    assert loop.run(7, loop.ticks - 1, until_s=0.0) == (8, DUE if role == 'plant' else False)


def test_a_message_that_cannot_be_published_is_left_to_python(rcl: Rcl) -> None:
    loop = Loop(rcl, 'tip_sensor', 'fls_tip', 'tip_sensor.latency_model=pade2')
    (output,) = loop.outputs.values()
    output.refusals = 1
    assert loop.run(0, loop.ticks) == (1, True)
    assert output.published == []
    assert loop.step.outputs[0].bytes() == loop.message(loop.writes[0], 0)
    assert loop.run(1, loop.ticks) == (loop.ticks, False)  # nothing is measured twice
    assert output.published == loop.expected(loop.writes[0], 1, loop.ticks)


@pytest.mark.parametrize(('place', 'end'), [(0, 1), (1, 2), (2, 3)])
def test_the_plant_tells_which_message_it_could_not_publish(
    rcl: Rcl, place: int, end: int
) -> None:
    loop = Loop(rcl, 'plant', 'fls_tip')
    there = [loop.tick, loop.outputs['plant/state'], loop.outputs['/clock']]
    there[place].refusals = 1
    assert loop.run(0, loop.ticks) == (4 if place == 0 else 1, end)


def test_the_plant_ends_where_it_becomes_unstable(rcl: Rcl) -> None:
    loop = Loop(rcl, 'plant', 'fls_tip')
    torque, there = loop.reads[0], make_plant(loop.config)
    there.limits = loop.plant.limits = (1e-3, 1e-3)
    loop.open(rcl)
    expected = 0
    while not instability(there):
        there.step(*torque.codec.decode(loop.message(torque, expected))[1])
        expected += 1
    assert loop.run(0, loop.ticks - 1) == (expected - 1, UNSTABLE)
    assert len(loop.outputs['plant/state'].published) == expected - 1
    assert loop.plant.q.tolist() == there.q.tolist()


def test_an_unknown_rclpy_leaves_every_message_to_python(monkeypatch: pytest.MonkeyPatch) -> None:
    find = rcl_ports._functions.__wrapped__
    rcl = Rcl(monkeypatch)
    for found in ('11.0.1', '70.1'):
        monkeypatch.setattr(rcl_ports, 'version', lambda _, found=found: found)
        monkeypatch.setattr(rcl_ports, '_functions', find)
        assert not rcl_ports.known()
        loop = Loop(rcl, 'encoder', 'fls_tip')
        now = time.monotonic()
        assert loop.path.run is None
        assert not loop.path.enter(0, now, now + LIMIT_S)
        loop.path.stop()
        assert loop.path.ticks == 0


@pytest.mark.parametrize('name', ['7.1.6', '9.1.2'])
def test_the_known_versions_of_rclpy(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(rcl_ports, 'version', lambda _: name)
    assert set(rcl_ports._functions.__wrapped__()) < set(LINK.names or ())


def test_code_that_is_not_compiled_calls_no_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rcl_ports._config, 'DISABLE_JIT', 1)
    assert rcl_ports._functions.__wrapped__() == {}
