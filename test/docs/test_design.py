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

"""What docs/design.md says of layers, parts and modules is so."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path
import re
from typing import Any, ClassVar

from flexarm_ros.bag.checks.recompute import Nodes
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.provenance import LAYERS as DIGESTED
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.core.control import Law, LAWS
from flexarm_ros.core.parameters.rig import ActuatorParameters
from flexarm_ros.core.parameters.sections import (
    ControllerParameters,
    EncoderParameters,
    keys,
    RunConfig,
    SECTIONS,
    specs,
    with_section,
)
from flexarm_ros.core.parameters.spec import parameter
from flexarm_ros.core.run import parts
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.part import Answer, STATE
from flexarm_ros.core.run.required_parts import ControllerPart, PlantPart
from flexarm_ros.core.run.rig_parts import ActuatorPart
from flexarm_ros.core.run.state import State
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Joints, Signal
from flexarm_ros.scenario import dump, from_text, load
from flexarm_ros.scenario import table as parameter_table
from flexarm_ros.wire.topics import per_tick_topics
from layertools import API, LAYERS, modules
import pytest
from repository import ROOT

PAGE = (ROOT / 'docs' / 'design.md').read_text('utf-8')


def table(head: str) -> list[list[str]]:
    """Return the cells of the table that begins with ``head``."""
    lines = PAGE[PAGE.index(head) :].split('\n\n')[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip('|').split('|')] for line in lines]


def names(cell: str) -> list[str]:
    return re.findall(r'`([^`]+)`', cell)


def test_layers_are_those_that_are_enforced() -> None:
    assert ' <- '.join(LAYERS) in PAGE
    assert [names(row[0])[0] for row in table('| layer |')] == [*LAYERS, API]
    (said,) = re.findall(r'numbers of a run depend on (.*) only: the digest', PAGE)
    assert names(said) == list(DIGESTED)


def test_the_table_of_parts_is_the_list_of_parts() -> None:
    found = {names(row[0])[0]: (row[1], names(row[2])) for row in table('| part |')}
    assert list(found) == [part.NAME for part in parts.PARTS]
    for part in parts.PARTS:
        reads, publishes = found[part.NAME]
        assert publishes == [signal.name for signal in part.signals(RunConfig())]
        expected = 'every topic' if part.FOR_THE_RECORD else list(part.reads(RunConfig()))
        assert (reads if part.FOR_THE_RECORD else names(reads)) == expected


def test_reads_that_depend_on_the_scenario() -> None:
    config = load('lab_arm', ['disturbance.force_x=[0.0, 0.0]', 'disturbance.force_y=[0.0, 0.0]',
                              'disturbance.force_times=[0.0, 1.0]'])  # fmt: skip
    torque, wrench = PlantPart.reads(config)
    assert (torque, wrench) == ('actuator/torque', 'disturbance/wrench')
    assert 'actuator' in parts.replaceable(config)
    gauges = load('fls_tip', ['strain_gauge.gain=[1.0, 1.0]', 'strain_gauge.output=deflection',
                              'controller.deflection_source=strain_gauge'])  # fmt: skip
    assert 'strain_gauge/strain' in ControllerPart.reads(gauges)
    assert len(re.findall('`(actuator/torque|disturbance/wrench|strain_gauge/strain)`', PAGE)) >= 6


def defined() -> set[str]:
    """Return ``Class`` and ``Class.method`` of every class of the package."""
    classes = [
        node
        for path in modules()
        for node in ast.walk(ast.parse(path.read_text('utf-8')))
        if isinstance(node, ast.ClassDef)
    ]
    return {node.name for node in classes} | {
        f'{node.name}.{part.name}'
        for node in classes
        for part in node.body
        if isinstance(part, ast.FunctionDef)
    }


def test_the_classes_that_are_named_exist() -> None:
    told = set(re.findall(r'`([A-Z][a-z]\w+(?:\.\w+)?)`', PAGE)) - {'Parameters'}
    assert len(told) > 12
    assert told - defined() == set()


@pytest.mark.parametrize('name', sorted(set(re.findall(r'`([\w/]+(?:\.py|/))`', PAGE))))
def test_a_file_that_is_named_is_there(name: str) -> None:
    assert (ROOT / name).exists() or (ROOT / 'flexarm_ros' / name).exists()


@dataclass(frozen=True)
class Keys:
    gain: float = parameter(2.0, 'float', '', 'a gain', live=True)
    latency: float = parameter(0.001, 'float', 's', 'age at delivery', whole_ns=True)


class Gauge(Sensor):
    """A sensor as the page says to add one: the end deflections, late."""

    NAME: ClassVar[str] = 'gauge'
    Parameters = Keys

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        return (Signal('gauge/deflection', Joints(('link1', 'link2'), ('position',))),)

    def sample(self, k: int, state: State) -> Any:
        return state.ends[:2]

    def read(self, values: Any) -> Any:
        return [self.parameters.gain * value for value in values]


@pytest.mark.usefixtures('registry')
def test_a_sensor_is_one_class_with_its_section(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is in the loop, among the topics, and computed anew from what is recorded."""
    monkeypatch.setattr(parts, 'PARTS', (*parts.PARTS[:-1], Gauge, parts.PARTS[-1]))
    monkeypatch.setitem(SECTIONS, 'gauge', Gauge.Parameters)
    assert 'gauge' not in parts.roles(RunConfig())
    config = with_section(RunConfig(), 'gauge', Gauge.Parameters(gain=3.0))
    topics = per_tick_topics(config)
    place = [topic.name for topic in topics].index('gauge/deflection')
    assert topics[place].node == 'gauge'
    assert parts.readers('gauge/deflection', config) == ('recorder',)
    loop, nodes, before = ClosedLoop(config), Nodes(config, topics, frozenset()), None
    ends = []
    for _ in range(5):
        record = loop.tick()
        assert record is not None
        ends.append(record.deflections[:2])
        now = [
            m[1:] if late else m
            for m, late in zip(record.messages, loop.answers.late, strict=True)
        ]
        now[0], now[1] = (), record.state.values()
        expected = nodes.expected(record.k, now, before)
        stamp, values = expected[place]
        assert (stamp, *values) == record.messages[place]
        before = now
    assert record.messages[place][1:] == (3.0 * ends[3][0], 3.0 * ends[3][1]) != (0.0, 0.0)


class Braking(Law):
    """A law as the page says to add one."""

    def torque(self, k: int, sample: Any) -> tuple[float, float]:
        return -50.0 * sample.encoder[2], -50.0 * sample.encoder[3]


def test_a_law_is_one_class_with_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    spec = specs(ControllerParameters)['law'][1]
    before = spec.choices
    monkeypatch.setitem(LAWS, 'braking', Braking)
    object.__setattr__(spec, 'choices', (*before, 'braking'))
    try:
        config = load('pd_tip', ['controller.law=braking', 'duration=0.05'])
        simulate(config, tmp_path / 'run')
        verdict = verify(tmp_path / 'run')
        assert verdict.same
        assert verdict.compared['closed loop'] == 6 * 50
    finally:
        object.__setattr__(spec, 'choices', before)


class Both(Answer):
    """A part with two topics."""

    NAME: ClassVar[str] = 'both'
    Parameters = Keys
    READS = (STATE,)

    def __init__(self, config: RunConfig) -> None:
        pass

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        return (Signal('both/first', Joints(fields=('position',))),)

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        return (Signal('both/second', Joints(('x',), ('velocity',))),)

    def answer(self, k: int, state: State) -> Any:
        return tuple(state.q[:2]), (float(k),)


@pytest.mark.usefixtures('registry')
def test_a_topic_is_one_more_signal_and_one_more_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parts, 'PARTS', (*parts.PARTS[:-1], Both, parts.PARTS[-1]))
    monkeypatch.setitem(SECTIONS, 'both', Both.Parameters)
    config = load('pd_tip', ['both.gain=1', 'duration=0.02'])
    assert [topic.name for topic in per_tick_topics(config)][-2:] == ['both/first', 'both/second']
    simulate(config, tmp_path / 'run')
    verdict = verify(tmp_path / 'run')
    assert verdict.same
    assert verdict.compared['both'] == 2 * 20


@dataclass(frozen=True)
class Damped(ActuatorParameters):
    """The drives with one more key."""

    share: float = parameter(1.0, 'float', '', 'share of the torque that is applied', low=0.0)


class DampedDrives(ActuatorPart):
    """Its effect."""

    Parameters = Damped

    def answer(self, k: int, command: tuple[float, float]) -> tuple[float, ...]:
        share = self._drive.share  # type: ignore[attr-defined]
        return super().answer(k, (share * command[0], share * command[1]))


def test_a_drive_is_a_key_and_its_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """The plant takes the torque with it."""
    drives = (DampedDrives if part is ActuatorPart else part for part in parts.PARTS)
    monkeypatch.setattr(parts, 'PARTS', tuple(drives))
    monkeypatch.setitem(SECTIONS, 'actuator', Damped)

    def rates(share: float) -> Any:
        loop = ClosedLoop(load('pd_tip', [f'actuator.share={share}', 'trajectory.side_time=1']))
        for _ in range(20):
            record = loop.tick()
        assert record is not None
        return record.qd[0]

    assert abs(rates(0.5)) < 0.9 * abs(rates(1.0))


@dataclass(frozen=True)
class Marked(EncoderParameters):
    """The encoders with one more key."""

    mark: int = parameter(3, 'int', '', 'a number of no effect', low=0)


def test_a_parameter_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(SECTIONS, 'encoder', Marked)
    config = load('pd_tip', ['encoder.mark=5'])
    assert from_text(dump(config)).encoder.mark == 5  # type: ignore[attr-defined]
    row = parameter_table.row('mark', *keys('encoder')['mark'])
    assert row == '| `mark` | 3 | a number of no effect. *allowed: integer, at least 0* |'
    with pytest.raises(ValueError, match=r'encoder.mark: -1 is out of range'):
        load('pd_tip', ['encoder.mark=-1'])
