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

"""``/clock`` at a rate of its own: fewer messages, everything else as it is."""

from __future__ import annotations

from pathlib import Path

from bagtools import small_config
from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.mcap.recover import recover
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.tables.trajectory import trajectory
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.state import Block
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.wire.topics import CLOCK, per_tick_topics
from nodetools import flexarm_here
import pytest
from rosbag2tools import received, write_mcap

CONFIG = scenario.with_values(small_config(duration=0.3, chunk=0.1), ['clock_rate=40'])
EVERY, TICKS = 25, 300


def serialized(config: RunConfig, block: Block) -> list[list[bytes]]:
    """Return the messages of each topic in a block, as the recorder has them."""
    columns = []
    for i, topic in enumerate(per_tick_topics(config)):
        rows = zip(block.stamps[i].tolist(), block.values[i].tolist(), strict=True)
        column = [topic.codec.encode(stamp, *values) for stamp, values in rows]
        columns.append([data for k, data in enumerate(column, block.first) if topic.due(k)])
    return columns


def written(directory: Path, how: str) -> Path:
    """Write the run by one of the three ways of the writer."""
    (block,) = loop_blocks(ClosedLoop(CONFIG))
    assert len(block) == TICKS
    columns = serialized(CONFIG, block)
    topics = per_tick_topics(CONFIG)
    with BagWriter(directory / 'bag', CONFIG) as writer:
        if how == 'block':
            writer.write_block(block)
        elif how == 'ticks':
            at, parts = 0, (1, 24, 26, 50, 99, 100)  # at, behind and before a clock
            for count in parts:
                pairs = [(t.count(at), t.count(at + count)) for t in topics]
                part = [c[a:b] for c, (a, b) in zip(columns, pairs, strict=True)]
                writer.write_ticks(at, part)
                at += count
            assert at == TICKS
        else:
            for i, topic in enumerate(topics):
                for number, data in enumerate(columns[i]):
                    writer.write(i, number * topic.every, data)
        assert writer.complete_ticks == TICKS
    return directory / 'bag'


def test_every_way_of_writing_gives_the_same_bytes(tmp_path: Path) -> None:
    bags = [
        (written(tmp_path / how, how) / 'bag_0.mcap').read_bytes()
        for how in ('block', 'ticks', 'single')
    ]
    assert bags[0] == bags[1] == bags[2]
    reader = BagReader(tmp_path / 'block')
    clocks = [(tick, topic) for tick, topic, _ in reader.messages() if topic == CLOCK]
    assert clocks == [(k, CLOCK) for k in range(0, TICKS, EVERY)]
    assert sum(len(block) for block in reader.blocks()) == TICKS
    assert len(list(trajectory(reader))) == TICKS


def test_it_is_verified_and_recovered(tmp_path: Path) -> None:
    bag = written(tmp_path, 'block')
    verdict = verify(bag)
    assert verdict.same, (verdict.faults, verdict.first)
    assert (verdict.ticks, verdict.notes) == (TICKS, [])
    assert verdict.compared['plant'] == TICKS + TICKS // EVERY
    rescue = recover(bag, tmp_path / 'new')
    assert rescue.whole
    assert (rescue.complete, rescue.kept) == (TICKS, 5 * TICKS + TICKS // EVERY)
    assert (tmp_path / 'new' / 'bag_0.mcap').read_bytes() == (bag / 'bag_0.mcap').read_bytes()


def test_a_clock_that_is_lost_or_too_many_is_told(tmp_path: Path) -> None:
    right = list(received(CONFIG, lambda k, t: t > 0 or k % EVERY == 0))
    lost = list(received(CONFIG, lambda k, t: t > 0 or (k % EVERY == 0 and k != 50)))
    many = list(received(CONFIG, lambda k, t: t > 0 or k % EVERY == 0 or k == 7))
    found = {}
    for name, messages in (('right', right), ('lost', lost), ('many', many)):
        found[name] = write_mcap(tmp_path / f'{name}.mcap', messages)
    assert verify(found['right'], given=CONFIG).same
    assert verify(found['lost'], given=CONFIG).faults == ['tick 50: no message on /clock']
    assert str(verify(found['many'], given=CONFIG).earliest) == (
        'tick 7, /clock: a message recorded, none computed'
    )
    for given in (None, CONFIG):  # without a scenario the stamps tell how far apart they are
        assert BagReader(found['right'], given).gaps == []
    assert BagReader(found['lost'], CONFIG).gaps == [
        '/clock: 1 of 12 messages are missing, the first at tick 50'
    ]


@pytest.mark.parametrize('rate', ['300', '1e4', '0.3', '1001'])
def test_a_rate_that_is_no_whole_number_of_ticks_is_refused(rate: str) -> None:
    with pytest.raises(ScenarioError, match=r'clock_rate: .* Hz, allowed: 0 or the control rate'):
        scenario.load('pd_tip', [f'clock_rate={rate}'])


def test_left_out_it_changes_no_byte() -> None:
    plain = scenario.load('pd_tip')
    assert 'clock_rate' not in scenario.dump(plain)
    assert {topic.every for topic in per_tick_topics(plain)} == {1}
    assert per_tick_topics(scenario.load('pd_tip', ['clock_rate=0']))[CLOCK].every == 1


@pytest.mark.nodes
@pytest.mark.parametrize('words', [[], ['--compose']], ids=['processes', 'compose'])
def test_nodes_record_the_same_bytes(words: list[str], tmp_path: Path, ros_domain: int) -> None:
    sets = ['--set', 'duration=0.26', '--set', 'clock_rate=40', '--no-pictures']
    out, sim = tmp_path / 'run', tmp_path / 'sim'
    done = flexarm_here('run', 'fls_mid', *sets, *words, '--domain', ros_domain, '--out', out)
    assert done.returncode == 0, done.stderr
    assert flexarm_here('simulate', 'fls_mid', *sets, '--out', sim).returncode == 0
    ours, theirs = ((d / 'bag' / 'bag_0.mcap').read_bytes() for d in (out, sim))
    assert ours == theirs
    rows = ((d / 'trajectory.csv').read_bytes() for d in (out, sim))
    assert len(set(rows)) == 1
