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

"""Further tip sensors in one run: measured, recorded and verified as the first one is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.wire.topics import COMMAND, TIP
from nodetools import flexarm_here, ROLES, start_node, wait_for, write_scenario
import numpy as np
import pytest

SETS = ['duration=0.2', 'tip_sensor.more_locations=[4.5, 6.75, 9]', 'tip_sensor.latency=0.0']


def test_each_measures_its_own_place(tmp_path: Path) -> None:
    config = scenario.load('fls_tip', SETS)
    loop = ClosedLoop(config)
    for _ in range(50):
        record = loop.tick()
        assert record is not None
    for place, measured in zip((4.5, 6.75, 9.0), record.messages[COMMAND + 1 :], strict=True):
        assert measured[1:] == make_point(config.plant, place, False)(record.q, record.qd)
    assert record.messages[COMMAND + 3] == record.tip  # the same place, no noise
    noisy = replace(config, tip_sensor=replace(config.tip_sensor, noise_std=0.01))
    first = ClosedLoop(noisy).tick()
    assert first is not None
    assert first.messages[COMMAND + 3] != first.tip  # noise of its own
    without = replace(noisy, tip_sensor=replace(noisy.tip_sensor, more_locations=None))
    alone = ClosedLoop(without).tick()
    assert alone is not None
    assert alone.tip == first.tip
    assert alone.torque == first.torque


def test_they_are_recorded_and_verified(tmp_path: Path) -> None:
    config = scenario.load('fls_tip', SETS)
    simulate(config, tmp_path / 'run')
    reader = BagReader(tmp_path / 'run')
    names = [topic.path for topic in reader.topics]
    assert names[COMMAND:][1:] == [f'/tip_sensor/odometry_{i}' for i in (1, 2, 3)]
    blocks = list(reader.blocks())
    tip, third = (np.concatenate([b.values[i] for b in blocks]) for i in (TIP, COMMAND + 3))
    assert len(tip) == 200
    assert np.array_equal(tip, third)
    verdict = verify(tmp_path / 'run')
    assert verdict.same
    assert verdict.compared['tip_sensor'] == 4 * 200


@pytest.mark.parametrize('place', ['4.4', '9.1'])
def test_a_place_beyond_link_2_is_refused(tmp_path: Path, place: str) -> None:
    words = ('--set', f'tip_sensor.more_locations=[9.0, {place}]', '--out', tmp_path / 'run')
    done = flexarm_here('simulate', 'fls_tip', *words)
    assert done.returncode == 2
    assert 'tip_sensor.more_locations' in done.stderr
    assert 'allowed: 4.5 (elbow) to 9.0 m (tip)' in done.stderr
    assert not (tmp_path / 'run').exists()


@pytest.mark.nodes
def test_every_way_of_flying_gives_the_same_bytes(tmp_path: Path) -> None:
    words = [word for text in (*SETS, 'tip_sensor.noise_std=0.01') for word in ('--set', text)]
    for way in (['simulate'], ['run'], ['run', '--compose']):
        done = flexarm_here(*way, 'fls_tip', *words, '--no-pictures', '--out', tmp_path / way[-1])
        assert done.returncode == 0, done.stderr
    bags = [file.read_bytes() for file in tmp_path.glob('*/bag/bag_0.mcap')]
    assert len(bags) == 3
    assert len(set(bags)) == 1


@pytest.mark.nodes
def test_the_sensor_alone_may_ask_for_more(tmp_path: Path, ros_domain: int) -> None:
    """The recorder learns of further sensors from the tip sensor's own parameters."""
    file = write_scenario(tmp_path / 's.yaml', 'fls_tip', 'duration=0.1')
    more = {'tip_sensor': ['-p', 'more_locations:=[6.0]'],
            'recorder': ['-p', f"output:={tmp_path / 'run'}"]}  # fmt: skip
    nodes = [start_node(role, file, *more.get(role, [])) for role in ROLES]
    try:
        wait_for(lambda: all(n.poll() is not None for n in nodes), 120, 'the run has ended')
    finally:
        for node in nodes:
            if node.poll() is None:
                node.kill()
        texts = [node.communicate()[0] for node in nodes]
    assert [node.returncode for node in nodes] == [0] * 6, texts
    assert verify(tmp_path / 'run').compared['tip_sensor'] == 2 * 100
