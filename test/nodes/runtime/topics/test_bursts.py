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

from bisect import bisect
from collections import Counter
from pathlib import Path
import time

from flexarm_ros.nodes.runtime.topics.graph import TICK_TOPIC
from flexarm_ros.nodes.trajectory import AHEAD, ahead_until, BURST, TICK_EVERY
from nav_msgs.msg import Odometry
from nodetools import wait_for, write_scenario
import pytest
from std_msgs.msg import UInt64
from wiretools import fly_against

DEFAULT_DEPTH = 10
"""Messages that a ROS 2 subscription keeps by default, and `ros2 bag record` of each topic."""


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
def test_a_report_is_followed_by_no_more_than_a_default_queue_holds(
    tmp_path: Path, ros_domain: int
) -> None:
    """
    Counted by the publisher's time stamps between the reports of a plant that waits for each.

    So it does not matter when this process or the node is scheduled.
    """
    ticks = 200
    file = write_scenario(tmp_path / 's.yaml', 'fls_tip', 'duration=0.2', 'tick_timeout=60')
    peers, node = fly_against('trajectory', file)
    try:
        (topic,) = peers.output
        handle = peers.heard[topic.name].handle
        plant = peers.publisher(TICK_TOPIC, UInt64, 1)
        wait_for(lambda: plant.get_subscription_count() > 0, 60, 'the report has a reader')
        sent: list[int] = []

        def heard() -> bool:
            while (taken := handle.take_message(Odometry, True)) is not None:
                sent.append(taken[1]['source_timestamp'])
            return len(sent) >= until

        until, reports = 0, [0]
        for reached in range(0, ticks, TICK_EVERY):
            until = ahead_until(reached, until, ticks)
            plant.publish(UInt64(data=reached))
            wait_for(heard, 60, f'{until} references after the report of tick {reached}')
            reports.append(time.time_ns())
        assert len(sent) == ticks
        counts = Counter(bisect(reports, stamp) for stamp in sent)
        assert max(counts.values()) <= DEFAULT_DEPTH, counts
    finally:
        node.kill()
        node.wait()
        peers.close()
