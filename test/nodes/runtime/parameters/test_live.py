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

"""Parameters that are set while a run goes on: at a tick boundary, and on record."""

from __future__ import annotations

import json
from pathlib import Path
import threading

from nodetools import Asker, flexarm, flexarm_here, wait_for
import pytest

pytestmark = pytest.mark.nodes


CHANGES = (
    ('controller', 'kp', 80.0),
    ('tip_sensor', 'noise_std', 0.01),
    ('encoder', 'latency', 0.002),
    ('encoder', 'jitter', 0.001),
    ('tip_sensor', 'dropout', 0.05),
    ('trajectory', 'delay', 0.003),
)


def test_live_parameters_change_at_a_tick_and_are_on_record(
    tmp_path: Path, ros_domain: int, rclpy_node
) -> None:
    from flexarm_ros.bag.reading.reader import BagReader

    ask = Asker(*rclpy_node)
    out, done = tmp_path / 'run', []
    words = ('run', 'fls_tip', '--set', 'duration=1.0', '--rtf', '0.05', '--no-pictures',
             '--out', out)  # fmt: skip
    run = threading.Thread(target=lambda: done.append(flexarm(*words)))
    run.start()
    try:
        wait_for(lambda: ask.tick() > 20, 60, 'the run has begun')
        refused = ask.assign('controller', 'law', 'pd')
        assert not refused.successful
        assert 'read-only' in refused.reason
        refused = ask.assign('encoder', 'latency', 0.0000000005)
        assert not refused.successful
        assert 'nanosecond' in refused.reason
        assert not ask.assign('tip_sensor', 'dropout', 1.5).successful
        refused = ask.assign('controller', 'kn', 0.0)
        assert not refused.successful
        assert 'controller.kn' in refused.reason
        assert ask.get('controller', 'kn') == 5.0
        ask.pause(True)
        held = ask.tick()
        for node, key, value in CHANGES:
            assert ask.assign(node, key, value).successful, key
            assert ask.get(node, key) == value
        ask.pause(False)
        assert ask.assign('plant', 'real_time_factor', 0.0).successful
    finally:
        run.join(120)
    assert done[0].returncode == 0, done[0].stderr
    found = BagReader(out).config.changes
    assert {(c.node, c.key, c.value) for c in found} == set(CHANGES)
    for change in found:
        early = change.node == 'trajectory'  # it publishes ahead
        assert held < change.tick <= held + 129 if early else change.tick == held, change
    summary = json.loads((out / 'summary.json').read_text())
    assert [c['key'] for c in summary['changes']] == [c.key for c in found]
    assert summary['scenario']['controller']['kp'] == 150.79  # what it began with
    verified = flexarm_here('verify', out)
    assert verified.returncode == 0, verified.stdout
    assert 'closed loop  6000 messages the same' in verified.stdout
    # And the changes did something: without them another run comes out.
    fresh = flexarm_here('simulate', 'fls_tip', '--set', 'duration=1.0', '--no-pictures',
                         '--out', tmp_path / 'fresh')  # fmt: skip
    assert fresh.returncode == 0
    ours, theirs = ((p / 'trajectory.csv').read_text().splitlines() for p in
                    (out, tmp_path / 'fresh'))  # fmt: skip
    assert ours[: held + 1] == theirs[: held + 1]
    assert ours[held + 1] != theirs[held + 1]
