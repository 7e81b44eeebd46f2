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

"""Time: stamps past 31 and 32 bits, past a day, small ticks; what `use_sim_time` nodes see."""

from __future__ import annotations

import csv
import json
from pathlib import Path
import subprocess
import sys

from flexarm_ros.core.timeline import T0_NS
from nodetools import Asker, flexarm_here
import pytest
from repository import ROOT
from rosbags.highlevel import AnyReader

HOLD = ('--set', 'trajectory.kind=hold', '--no-pictures')


@pytest.mark.nodes
@pytest.mark.parametrize(
    ('period_ns', 'ticks'), [(10_000_000, 500), (100_000, 500)], ids=['past 2^32 ns', '100 us']
)
def test_nodes_and_simulation_agree_on_time(tmp_path: Path, period_ns: int, ticks: int) -> None:
    settings = (*HOLD, '--set', f'control_period={period_ns / 1e9!r}',
                '--set', f'duration={period_ns * ticks / 1e9!r}')  # fmt: skip
    for way in ('run', 'simulate'):
        done = flexarm_here(way, 'pd_tip', *settings, '--out', tmp_path / way)
        assert done.returncode == 0, done.stderr
    for name in ('bag/bag_0.mcap', 'trajectory.csv'):
        assert (tmp_path / 'run' / name).read_bytes() == (
            tmp_path / 'simulate' / name
        ).read_bytes()
    with AnyReader([tmp_path / 'run' / 'bag']) as reader:
        clock = [
            reader.deserialize(data, connection.msgtype).clock
            for connection, _, data in reader.messages()
            if connection.topic == '/clock'
        ]
    stamps = [c.sec * 10**9 + c.nanosec for c in clock]
    assert stamps == [T0_NS + k * period_ns for k in range(ticks)]
    assert period_ns != 10_000_000 or stamps[0] < 2**31 < 2**32 < stamps[-1]


@pytest.mark.slow
def test_a_run_of_more_than_a_day(tmp_path: Path) -> None:
    gains = ('controller.kp=0', 'controller.kd=0', 'tip_sensor.latency=0', 'control_period=1',
             'duration=90000')  # fmt: skip
    words = [word for text in gains for word in ('--set', text)]
    done = flexarm_here('simulate', 'pd_tip', *HOLD, *words, '--out', tmp_path / 'run')
    assert done.returncode == 0, done.stderr
    with open(tmp_path / 'run' / 'trajectory.csv', encoding='utf-8') as file:
        times = [row['t'] for row in csv.DictReader(file)]
    assert [float(t) for t in times] == [float(k) for k in range(90_000)]


LISTENER = """
import json
import rclpy
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.parameter import Parameter

rclpy.init()
node = rclpy.create_node("listener", parameter_overrides=[Parameter("use_sim_time", value=True)])
clock, nows, jumps = node.get_clock(), [], []
threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1))
handle = clock.create_jump_callback(threshold, post_callback=lambda jump: jumps.append(len(nows)))
node.create_timer(0.05, lambda: nows.append(clock.now().nanoseconds))
while rclpy.ok() and len(nows) < 2:
    rclpy.spin_once(node, timeout_sec=0.1)
print("the run has begun", flush=True)
while rclpy.ok() and not (jumps and len(nows) > jumps[-1] + 5):
    rclpy.spin_once(node, timeout_sec=0.1)
print(json.dumps([jumps, nows]), flush=True)
"""


@pytest.mark.nodes
def test_a_node_of_others_with_use_sim_time(tmp_path: Path, ros_domain: int, rclpy_node) -> None:
    """Its timer follows the run; a reset reaches it as a jump back in time."""
    from std_srvs.srv import Trigger

    asker = Asker(*rclpy_node)
    listener = subprocess.Popen(
        [sys.executable, '-c', LISTENER], stdout=subprocess.PIPE, text=True, cwd=ROOT
    )
    run = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'pd_tip', '--set', 'duration=3', '--rtf',
         '0.2', '--no-pictures', '--out', str(tmp_path / 'run')],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        assert listener.stdout is not None
        assert listener.stdout.readline() == 'the run has begun\n'
        assert asker.call(Trigger, '/plant/reset').success
        said = listener.communicate(timeout=60)[0]
        assert asker.assign('plant', 'real_time_factor', 0.0).successful
        text = run.communicate(timeout=120)[0]
    finally:
        for process in (listener, run):
            process.kill()
            process.wait()
    assert run.returncode == 0, text
    jumps, nows = json.loads(said)
    (jump,) = jumps
    before, after = nows[:jump], nows[jump:]
    assert before == sorted(before)
    assert after == sorted(after)
    assert len(after) > 5
    assert min(nows) >= T0_NS
