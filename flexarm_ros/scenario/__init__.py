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

"""
Scenarios: ROS 2 parameter files, read, checked and written without ROS.

Imports core.
"""

from flexarm_ros.scenario.errors import ScenarioError
from flexarm_ros.scenario.locate import find, shipped, shipped_suites, shipped_sweeps
from flexarm_ros.scenario.reader import from_dict, from_text, load, with_values
from flexarm_ros.scenario.torque_file import read_torques, write_torques
from flexarm_ros.scenario.writer import dump, resolved, to_dict

__all__ = [
    'ScenarioError',
    'dump',
    'find',
    'from_dict',
    'from_text',
    'load',
    'read_torques',
    'resolved',
    'shipped',
    'shipped_suites',
    'shipped_sweeps',
    'to_dict',
    'with_values',
    'write_torques',
]
