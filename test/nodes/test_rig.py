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
from subprocess import CompletedProcess
import sys

from flexarm_ros.bag.checks.verify import verify
from nodetools import check_every_way, flexarm, flexarm_here
import pytest
from repository import SUPPORT

CASES = {
    'lab_arm': ('duration=0.3', 'disturbance.force_times=[0.0]', 'disturbance.force_x=[0.2]',
                'disturbance.force_y=[-0.1]', 'disturbance.payload_times=[0.1, 0.2]',
                'disturbance.payload_masses=[0.5, 0.1]'),
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


LIVE = ('duration=0.2', 'plant.payload_mass=0.3', 'disturbance.payload_live=true')


@pytest.mark.nodes
@pytest.mark.usefixtures('ros_domain')
def test_a_payload_from_a_topic_is_that_of_a_file(tmp_path: Path) -> None:
    """Grasped and released at its tick, recorded, verified; and too light a one is named."""
    program = SUPPORT / 'nodes' / 'grasper.py'

    def flown(name: str, payloads: str) -> CompletedProcess[str]:
        node = f'disturbance={sys.executable} {program} {payloads}'
        words = [word for text in LIVE for word in ('--set', text)]
        out = tmp_path / name
        return flexarm_here('run', 'pd_tip', *words, '--node', node, '--no-pictures', '--out', out)

    done = flown('live', '0 0.3 60 1.5 120 0.0')
    assert done.returncode == 0, done.stderr
    verdict = verify(tmp_path / 'live')
    assert verdict.same and verdict.compared['plant'] == 400, verdict.first
    file = ('disturbance.payload_times=[0.06, 0.12]', 'disturbance.payload_masses=[1.5, 0.0]')
    words = [word for text in (*LIVE, *file) for word in ('--set', text)]
    out = tmp_path / 'file'
    done = flexarm_here('simulate', 'pd_tip', *words, '--no-pictures', '--out', out)
    assert done.returncode == 0, done.stderr
    live, wanted = (
        (tmp_path / name / 'trajectory.csv').read_text().splitlines() for name in ('live', 'file')
    )
    assert len(wanted) == 201 and live == wanted
    assert [float(wanted[k + 1].split(',')[-1]) for k in (59, 60, 120)] == [0.3, 1.5, 0.0]
    assert flexarm('replay', tmp_path / 'live', '--rate', '4').returncode == 0
    done = flown('light', '0 0.3 60 -1.0')
    assert done.returncode == 1
    assert 'disturbance: tick 60: payload -1.0 kg; allowed: 0.0 to 1000000.0 kg' in done.stderr
