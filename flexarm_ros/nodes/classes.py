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

from flexarm_ros.core.run.part import Answer
from flexarm_ros.core.run.parts import part_of, PARTS


def has_own_node(role: str) -> bool:
    """Return whether ``role`` has a node class of its own, in the module of that name."""
    part = part_of(role)
    return part in PARTS and (part.AHEAD or not issubclass(part, Answer))


def module_of(role: str) -> str:
    """Return the module with the node of ``role``."""
    return f'flexarm_ros.nodes.{role if has_own_node(role) else "answering"}'


def class_of(role: str) -> str:
    """Return the name of the class of a node of its own, ``PlantNode`` for ``PlantPart``."""
    return f'{part_of(role).__name__.removesuffix("Part")}Node'


MODULES = ('flexarm_ros.nodes.process', *dict.fromkeys(module_of(part.NAME) for part in PARTS))
"""The modules that the nodes of a run import."""
