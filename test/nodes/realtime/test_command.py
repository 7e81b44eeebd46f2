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
"""Which messages a free-running plant takes as commands, and for which tick."""

from __future__ import annotations

from typing import Any

from bagtools import small_config
from flexarm_ros.core.run.results.real_time import NO_COMMAND
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.topics import COMMAND, per_tick_topics
from freetools import free_config
import pytest

pytestmark = pytest.mark.nodes

CONFIG = free_config(small_config())
TIMELINE = Timeline.of(CONFIG.run)
TORQUE = (1.0, -2.0)


@pytest.fixture
def made(rclpy_node: Any) -> tuple[Any, list[str]]:
    """Return an input whose messages the test hands over, and the list of its complaints."""
    from flexarm_ros.nodes.realtime.command import CommandInput

    faults: list[str] = []
    topic = per_tick_topics(CONFIG)[COMMAND]
    entry = CommandInput(rclpy_node[0], topic, lambda _, fault: faults.append(fault))
    entry.configure(topic, TIMELINE)
    entry.near = True
    return entry, faults


def give(entry: Any, *stamps: int, torque: tuple[float, float] = TORQUE) -> None:
    entry.arrived.extend((b'', stamp, torque) for stamp in stamps)


def test_the_newest_command_counts(made: tuple[Any, list[str]]) -> None:
    entry, faults = made
    assert not entry.poll(0) and (entry.tick, entry.at) == (-1, NO_COMMAND)
    give(entry, TIMELINE.stamp_ns(0), TIMELINE.stamp_ns(3))
    assert entry.poll(5) and (entry.tick, entry.values) == (3, TORQUE)
    arrived = entry.at
    assert arrived > 0.0 and not entry.poll(6)
    give(entry, TIMELINE.stamp_ns(3))  # once more for the same tick
    assert entry.poll(7) and entry.tick == 3 and entry.at > arrived
    give(entry, 0)
    assert entry.poll(8) and entry.tick == 8
    entry.reset()
    assert (entry.tick, entry.at, entry.values) == (-1, NO_COMMAND, ())
    assert not faults


@pytest.mark.parametrize(
    ('stamp', 'torque', 'complaint'),
    [
        (TIMELINE.stamp_ns(5), TORQUE, 'of no tick from 2 to 4'),
        (TIMELINE.stamp_ns(1), TORQUE, 'of no tick from 2 to 4'),
        (TIMELINE.stamp_ns(3) + 1, TORQUE, 'of no tick from 2 to 4'),
        (1_700_000_000_000_000_000, TORQUE, 'of no tick from 2 to 4'),
        (
            TIMELINE.stamp_ns(4),
            (1.0, float('nan')),
            'effort.elbow is nan, from controller, at tick 4',
        ),
    ],
)
def test_what_is_no_command_is_named_and_left_out(
    stamp: int, torque: tuple[float, float], complaint: str, made: tuple[Any, list[str]]
) -> None:
    entry, faults = made
    give(entry, TIMELINE.stamp_ns(2))
    assert entry.poll(2)
    give(entry, stamp, torque=torque)
    assert not entry.poll(4)
    assert (entry.tick, entry.values) == (2, TORQUE)
    (fault,) = faults
    assert complaint in fault


def test_an_arrival_is_told_by_the_middleware_where_it_can_be() -> None:
    import time

    from flexarm_ros.nodes.realtime.command import arrival

    assert arrival({}, 5.0) == 5.0
    assert arrival({'received_timestamp': 0}, 5.0) == 5.0
    then = time.time_ns() - 2_000_000
    assert arrival({'received_timestamp': then}, 5.0) <= 5.0 - 0.002
    assert arrival({'received_timestamp': time.time_ns() + 10**12}, 5.0) == 5.0
