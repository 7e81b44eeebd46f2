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
"""A law's period is that of its torques, not of the plant's ticks."""

from __future__ import annotations

from flexarm_ros import scenario
from flexarm_ros.core.control import make_law, Sample


def test_the_filters_of_state_feedback_step_by_the_controllers_period() -> None:
    """The same samples give the same torques at 200 Hz, whatever the rate of the plant."""
    slow = make_law(
        scenario.load('quanser_2dsfl', ['control_period=0.005', 'controller.rate=0.0'])
    )
    fast = make_law(
        scenario.load('quanser_2dsfl', ['control_period=0.001', 'controller.rate=200.0'])
    )
    assert slow.period == fast.period == 0.005
    for n in range(5):
        angles, point = (0.1 * n, -0.05 * n), (0.3, 0.1, 0.0, 0.0)
        encoder = (*angles, 0.0, 0.0)
        sample = Sample(angles, (0.0, 0.0), (0.001 * n, 0.002), encoder, point, point)
        assert slow.torque(n, sample) == fast.torque(5 * n, sample)
        assert slow.torque(n, sample) != (0.0, 0.0)
