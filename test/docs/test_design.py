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

import re
from typing import Any, ClassVar

from flexarm_ros.bag.checks.recompute import Nodes
from flexarm_ros.bag.provenance import LAYERS as DIGESTED
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run import parts
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.state import State
from flexarm_ros.core.signals import Joints, Signal
from flexarm_ros.wire.topics import per_tick_topics
from layertools import API, LAYERS
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
    (said,) = re.findall(r'digest of the source in a bag covers (.*):', PAGE)
    assert names(said) == list(DIGESTED)


def test_the_table_of_parts_is_the_list_of_parts() -> None:
    found = {names(row[0])[0]: (row[1], names(row[2])) for row in table('| part |')}
    assert list(found) == [part.NAME for part in parts.PARTS]
    for part in parts.PARTS:
        reads, publishes = found[part.NAME]
        assert publishes == [signal.name for signal in part.signals(RunConfig())]
        expected = 'every topic' if part.FOR_THE_RECORD else list(part.READS)
        assert (reads if part.FOR_THE_RECORD else names(reads)) == expected


@pytest.mark.parametrize('name', sorted(set(re.findall(r'`([\w/]+(?:\.py|/))`', PAGE))))
def test_a_file_that_is_named_is_there(name: str) -> None:
    assert (ROOT / name).exists() or (ROOT / 'flexarm_ros' / name).exists()


class Gauge(parts.Answer):
    """A sensor as the page says to add one: the deflections of the tick before."""

    NAME: ClassVar[str] = 'gauge'
    READS: ClassVar[tuple[str, ...]] = (parts.STATE,)

    def __init__(self, config: RunConfig) -> None:
        self._last = (0.0, 0.0)

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        return (Signal('gauge/deflection', Joints(('link1', 'link2'), ('position',))),)

    def answer(self, k: int, state: State) -> Any:
        answer, self._last = self._last, state.ends[:2]
        return answer


def test_a_sensor_is_one_class_in_the_list(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is in the loop, among the topics, and computed anew from what is recorded."""
    monkeypatch.setattr(parts, 'PARTS', (*parts.PARTS[:-1], Gauge, parts.PARTS[-1]))
    config = RunConfig()
    topics = per_tick_topics(config)
    place = [topic.name for topic in topics].index('gauge/deflection')
    assert topics[place].node == 'gauge'
    assert parts.readers('gauge/deflection') == ('recorder',)
    loop, nodes, before = ClosedLoop(config), Nodes(config, topics, frozenset()), None
    for _ in range(5):
        record = loop.tick()
        assert record is not None
        now = [
            m[1:] if late else m
            for m, late in zip(record.messages, loop.answers.late, strict=True)
        ]
        now[0], now[1] = (), record.state.values()
        expected = nodes.expected(record.k, now, before)
        assert expected[place][1] == record.messages[place]
        before = now
    assert record.messages[place] != (0.0, 0.0)
