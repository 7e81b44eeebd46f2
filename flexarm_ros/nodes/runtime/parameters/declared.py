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
ROS parameters of a node: declared from the table of keys, checked as a scenario is.

Which sections of a parameter file are the node's is in `flexarm_ros.scenario.nodefile`.  What the
command line sets with ``-p`` overrides them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Any

from flexarm_ros.core.parameters.sections import keys, RunConfig, SECTIONS, Spec, values_of
from flexarm_ros.nodes.runtime.parameters.own import OWN, Own
from flexarm_ros.scenario.nodefile import NodeName, NodeParameters, read_node
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

__all__ = ['Own', 'declare_and_load', 'declare_own', 'given_parameters']

_TYPES = {
    'float': Parameter.Type.DOUBLE,
    'int': Parameter.Type.INTEGER,
    'bool': Parameter.Type.BOOL,
    'str': Parameter.Type.STRING,
    'float2': Parameter.Type.DOUBLE_ARRAY,
    'floats': Parameter.Type.DOUBLE_ARRAY,
}


def _ros_options(argv: list[str]) -> Iterator[tuple[str, str]]:
    """Yield each option of a ROS command line with the word after it."""
    inside = False
    for word, value in pairwise(argv):
        inside = word == '--ros-args' or (inside and word != '--')
        if inside:
            yield word, value


def parameter_files(argv: list[str]) -> list[str]:
    """Return the files named by ``--params-file`` in a ROS command line, in order."""
    return [value for option, value in _ros_options(argv) if option == '--params-file']


def assignments(argv: list[str], *names: str) -> Iterator[tuple[str, str]]:
    """
    Yield ``(key, YAML value)`` of each ``-p [NODE:]KEY:=VALUE`` for a node with one of ``names``.

    They are read here rather than by rclpy, where a section for the node in a file takes
    precedence over them, and where a rule with a node's name misses a node in a namespace.
    """
    for option, text in _ros_options(argv):
        if option in ('-p', '--param'):
            name, _, value = text.partition(':=')
            owner, colon, key = name.rpartition(':')
            if not colon or owner in names:
                yield key, value


def given_parameters(
    node: Node, role: str, argv: list[str], in_run: bool = True
) -> NodeParameters:
    """
    Return the parameters of ``node`` from files and command line.

    ``in_run``: the scenario's parameters are included.  Raises ScenarioError for an unknown key.
    """
    name = NodeName(role, node.get_fully_qualified_name(), OWN.get(role, ()), OWN, in_run)
    return read_node(parameter_files(argv), name, assignments(argv, role, node.get_name()))


def declare_and_load(node: Node, role: str, argv: list[str]) -> RunConfig:
    """
    Declare the parameters of ``role`` on ``node`` and return the checked scenario.

    Raises ScenarioError if a file or an override is invalid.
    """
    given = given_parameters(node, role, argv)
    config = given.config()
    for section in ('/**', role) if role in SECTIONS else ('/**',):
        known = keys(section)
        for key, value in values_of(config, section).items():
            if key == 'torque_file' and value is not None:
                value = str(given.torque_base / value)  # a dump may be loaded from anywhere
            _declare(node, key, known[key][1], value)
    return config


def declare_own(
    node: Node, role: str, parameters: Mapping[str, Own], argv: list[str], in_run: bool = True
) -> dict[str, Any]:
    """
    Declare the parameters of this node that are not part of a scenario; return the values.

    Raises ScenarioError if a given value is invalid.
    """
    given = given_parameters(node, role, argv, in_run)
    for note in given.notes:
        node.get_logger().warning(note)
    values = {}
    for key, own in parameters.items():
        values[key] = (
            own.read(f'{role}.{key}', given.own[key].tree) if key in given.own else own.default
        )
        _declare(node, key, own.spec, values[key])
    return values


def _declare(node: Node, key: str, spec: Spec, value: Any) -> None:
    """
    Declare one parameter; ``value`` None: it is not set.

    With a statically typed parameter that is not set, rclpy answers every request for several
    parameters with an empty list, so that `ros2 param dump` prints nothing.  With dynamic typing
    it answers "not set"; this is safe, since such a parameter is read-only.
    """
    kind = _TYPES[spec.kind]
    descriptor = ParameterDescriptor(
        description=spec.doc + (f' [{spec.unit}]' if spec.unit else ''),
        additional_constraints=spec.allowed,
        read_only=not spec.live,
        dynamic_typing=value is None,
    )
    if spec.low is not None and spec.high is not None:
        if spec.kind == 'float':
            limits = FloatingPointRange(from_value=spec.low, to_value=spec.high)
            descriptor.floating_point_range = [limits]
        elif spec.kind == 'int':
            low, high = int(spec.low), int(spec.high)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    value = list(value) if isinstance(value, tuple) else value
    node.declare_parameter(key, value, descriptor, ignore_override=True)
    if value is None:
        node.describe_parameter(key).type = kind.value  # for `ros2 param describe`
