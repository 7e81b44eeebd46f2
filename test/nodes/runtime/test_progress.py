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

"""Side channels: a reader that is connected after the word was said hears it all the same."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import subprocess
import time

from flexarm_ros.nodes.runtime.topics.graph import TICK_TOPIC
from nodetools import write_scenario
import pytest
from std_msgs.msg import UInt64
from wiretools import fly_against, Peers

pytestmark = pytest.mark.nodes


@pytest.fixture
def plant(tmp_path: Path, ros_domain: int) -> Iterator[tuple[Peers, subprocess.Popen[str]]]:
    file = write_scenario(tmp_path / 's.yaml', 'fls_tip', 'duration=0.1', 'tick_timeout=60')
    peers, node = fly_against('plant', file)
    yield peers, node
    node.kill()
    node.wait()
    peers.close()


def test_a_late_reader_hears_how_far_the_plant_is(
    plant: tuple[Peers, subprocess.Popen[str]],
) -> None:
    """The plant waits at tick 0 for its torque: it has told that tick to nobody before."""
    peers, node = plant
    for topic in peers.output:
        peers.hear(topic, node)  # tick 0 is out
    late = peers.node.create_subscription(UInt64, TICK_TOPIC, lambda _: None, 1)
    deadline = time.monotonic() + 20.0
    while (taken := late.handle.take_message(UInt64, False)) is None:
        assert node.poll() is None
        assert time.monotonic() < deadline, 'nothing was told again'
        peers.wait_for(late.handle)
    assert taken[0].data == 0
