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

"""A controller node under test: `pytest examples/test_my_controller.py` (docs/testing.md)."""

from pathlib import Path
import sys

MY_CONTROLLER = [sys.executable, Path(__file__).parent / 'minimal_controller.py']


def test_it_brings_the_arm_to_its_goal(flexarm_run):
    run = flexarm_run(
        'pd_collocated',
        {'duration': 1.0, 'plant.payload_mass': 0.5, 'plant.initial_position': [-2.4, 0.2]},
        nodes={'controller': MY_CONTROLLER},
    )
    assert run.stable, run.problem
    assert run['max_torque'] < 250.0  # N m
    assert run['max_deflection'] < 0.2  # m
    assert abs(run.trajectory['theta1'][-1] - -2.496) < 0.02  # rad
    assert run.verify().same  # plant, sensors and reference are as recomputed
