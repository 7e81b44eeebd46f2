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

"""DDS-Security: the wheels' Fast DDS has none, and says so before a node is there."""

from __future__ import annotations

from pathlib import Path

from nodetools import finish, start_node, write_scenario
import pytest

pytestmark = pytest.mark.nodes


def test_security_that_cannot_be_had_is_refused_in_one_line(
    tmp_path: Path, ros_domain: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / 'keys' / 'enclaves').mkdir(parents=True)
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path / 'keys'))
    file = write_scenario(tmp_path / 's.yaml', 'pd_tip')
    node = start_node('controller', file)
    (text,) = finish([node])
    assert node.returncode in (1, 2)
    assert 'Traceback' not in text
    # Where Fast DDS has it, the empty keystore is what is wrong.
    assert 'security' in text.lower(), text
