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
"""Runs with the plant at the pace of the wall clock; no test depends on how well it is kept."""

from __future__ import annotations

import csv
from itertools import pairwise
import json
from pathlib import Path
import re
import subprocess
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.timing import read_timing
from flexarm_ros.core.run.results.real_time import KEYS
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.launcher.run import run_scenario, RunOptions
from flexarm_ros.scenario.suites.suite import Fault
from free_controller import STATES
from nodetools import finish, flexarm, ROOT, start_node, wait_for, write_scenario
import numpy as np
import pytest
from repository import SUPPORT
from ros2_control import GOAL

pytestmark = pytest.mark.nodes

LATE = SUPPORT / 'nodes' / 'free_controller.py'
# The arm holds its place, so that a torque that comes late on a busy machine does no harm.
FREE = ('--set', 'sync=free', '--set', 'trajectory.kind=hold', '--rtf', '1', '--no-pictures')
NOISE = 'tip_sensor.noise_std=1e-4'


def run(out: Path, *words: str, mode: str = '') -> subprocess.CompletedProcess[str]:
    """Run pd_tip freely, 500 ticks of 2 ms, with an external controller if a mode is given."""
    node = ['--node', f'controller={sys.executable} {LATE} {mode}'] if mode else []
    return flexarm(
        'run', 'pd_tip', *FREE, '--compose', '--set', 'control_period=0.002', '--set',
        'duration=1', *node, '--out', out, *words,
    )  # fmt: skip


def counted(out: Path) -> dict[str, Any]:
    """Return what the summary says of the timing; the counts must agree with one another."""
    summary = json.loads((out / 'summary.json').read_text())
    found: dict[str, Any] = summary['real_time']
    assert tuple(found) == KEYS
    assert 0 <= found['held_commands'] <= found['missed_commands'] <= summary['ticks']
    assert 0 <= found['late_ticks'] <= summary['ticks']
    for spread in (found['command_latency_ms'], found['tick_jitter_ms']):
        assert 0.0 <= spread['p50'] <= spread['p99'] <= spread['max']
    timing = read_timing(out)
    assert timing is not None and len(timing.begin) == summary['ticks']
    assert timing.summary() == found
    # Absolute deadlines: whatever was late, tick k is due k periods after the first.
    np.testing.assert_allclose(timing.due, np.arange(len(timing.due)) * timing.period, atol=1e-6)
    assert (timing.jitter >= 0.0).all()
    return found


def test_six_processes_run_freely(tmp_path: Path, ros_domain: int) -> None:
    out = tmp_path / 'run'
    done = flexarm(
        'run', 'fls_tip', *FREE, '--set', 'control_period=0.005', '--set', 'duration=0.5',
        '--set', 'plant.command_hold=30', '--set', NOISE, '--out', out,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert 'real time: ' in done.stderr and 'garbage collector off' in done.stderr
    assert done.stderr.count('nodes but the recorder: SCHED_FIFO 5') == 1  # granted or not
    counted(out)
    verdict = verify(out)
    assert verdict.same and set(verdict.compared) >= {'plant', 'encoder', 'trajectory'}
    assert verdict.compared['controller'] == 100
    again = flexarm('replay', out, '--timing', 'recorded', '--delay', '0')
    assert again.returncode == 0 and 'played 100 ticks' in again.stdout + again.stderr
    scenario = write_scenario(tmp_path / 's.yaml', 'fls_tip', 'sync=free', 'duration=0.5',
                              'control_period=0.005', 'trajectory.kind=hold', NOISE)  # fmt: skip
    controller = start_node('controller', scenario)
    try:
        player = flexarm('replay', out, '--timing', 'recorded', '--without', 'controller',
                         '--domain', str(ros_domain))  # fmt: skip
    finally:
        finish([controller])
    assert player.returncode == 0, player.stderr
    said = player.stdout + player.stderr
    # As many are compared as had an effect in the run.
    assert '100 torques, ' in said and ', largest difference 0 N m' in said
    assert ' 0 equal to the recorded ones' not in said
    assert 'command latency p50/p99/max ' in said and ', recorded ' in said


@pytest.mark.parametrize('way', [(), ('--compose',)], ids=['processes', 'composed'])
def test_a_rig_runs_freely(way: tuple[str, ...], tmp_path: Path, ros_domain: int) -> None:
    """Drives, a push, strain gauges, an IMU, channels: flown, counted, verified, replayed."""
    out = tmp_path / 'run'
    words = [
        'disturbance.force_times=[0.0]', 'disturbance.force_x=[0.2]', 'disturbance.force_y=[-0.1]',
        'disturbance.payload_times=[0.1]', 'disturbance.payload_masses=[0.5]',
        'encoder.jitter=0.004', 'actuator.latency=0.002', 'actuator.dropout=0.1',
        'strain_gauge.dropout=0.2', 'imu.jitter=0.003', 'plant.command_hold=30', 'duration=1.0',
    ]  # fmt: skip
    settings = [word for setting in words for word in ('--set', setting)]
    done = flexarm('run', 'lab_arm', *FREE, *settings, *way, '--out', out)
    assert done.returncode == 0, done.stderr
    asking = 'composed nodes' if way else 'nodes but the recorder'
    assert f'{asking}: SCHED_FIFO 5' in done.stderr
    counted(out)
    verdict = verify(out)
    assert verdict.same, verdict.first
    assert {verdict.compared[name] for name in ('actuator', 'controller')} == {1000}
    assert verdict.compared['disturbance'] == 2000  # force and payload
    again = flexarm('replay', out, '--timing', 'recorded', '--delay', '0')
    assert again.returncode == 0 and 'played 1000 ticks' in again.stdout + again.stderr


def test_a_silent_controller_before_drives_ends_the_run(tmp_path: Path, ros_domain: int) -> None:
    drives = ('--set', 'actuator.bandwidth=[50.0,50.0]', '--set', 'plant.command_hold=0.1')
    done = run(tmp_path / 'run', *drives, mode='silent')
    assert done.returncode == 1
    assert 'no torque on actuator/torque, which follows joint_command, for 0.1 s' in done.stderr
    assert 'Traceback' not in done.stderr


def test_a_controller_before_drives_may_skip_states(tmp_path: Path, ros_domain: int) -> None:
    """The drives take the command before in their place; one is recorded for each tick."""
    out = tmp_path / 'run'
    drives = ('--set', 'actuator.bandwidth=[50.0,50.0]', '--set', 'plant.command_hold=30')
    done = run(out, *drives, mode='late')
    assert done.returncode == 0, done.stderr
    counted(out)
    verdict = verify(out)
    assert verdict.same, verdict.first
    assert verdict.compared['actuator'] == verdict.ticks == 500
    with open(out / 'trajectory.csv', newline='') as file:
        torques = [(row['tau1'], row['tau2']) for row in csv.DictReader(file)]
    repeated = [now == before for before, now in pairwise(torques)]
    assert any(repeated) and not all(repeated)


def test_a_controller_that_is_late_now_and_then_finishes_its_run(
    tmp_path: Path, ros_domain: int
) -> None:
    out = tmp_path / 'run'
    done = run(out, '--set', 'plant.command_hold=30', mode='late')
    assert done.returncode == 0, done.stderr
    found = counted(out)
    assert found['missed_commands'] > 0
    assert found['command_latency_ms']['max'] >= 4.0
    verdict = verify(out)
    assert verdict.same and verdict.compared['plant'] == 1000


def test_a_run_goes_on_without_its_controller_if_so_configured(
    tmp_path: Path, ros_domain: int
) -> None:
    out = tmp_path / 'run'
    hold = ('--set', 'plant.command_loss=zero', '--set', 'plant.command_hold=0.1')
    done = run(out, *hold, mode='dies')
    assert done.returncode == 0, done.stderr
    assert 'ended, killed by SIGTERM; the run goes on' in done.stderr
    assert 'no torque on joint_command for 0.1 s: zero torque' in done.stderr
    with open(out / 'trajectory.csv', newline='') as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 500
    assert float(rows[-1]['tau1']) == float(rows[-1]['tau2']) == 0.0
    assert any(float(row['tau1']) for row in rows)
    assert counted(out)['held_commands'] >= 50
    assert verify(out).same


def test_a_silent_controller_ends_the_run_with_its_name(tmp_path: Path, ros_domain: int) -> None:
    out = tmp_path / 'run'
    done = run(out, '--set', 'plant.command_hold=0.1', mode='silent')
    assert done.returncode == 1
    assert 'controller: tick ' in done.stderr
    assert 'no torque on joint_command for 0.1 s' in done.stderr
    assert 'Traceback' not in done.stderr
    assert 'real_time' in json.loads((out / 'summary.json').read_text())


def test_the_rest_is_recorded_after_a_controller_was_terminated(
    tmp_path: Path, ros_domain: int
) -> None:
    """Of a recorder that is 10 ticks behind, stopped until the run has ended."""
    config = scenario.load('pd_tip', [
        'sync=free', 'trajectory.kind=hold', 'control_period=0.002', 'duration=4',
        'plant.command_hold=30',
    ])  # fmt: skip
    controller = [sys.executable, str(LATE), 'dies']
    stopped = Fault((STATES - 10) * config.run.control_period, 'recorder', 'delay', seconds=60)
    outcome = run_scenario(
        config, 'pd_tip', tmp_path / 'run', RunOptions(rtf=1.0, nodes={'controller': controller}),
        faults=FaultPlan([stopped], Timeline.of(config.run)),
    )  # fmt: skip
    found = re.fullmatch(r'controller: tick (\d+): ended, killed by SIGTERM', outcome.problem)
    assert found is not None, outcome.problem
    ticks = outcome.summary['ticks']
    assert STATES <= int(found[1]) <= ticks < 2000
    assert not (tmp_path / 'run' / 'bag-damaged').exists()
    verdict = verify(tmp_path / 'run')
    assert verdict.same, verdict.first
    assert verdict.ticks == ticks


def test_an_arm_is_commanded_as_ros2_control_would(tmp_path: Path, ros_domain: int) -> None:
    """With the topics, QoS and stamps of its nodes, which are not among the wheels."""
    out = tmp_path / 'run'
    manager = f'{sys.executable} {SUPPORT / "nodes" / "ros2_control.py"}'
    done = flexarm(
        'run', 'pd_tip', *FREE, '--compose', '--set', 'control_period=0.005',
        '--set', 'duration=2', '--set', 'plant.command_hold=30',
        '--node', f'controller={manager}', '--out', out,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    counted(out)
    verdict = verify(out)
    assert verdict.same, verdict.first
    with open(out / 'trajectory.csv', newline='') as file:
        angles = np.array([(row['theta1'], row['theta2']) for row in csv.DictReader(file)], float)
    error = np.abs(angles - GOAL)
    assert (error[-1] < 0.5 * error[0]).all()


def test_what_the_wall_clock_cannot_hold_is_told(tmp_path: Path, ros_domain: int) -> None:
    done = flexarm(
        'run', 'pd_tip', '--compose', '--rtf', '1000', '--set', 'duration=1', '--no-pictures',
        '--out', tmp_path / 'run',
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert '1000 times real time could not be held: ' in done.stderr


def test_diagnostics_tell_the_timing(tmp_path: Path, ros_domain: int, rclpy_node: Any) -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    node, executor = rclpy_node
    heard: dict[str, str] = {}

    def take(message: Any) -> None:
        for status in message.status:
            if status.name.startswith('/plant'):
                heard.update({pair.key: pair.value for pair in status.values})

    node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    free = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'pd_tip', *FREE, '--compose', '--set',
         'duration=60', '--set', 'plant.command_hold=30', '--out', str(tmp_path / 'run')],
        cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
    )  # fmt: skip
    try:

        def told() -> bool:
            executor.spin_once(timeout_sec=0.1)
            return bool(heard.get('tick jitter p99 (ms)'))

        wait_for(told, 60, 'the plant tells its timing')
        assert int(heard['late ticks']) >= 0 and int(heard['held commands']) >= 0
    finally:
        free.send_signal(2)
        (text,) = finish([free])
    assert free.returncode == 130, text
    assert counted(tmp_path / 'run')
