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

"""Strain gauges, IMU, drives and disturbances in a run of nodes: the same bytes, verified."""

from __future__ import annotations

from pathlib import Path

from nodetools import check_every_way
import pytest

CASES = {
    'lab_arm': ('duration=0.3', 'disturbance.force_times=[0.0]', 'disturbance.force_x=[0.2]',
                'disturbance.force_y=[-0.1]'),
    'fls_tip': ('duration=0.3', 'controller.deflection_source=strain_gauge',
                'strain_gauge.output=angle', 'strain_gauge.filter_cutoff=[2.0, 5.0]',
                'strain_gauge.noise_std=1e-3', 'strain_gauge.dropout=0.2', 'imu.location=3.0',
                'imu.accel_bias_walk=0.1', 'imu.rate=500', 'imu.gyro_noise_density=0.01'),
}  # fmt: skip


@pytest.mark.nodes
@pytest.mark.usefixtures('ros_domain')
@pytest.mark.parametrize('case', CASES)
def test_a_rig_has_the_same_bytes_in_each_way_of_running(case: str, tmp_path: Path) -> None:
    check_every_way(case, CASES[case], tmp_path)
