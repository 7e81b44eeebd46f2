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

"""References are published ahead of time, and still no more at once than a default queue holds."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys

from flexarm_ros.nodes.trajectory import AHEAD, ahead_until, BURST, TICK_EVERY
from nodetools import finish, flexarm
import pytest

DEFAULT_DEPTH = 10
"""Messages that a ROS 2 subscription keeps by default, and `ros2 bag record` of each topic."""

LISTENER = """
import rclpy
from nav_msgs.msg import Odometry
rclpy.init()
node = rclpy.create_node("listener")
stamps = []
node.create_subscription(Odometry, "/reference", lambda m: stamps.append(m.header.stamp), 10)
print("listening", flush=True)
while not stamps or stamps[-1].nanosec < 299_000_000:
    rclpy.spin_once(node, timeout_sec=1.0)
print(len(stamps), stamps[0].sec * 10**9 + stamps[0].nanosec, flush=True)
"""


def test_a_burst_is_no_longer_than_a_default_queue() -> None:
    assert BURST <= DEFAULT_DEPTH
    ticks, published, bursts = 1000, 0, []
    for reached in range(0, ticks, TICK_EVERY):
        until = ahead_until(reached, published, ticks)
        bursts.append(until - published)
        assert until >= min(reached + TICK_EVERY, ticks), 'the plant waits for none'
        published = until
    assert published == ticks
    assert max(bursts) <= BURST
    assert ahead_until(500, 500 + AHEAD, ticks) == 500 + AHEAD


def test_what_the_plant_waits_for_is_published_however_late_the_news() -> None:
    assert ahead_until(300, 10, 1000) == 300 + BURST


@pytest.mark.nodes
def test_a_subscription_of_the_default_depth_hears_every_reference(
    tmp_path: Path, ros_domain: int
) -> None:
    listener = subprocess.Popen(
        [sys.executable, '-c', LISTENER], stdout=subprocess.PIPE, text=True
    )
    try:
        assert listener.stdout is not None
        assert listener.stdout.readline() == 'listening\n'
        done = flexarm('run', 'fls_tip', '--rtf', '0.05', '--set', 'duration=0.3', '--no-pictures',
                       '--out', tmp_path / 'run')  # fmt: skip
        assert done.returncode == 0, done.stderr
    finally:
        (text,) = finish([listener], timeout=30.0)
    count, first = map(int, text.split())
    # It may have been found a little after the start; from then on nothing is left out.
    assert count == (1_300_000_000 - first) // 1_000_000
