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

"""The fused steps against the parts in Python: the same bytes, and nothing that is not plain."""

from __future__ import annotations

from collections.abc import Sequence
import math
import random
from typing import Any

from bagtools import small_messages
from flexarm_ros import scenario
from flexarm_ros.core.control.pd import PdLaw
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.part import Answer
from flexarm_ros.core.run.parts import part_of
from flexarm_ros.core.run.state import MessageState
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.fused_step import (
    answer_step,
    Buffer,
    control,
    FusedStep,
    is_plain,
    LawRecord,
    measure,
    plant_step,
    SensorRecord,
)
from flexarm_ros.wire.topics import per_tick_topics, Topic
import numpy as np
import pytest

ANSWERING = ('encoder', 'tip_sensor', 'controller')
CASES = (
    ('fls_tip',),
    ('pd_mid_corrected', 'encoder.resolution=1e-3', 'encoder.latency=2.5e-3'),
    ('pd_tip', 'tip_sensor.latency_model=pade2', 'controller.velocity_source=encoder'),
    ('fls_mid', 'tip_sensor.measurand=elastic', 'controller.torque_limit=200'),
    ('pd_collocated', 'plant.model=full', 'plant.modes=2', 'controller.feedback=encoder'),
)


def config_of(name: str, *settings: str) -> RunConfig:
    return scenario.load(name, ['duration=0.15', *settings])


class Fixture:
    """One role of a scenario with the bytes that it reads and writes at each tick."""

    def __init__(self, role: str, config: RunConfig) -> None:
        self.config, self.period_ns = config, Timeline.of(config.run).period_ns
        self.topics = per_tick_topics(config)
        named = {topic.name: topic for topic in self.topics}
        kind = part_of(role)
        self.reads = [named[name] for name in kind.reads(config)]
        self.writes = [topic for topic in self.topics if topic.node == role]

    def right(self, topic: Topic, tick: int) -> bytes:
        return small_messages(self.config)[tick][self.topics.index(topic)]

    def step(self, part: Answer) -> FusedStep | None:
        return answer_step(part, self.reads, self.writes, self.period_ns)

    def fill(self, buffers: Sequence[Buffer], tick: int) -> None:
        for topic, buffer in zip(self.reads, buffers, strict=True):
            buffer.put[:] = self.right(topic, tick)

    def in_python(self, part: Answer, tick: int) -> bytes:
        """Let the part answer as the node does without a fused step."""
        values: list[Any] = []
        for topic in self.reads:
            values.append(topic.codec.decode(self.right(topic, tick))[1])
            if topic.name == 'plant/state':
                values[-1] = MessageState(values[-1])
        answer = part.answer(tick, *values)
        (topic,) = self.writes
        stamp = (1_000_000_000 + tick * self.period_ns,)
        return topic.codec.encode(*(answer if topic.late else (*stamp, *answer)))


def compute(step: FusedStep, tick: int) -> bool:
    """Let the step answer a tick from its buffers."""
    functions: dict[type, Any] = {SensorRecord: measure, LawRecord: control}
    return bool(functions[type(step.record)](step.record, tick))


def made(role: str, config: RunConfig) -> tuple[Fixture, Any, FusedStep]:
    there = Fixture(role, config)
    kind: Any = part_of(role)
    part = kind(config)
    step = there.step(part)
    assert step is not None
    return there, part, step


@pytest.mark.parametrize('role', ANSWERING)
@pytest.mark.parametrize('case', CASES, ids=lambda case: case[0])
def test_step_gives_the_bytes_of_the_part(role: str, case: tuple[str, ...]) -> None:
    there, part, step = made(role, config_of(*case))
    (topic,) = there.writes
    dice = random.Random(7)
    for tick in range(len(small_messages(there.config))):
        right = there.right(topic, tick)
        if dice.random() < 0.3:  # the part itself, as for a tick that is not plain
            assert there.in_python(part, tick) == right
            continue
        there.fill(step.inputs, tick)
        assert compute(step, tick)
        assert step.outputs[0].bytes() == right
        step.leave()


@pytest.mark.parametrize('role', ['encoder', 'tip_sensor'])
def test_part_continues_with_jitter_from_the_step(role: str) -> None:
    """The samples under way, of the latency of the fused ticks, and the held one are kept."""
    config = config_of('fls_tip', f'{role}.latency=2.5e-3')
    there, part, step = made(role, config)
    kind: Any = part_of(role)
    alone = kind(config)
    late = changed(config, Change(20, role, 'latency', 4.5e-3))
    jitter = changed(late, Change(40, role, 'jitter', 2e-3))
    for tick in range(80):
        if tick in (20, 40):
            for each in (part, alone):
                each.retune(late if tick == 20 else jitter)
            again = there.step(part)
            assert (again is None) == (tick == 40)
            step = again or step
        expected = there.in_python(alone, tick)
        if tick < 40:
            there.fill(step.inputs, tick)
            assert compute(step, tick)
            step.leave()
            assert step.outputs[0].bytes() == expected
        else:
            assert there.in_python(part, tick) == expected


def spoilt(topic: Topic, data: bytes) -> list[bytes]:
    """Return what is not the message ``data`` of its tick, of the same length."""
    stamp, values = topic.codec.decode(data)
    shifts = [10**7, 10**12] if topic.late else [1, -1, 1_000_000, -1_000_000, -stamp]
    found = [topic.codec.encode(stamp + shift, *values) for shift in shifts]
    for place in range(len(values)):
        for value in (math.nan, math.inf, -math.inf):
            found.append(topic.codec.encode(stamp, *values[:place], value, *values[place + 1 :]))
    for place in np.flatnonzero(topic.codec.fixed):
        found.append(data[:place] + bytes([data[place] ^ 0x10]) + data[place + 1 :])
    return found


@pytest.mark.parametrize('role', [*ANSWERING, 'plant'])
def test_nothing_but_a_plain_message_is_accepted(role: str) -> None:
    """For every constant byte, value and stamp; a step that refuses has changed nothing."""
    config = config_of('fls_mid_corrected', 'tip_sensor.latency_model=pade2')
    there = Fixture(role, config)
    step: Any
    if role == 'plant':
        step = plant_step(make_plant(config), config, there.topics, 4)
    else:
        _, _, step = made(role, config)

    def accepted(tick: int) -> bool:
        if role == 'plant':
            return is_plain(step.record.torque, 1_000_000_000 + tick * there.period_ns)
        return compute(step, tick)

    for tick in range(3):
        for topic, buffer in zip(there.reads, step.inputs, strict=True):
            there.fill(step.inputs, tick)
            for data in spoilt(topic, there.right(topic, tick)):
                buffer.put[:] = data
                assert not accepted(tick), (topic.name, data)
        there.fill(step.inputs, tick)
        assert accepted(tick)
        if role != 'plant':
            assert step.outputs[0].bytes() == there.right(there.writes[0], tick)


def test_padding_of_any_content_is_accepted() -> None:
    there, _, step = made('controller', config_of('fls_tip'))
    found = 0
    for topic, buffer in zip(there.reads, step.inputs, strict=True):
        there.fill(step.inputs, 0)
        data = bytearray(there.right(topic, 0))
        slots = {at + i for at, count in topic.codec.runs for i in range(8 * count)}
        for place in np.flatnonzero(topic.codec.fixed == 0):
            if place >= 12 and place not in slots:
                data[place] = 0xA5
                found += 1
        buffer.put[:] = data
        assert compute(step, 0)
    assert found


def test_a_torque_that_is_not_finite_is_left_to_python() -> None:
    there, _, step = made('controller', config_of('pd_tip'))
    there.fill(step.inputs, 0)
    topic = next(topic for topic in there.reads if topic.name == 'reference')
    stamp, values = topic.codec.decode(there.right(topic, 0))
    step.inputs[there.reads.index(topic)].put[:] = topic.codec.encode(stamp, 1e307, *values[1:])
    assert not compute(step, 0)


def test_a_law_of_another_class_has_no_step() -> None:
    there, part, _ = made('controller', config_of('fls_tip'))

    class Own(PdLaw):
        pass

    part.law = Own(there.config)
    assert there.step(part) is None


@pytest.mark.parametrize(
    ('role', 'setting'),
    [
        ('encoder', 'encoder.noise_std=1e-4'),
        ('encoder', 'encoder.offset=[0.1, 0.0]'),
        ('encoder', 'encoder.rate=500'),
        ('encoder', 'encoder.jitter=1e-3'),
        ('encoder', 'encoder.dropout=0.1'),
        ('tip_sensor', 'tip_sensor.noise_std=1e-4'),
        ('tip_sensor', 'tip_sensor.rate=500'),
        ('tip_sensor', 'tip_sensor.jitter=1e-3'),
        ('tip_sensor', 'tip_sensor.dropout=0.1'),
        ('tip_sensor', 'tip_sensor.more_locations=[6.0]'),
        ('controller', 'controller.rate=500'),
        ('controller', 'controller.compute_delay=1e-3'),
        ('plant', 'sync=free'),
        ('plant', 'imu.location=9.0'),
        ('plant', 'plant.coulomb_friction=[1.0, 1.0]'),
    ],
)
def test_what_is_not_plain_has_no_step(role: str, setting: str) -> None:
    config = config_of('fls_tip', setting)
    there = Fixture(role, config)
    if role == 'plant':
        assert plant_step(make_plant(config), config, there.topics, 4) is None
    else:
        kind: Any = part_of(role)
        assert there.step(kind(config)) is None
