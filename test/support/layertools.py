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

"""The layers of the package, its modules, and what they import."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import repository

PACKAGE = 'flexarm_ros'
ROOT = repository.ROOT / PACKAGE
LAYERS = [
    *('core', 'stability', 'wire', 'scenario', 'bag', 'analysis', 'identification', 'nodes'),
    *('launcher', 'cli'),
]
API = 'api'

ROS = {
    *('rclpy', 'rcl_interfaces', 'ament_index_python', 'launch', 'launch_ros'),
    *('builtin_interfaces', 'rosgraph_msgs', 'std_msgs', 'sensor_msgs', 'nav_msgs', 'std_srvs'),
    *('geometry_msgs', 'diagnostic_msgs', 'visualization_msgs', 'simulation_interfaces'),
}


def imports(tree: ast.Module, module: str, is_package: bool) -> Iterator[str]:
    """
    Yield the dotted name of everything that a module imports, wherever in it.

    Also what it imports by a call with the name as a literal.
    """
    base = module.split('.') if is_package else module.split('.')[:-1]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = base[: len(base) - node.level + 1] if node.level else []
            prefix = '.'.join([*start, *([node.module] if node.module else [])])
            yield from (f'{prefix}.{alias.name}' for alias in node.names)
        elif isinstance(node, ast.Call) and _called(node.func) in {'import_module', '__import__'}:
            names = [a.value for a in node.args[:1] if isinstance(a, ast.Constant)]
            yield from (name for name in names if isinstance(name, str))


def _called(function: ast.expr) -> str:
    """Return the last part of the name of a function."""
    if isinstance(function, ast.Attribute):
        return function.attr
    return function.id if isinstance(function, ast.Name) else ''


def modules() -> list[Path]:
    return sorted(ROOT.rglob('*.py'))


def dotted(path: Path) -> str:
    parts = list(path.relative_to(ROOT.parent).with_suffix('').parts)
    return '.'.join(parts[:-1] if parts[-1] == '__init__' else parts)
