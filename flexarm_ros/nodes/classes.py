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

"""The node class of each role, by name; imports no ROS, since it is used before rclpy is."""

from __future__ import annotations

from flexarm_ros.core.run.parts import PARTS

OWN = {'plant': 'PlantNode', 'trajectory': 'TrajectoryNode', 'recorder': 'RecorderNode'}
"""Role -> node class in the module named like the role, for roles other than answering ones."""


def module_of(role: str) -> str:
    """Return the module with the node of ``role``."""
    return f'flexarm_ros.nodes.{role if role in OWN else "answering"}'


MODULES = ('flexarm_ros.nodes.process', *dict.fromkeys(module_of(part.NAME) for part in PARTS))
"""The modules that the nodes of a run import."""
