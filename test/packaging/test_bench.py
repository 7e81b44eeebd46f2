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

"""The benchmark runs, and its page has a place for each part; no test depends on a speed."""

from __future__ import annotations

from importlib import import_module

from bench.__main__ import filled, main, PAGE, PARTS
from bench.table import Part, Ratio, summary
import pytest


def test_the_page_has_a_place_for_every_part() -> None:
    blocks = {name: f'new text of {name}' for name in (*PARTS, 'machine', 'summary')}
    page = filled(PAGE.read_text(encoding='utf-8'), blocks)
    assert all(f'<!-- bench:{name} -->\n\n{text}\n' in page for name, text in blocks.items())
    assert filled(page, blocks) == page
    with pytest.raises(ValueError, match='bench:nothing'):
        filled(page, {'nothing': ''})


def test_every_part_can_be_measured() -> None:
    assert all(callable(import_module(f'bench.{name}').measure) for name in PARTS)


def test_an_unknown_part_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(['speed']) == 2
    assert "'speed'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ('value', 'goal', 'least', 'verdict'),
    [(2.0, 1.5, True, 'yes'), (1.4, 1.5, True, 'no'), (1.2, 1.3, False, 'yes'),
     (1.4, 1.3, False, 'no'), (1.0, None, True, '')],
)  # fmt: skip
def test_a_goal_that_is_missed_is_reported_so(
    value: float, goal: float | None, least: bool, verdict: str
) -> None:
    ratio = Ratio('a / b', '1 s', '2 s', value, goal, least)
    assert ratio.verdict == verdict
    assert f'| {verdict} |' in summary([Part('x', [ratio])])


@pytest.mark.nodes
def test_floor_and_nodes_tell_what_they_cost() -> None:
    from bench.distributed import _NAMES
    from bench.launch import floor, nodes, ROLES

    bare, traced = floor(40), nodes(40, traced=True)
    assert set(bare.roles) == set(traced.roles) == set(ROLES)
    assert set(traced.parts) == set(_NAMES)
    assert sum(traced.parts.values()) == pytest.approx(traced.cpu_us)
    assert all(cost.wall_us > 0.0 for cost in (bare, traced))


def test_every_optional_part_and_key_of_a_channel_is_timed() -> None:
    """Each by itself, in scenarios that are valid."""
    from bench.parts import BASE, FEATURES
    from flexarm_ros import scenario
    from flexarm_ros.core.parameters.channel import ChannelParameters
    from flexarm_ros.core.parameters.spec import specs
    from flexarm_ros.core.run.parts import PARTS

    for assignments in FEATURES.values():
        scenario.load(BASE, ['duration=0.01', *assignments])
    told = {word.partition('=')[0] for words in FEATURES.values() for word in words}
    sections = {key.partition('.')[0] for key in told}
    assert sections >= {part.NAME for part in PARTS if part.Parameters is not None}
    keys = {key.partition('.')[2] for key in told}
    assert keys >= {*specs(ChannelParameters)} - {'latency_file'}
