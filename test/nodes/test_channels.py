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

"""Jitter, loss and rates in a run: the same bytes in each way of running, verified, replayed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
import re
import sys

from bagtools import write_changed
from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.timeline import T0_NS
from flexarm_ros.wire.topics import COMMAND, JOINT_STATES, TIP
from nodetools import check_every_way, flexarm_here
import numpy as np
import pytest

GENTLE = ('controller.kp=20', 'controller.kd=2', 'controller.ks=2')
SENSORS = (
    'duration=0.4', 'seed=5', *GENTLE,
    'encoder.latency=0.0021', 'encoder.jitter=0.004', 'encoder.jitter_distribution=normal',
    'encoder.arrival=in_order', 'encoder.noise_std=1e-4', 'encoder.dropout=0.05',
    'tip_sensor.latency=0.01', 'tip_sensor.jitter=0.003', 'tip_sensor.dropout=0.2',
    'tip_sensor.jitter_distribution=exponential', 'tip_sensor.dropout_burst=4',
    'tip_sensor.rate=500', 'tip_sensor.noise_std=1e-3',
)  # fmt: skip

COMMANDS = (
    'duration=0.4', 'seed=5', *GENTLE, 'controller.rate=200', 'controller.compute_delay=0.0035',
    'actuator.latency=0.0012', 'actuator.jitter=0.002', 'actuator.dropout=0.1',
    'actuator.rate=500', 'actuator.bandwidth=[50, 50]', 'plant.model=full',
)  # fmt: skip


def stamps(run: Path, topic: int) -> np.ndarray:
    return np.concatenate([block.stamps[topic] for block in BagReader(run).blocks()])


def values(run: Path, topic: int) -> np.ndarray:
    return np.concatenate([block.values[topic] for block in BagReader(run).blocks()])


def test_samples_are_held_with_their_stamp_and_verified(tmp_path: Path) -> None:
    config = scenario.load('fls_tip', SENSORS)
    simulate(config, tmp_path / 'run')
    for topic, least in ((JOINT_STATES, 0.0), (TIP, 0.010)):
        at, found = stamps(tmp_path / 'run', topic), values(tmp_path / 'run', topic)
        now = T0_NS + 1_000_000 * np.arange(400)
        assert (np.diff(at) >= 0).all()  # never older than what was received before
        assert (np.diff(at) == 0).any()
        age = (now - at)[40:] * 1e-9
        assert age.min() >= least
        assert age.max() > 0.011
        held = np.diff(at) == 0
        assert (np.diff(found, axis=0)[held] == 0.0).all()  # with its noise
        assert (np.diff(found[:, :2], axis=0)[~held] != 0.0).all()
    verdict = verify(tmp_path / 'run')
    assert verdict.same, verdict.first
    assert verdict.compared['tip_sensor'] == verdict.compared['encoder'] == 400


@pytest.mark.nodes
@pytest.mark.parametrize('settings', [SENSORS, COMMANDS], ids=['sensors', 'commands'])
def test_every_way_of_running_gives_the_same_bytes(
    settings: tuple[str, ...], tmp_path: Path, ros_domain: int
) -> None:
    check_every_way('fls_tip', settings, tmp_path)


def test_the_command_is_held_and_delayed(tmp_path: Path) -> None:
    settings = ('duration=0.2', *GENTLE, 'controller.rate=200', 'controller.compute_delay=0.0035')
    simulate(scenario.load('fls_tip', settings), tmp_path / 'late')
    torque = values(tmp_path / 'late', COMMAND)
    changes = 1 + np.flatnonzero(np.diff(torque, axis=0).any(axis=1))
    # Computed at every fifth tick, from the state then, it acts 3.5 ticks later: at the fourth.
    assert set(changes % 5) == {4}
    assert (torque[:4] == 0.0).all()
    plain = ClosedLoop(scenario.load('fls_tip', ['duration=0.2', *GENTLE]))
    law = plain.answers.parts['controller']
    loop = ClosedLoop(scenario.load('fls_tip', settings))
    for _ in range(101):
        record = loop.tick()
        assert record is not None
    fresh = law.answer(100, record.tip[1:], record.encoder[1:], record.state, record.reference)
    assert torque[104].tolist() == list(fresh)
    assert verify(tmp_path / 'late').same


def test_the_command_is_lost_on_its_way(tmp_path: Path) -> None:
    settings = ['duration=0.2', *GENTLE, 'actuator.dropout=0.3', 'actuator.latency=0.002']
    config = scenario.load('fls_tip', settings)
    simulate(config, tmp_path / 'run')
    command = values(tmp_path / 'run', COMMAND)
    names = [topic.name for topic in BagReader(tmp_path / 'run').topics]
    applied = values(tmp_path / 'run', names.index('actuator/torque'))
    assert (applied[:2] == 0.0).all()
    late = np.concatenate([np.zeros((2, 2)), command[:-2]])
    same = (applied[:, :2] == late).all(axis=1)
    assert 0.6 < same.mean() < 0.8
    for k in np.flatnonzero(~same):
        assert (applied[k] == applied[k - 1]).all()
    assert verify(tmp_path / 'run').same


CHANGES = (
    Change(40, 'encoder', 'jitter', 0.004),
    Change(60, 'tip_sensor', 'dropout', 0.3),
    Change(61, 'tip_sensor', 'latency', 0.0155),
    Change(90, 'actuator', 'jitter', 0.003),
    Change(120, 'actuator', 'latency', 0.0045),
    Change(150, 'tip_sensor', 'jitter', 0.02),
    Change(200, 'encoder', 'jitter', 0.0),
)


def test_live_changes_are_recomputed(tmp_path: Path) -> None:
    config = scenario.load('fls_tip', ['duration=0.3', *GENTLE, 'actuator.latency=0.001'])
    write_changed(tmp_path / 'run', replace(config, changes=CHANGES))
    verdict = verify(tmp_path / 'run')
    assert verdict.same, verdict.first
    assert verdict.compared['closed loop'] == 7 * 300
    age = T0_NS + 1_000_000 * np.arange(300) - stamps(tmp_path / 'run', JOINT_STATES)
    assert (age[:40] == 0).all()
    assert age[40:200].max() > 0
    assert (age[210:] == 0).all()
    assert stamps(tmp_path / 'run', TIP)[150] <= T0_NS + 150_000_000 - 15_500_000


@pytest.mark.parametrize('section', ['encoder', 'tip_sensor', 'actuator'])
def test_measured_latencies_travel_in_the_bag(section: str, tmp_path: Path) -> None:
    measured = tmp_path / 'late.csv'
    measured.write_text('0.0012\n0.004\n\n0.0021\n0.015\n')
    file = tmp_path / 's.yaml'
    file.write_text(
        f'/**:\n  ros__parameters: {{duration: 0.1}}\n{section}:\n'
        '  ros__parameters: {latency_file: late.csv}\n'
    )
    config = scenario.load(file)
    assert config.section(section).latencies == (0.0012, 0.004, 0.0021, 0.015)
    simulate(config, tmp_path / 'run')
    measured.unlink()
    assert BagReader(tmp_path / 'run').config.section(section) == config.section(section)
    assert verify(tmp_path / 'run').same
    if section == 'encoder':
        # Ticks 0 to 5: sample 0 at the start; it would have come at tick 2.  1 at 5, 2 at 5, ...
        found = (stamps(tmp_path / 'run', JOINT_STATES) - T0_NS) // 1_000_000
        assert found[:9].tolist() == [0, 0, 0, 0, 0, 2, 4, 4, 4]


REFUSED = {
    'tip_sensor.rate=300': 'tip_sensor.rate: 300.0 Hz, allowed: 0 or the control rate of 1000 Hz',
    'encoder.rate=600': 'encoder.rate: 600.0 Hz, allowed: 0 or',
    'actuator.rate=600': 'actuator.rate: 600.0 Hz, allowed: 0 or',
    'controller.rate=450': 'controller.rate: 450.0 Hz, allowed: 0 or',
    'controller.compute_delay=-0.001': 'controller.compute_delay: -0.001 is out of range',
    'encoder.dropout=1.5': 'encoder.dropout: 1.5 is out of range; it must be at least 0 and',
    'encoder.jitter=-0.1': 'encoder.jitter: -0.1 is out of range',
    'encoder.jitter_distribution=gamma': 'one of uniform, exponential, normal',
    'encoder.arrival=lifo': 'one of newest, in_order',
    'encoder.dropout_burst=0.5': 'encoder.dropout_burst: 0.5 is out of range',
    'encoder.latency_file=none.csv': 'none.csv',
}


@pytest.mark.parametrize('setting', REFUSED)
def test_impossible_keys_are_refused_in_one_line(setting: str, tmp_path: Path) -> None:
    words = ('--set', setting, '--out', tmp_path / 'run')
    done = flexarm_here('simulate', 'fls_tip', *words)
    assert done.returncode == 2
    assert REFUSED[setting] in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert not (tmp_path / 'run').exists()


TOGETHER = {
    (
        'tip_sensor.latency_model=pade2',
        'tip_sensor.dropout=0.1',
    ): 'tip_sensor.latency_model: pade2',
    ('encoder.dropout=0.9', 'encoder.dropout_burst=2'): 'allowed: 1 or at least 9',
    ('controller.law=lqg', 'controller.rate=100'): 'controller.rate: 100.0 Hz, allowed with law',
}


@pytest.mark.parametrize('settings', TOGETHER)
def test_keys_that_do_not_fit_together_are_refused(settings: tuple[str, ...]) -> None:
    with pytest.raises(scenario.ScenarioError, match=re.escape(TOGETHER[settings])):
        scenario.load('fls_tip', settings)


@pytest.mark.parametrize(
    ('text', 'fault'),
    [
        ('', '0 latencies; allowed: 1 to 10000'),
        ('0.001\n-0.002\n', "line 2: '-0.002' is not a latency of 0 to 1000 s"),
        ('latency\n0.001\n', "line 1: 'latency' is not a latency"),
        ('0.001\nnan\n', "line 2: 'nan' is not a latency"),
    ],
)
def test_a_faulty_latency_file_is_named(text: str, fault: str, tmp_path: Path) -> None:
    (tmp_path / 'late.csv').write_text(text)
    with pytest.raises(scenario.ScenarioError, match=re.escape(fault)):
        scenario.load('fls_tip', [f'encoder.latency_file={tmp_path / "late.csv"}'])


def test_a_path_in_a_bag_is_not_opened() -> None:
    text = 'encoder:\n  ros__parameters: {latency_file: late.csv}\n'
    with pytest.raises(scenario.ScenarioError, match='its contents were not supplied'):
        scenario.from_text(text)


LOSSY = """
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from sensor_msgs.msg import JointState

class Lossy(Node):
    def __init__(self):
        super().__init__('lossy')
        self.count, self.last = 0, None
        self.out = self.create_publisher(JointState, 'joint_states', 1000)
        self.create_subscription(JointState, 'plant/state', self.answer, 1000)

    def answer(self, state):
        if self.count % 4 != 3:
            self.last = JointState(header=state.header, name=['shoulder', 'elbow'])
            self.last.position, self.last.velocity = state.position[:2], state.velocity[:2]
        self.count += 1
        self.out.publish(self.last)

rclpy.init()
try:
    rclpy.spin(Lossy())
except (KeyboardInterrupt, ExternalShutdownException):
    pass
"""
"""An encoder that loses every fourth sample and sends the one before once more."""


@pytest.mark.nodes
def test_an_external_sensor_repeats_what_it_has_if_loss_is_declared(
    tmp_path: Path, ros_domain: int
) -> None:
    (tmp_path / 'lossy.py').write_text(LOSSY)
    node = f'encoder={sys.executable} {tmp_path / "lossy.py"}'
    words = ('pd_tip', '--node', node, '--set', 'duration=0.1', '--no-pictures', '--out')
    refused = flexarm_here('run', *words, tmp_path / 'undeclared')
    assert refused.returncode == 1
    assert 'again at tick 3, or older than the one before' in refused.stderr
    done = flexarm_here('run', *words, tmp_path / 'run', '--set', 'encoder.dropout=0.25')
    assert done.returncode == 0, done.stderr
    ages = T0_NS + 1_000_000 * np.arange(100) - stamps(tmp_path / 'run', JOINT_STATES)
    assert ages.tolist() == [0, 0, 0, 1_000_000] * 25
    assert verify(tmp_path / 'run').same
