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

"""Live parameters in a bag: read back, verified, rescued, and open to others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from bagtools import write_changed
from flexarm_ros import scenario
from flexarm_ros.bag.checks.compare import compare
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.mcap.recover import recover
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.tables.export import export
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.wire.parameter_event import decode, encode
from flexarm_ros.wire.topics import per_tick_topics, TIP
import pytest

CHANGES = (
    Change(40, 'controller', 'kp', 80.0),
    Change(60, 'tip_sensor', 'noise_std', 0.01),
    Change(60, 'tip_sensor', 'latency', 0.0405),
    Change(61, 'encoder', 'resolution', 0.001),
    Change(90, 'trajectory', 'delay', 0.02),
    Change(90, 'controller', 'kn', 4.0),
)


@pytest.fixture(scope='module')
def config() -> RunConfig:
    return replace(scenario.load('fls_tip', ['duration=0.15']), changes=CHANGES)


@pytest.mark.parametrize('late', [False, True], ids=['in time', 'late'])
def test_changes_are_read_back_and_the_run_verifies(
    tmp_path: Path, config: RunConfig, late: bool
) -> None:
    path = write_changed(tmp_path, config, late)
    assert BagReader(path).config == config
    verdict = verify(path)
    assert verdict.same, (verdict.earliest, verdict.faults)
    assert verdict.compared['closed loop'] == 6 * 150


def test_a_run_without_a_change_differs_from_its_tick_on(config: RunConfig) -> None:
    for change in config.changes:
        others = tuple(c for c in config.changes if c != change)
        forged = replace(config, changes=others)
        loop, told = ClosedLoop(config), ClosedLoop(forged)
        while (a := loop.tick()) is not None and (b := told.tick()) is not None:
            same = (a.encoder, a.tip, a.reference, a.torque) == (
                b.encoder, b.tip, b.reference, b.torque)  # fmt: skip
            assert same or a.k >= change.tick
        assert not same, change


def test_covariance_follows_the_noise(tmp_path: Path, config: RunConfig) -> None:
    reader = BagReader(write_changed(tmp_path, config))
    noisy = per_tick_topics(changed(config, CHANGES[1]))[TIP].codec
    ideal = per_tick_topics(config)[TIP].codec
    for tick, topic, data in reader.messages():
        if topic == TIP:
            (noisy if tick >= 60 else ideal).decode(data)


def test_changes_survive_a_rescue(tmp_path: Path, config: RunConfig) -> None:
    path = write_changed(tmp_path / 'run', config)
    file = path / 'bag' / 'bag_0.mcap'
    file.write_bytes(file.read_bytes()[:-200])  # the index is lost
    rescue = recover(path, tmp_path / 'new')
    assert rescue.whole
    assert not rescue.dropped
    assert BagReader(tmp_path / 'new').config.changes == CHANGES
    assert verify(tmp_path / 'new').same


def test_changes_are_exported_and_compared(tmp_path: Path, config: RunConfig) -> None:
    path = write_changed(tmp_path / 'a', config)
    export(path, tmp_path / 'tables', 'csv')
    lines = (tmp_path / 'tables' / 'changes.csv').read_text().splitlines()
    assert lines[:2] == ['tick,node,key,value', '40,controller,kp,80.0']
    assert len(lines) == 1 + len(CHANGES)
    assert len((tmp_path / 'tables' / 'trajectory.csv').read_text().splitlines()) == 151
    plain = write_changed(tmp_path / 'b', replace(config, changes=()))
    result = compare(path, plain)
    assert result.parameters == ['parameters changed during the run: 6 and 0 times, differently']
    assert not result.within
    export(plain, tmp_path / 'plain', 'csv')
    assert not (tmp_path / 'plain' / 'changes.csv').exists()


def test_other_readers_see_them(tmp_path: Path, config: RunConfig) -> None:
    from rosbags.highlevel import AnyReader

    with AnyReader([write_changed(tmp_path, config) / 'bag']) as bag:
        (connection,) = [c for c in bag.connections if c.topic == '/lockstep/changes']
        assert connection.msgcount == len(CHANGES)
        events = [
            bag.deserialize(data, connection.msgtype) for _, _, data in bag.messages([connection])
        ]
    assert [(e.node, e.changed_parameters[0].name) for e in events] == [c[1:3] for c in CHANGES]


@pytest.mark.parametrize(
    'bad',
    [
        Change(5, 'controller', 'law', 1.0),
        Change(5, 'controller', 'kn', 0.0),
        Change(5, 'nobody', 'kp', 1.0),
        Change(5, '/**', 'duration', 1.0),
        Change(5, 'encoder', 'latency', float('nan')),
    ],
)
def test_a_change_that_is_not_allowed_is_refused(bad: Change) -> None:
    with pytest.raises(ValueError, match=r'no parameter|out of range|not a finite number'):
        decode(encode(bad, 1_000_000), 1_000_000)
