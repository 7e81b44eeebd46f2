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

A node reads the whole parameter file it is given, as `flexarm simulate` does,
because it needs its neighbours' parameters too (the controller the link
lengths, say) and because a wrong key must be named whoever it belongs to.
What the command line sets with ``-p`` then overrides its own section.
"""

from __future__ import annotations

from collections.abc import Iterator
from collections.abc import Mapping as Map
from dataclasses import dataclass
from typing import Any, TYPE_CHECKING

from flexarm_ros import scenario
from flexarm_ros.core.parameters import RunConfig, RunParameters, SECTIONS, Spec, specs
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter
import yaml

if TYPE_CHECKING:
    from flexarm_ros.nodes.participant import Participant

OF_ROS = ('qos_overrides.', 'use_sim_time', 'start_type_description')
"""Parameters that every node has."""


@dataclass(frozen=True)
class Own:
    """A parameter of one node that is no part of a scenario: text, number or true or false."""

    default: str | bool | int | float
    doc: str
    unit: str = ''
    low: float = 0.0
    high: float = 0.0
    live: bool = False

    def describe(self) -> ParameterDescriptor:
        """Return what `ros2 param describe` says."""
        descriptor = ParameterDescriptor(
            description=self.doc + (f' [{self.unit}]' if self.unit else ''),
            read_only=not self.live,
        )
        if isinstance(self.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=self.low, to_value=self.high)
            ]
        elif isinstance(self.default, int) and not isinstance(self.default, bool):
            low, high = int(self.low), int(self.high)
            descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
        return descriptor

    def read(self, name: str, text: str) -> str | int | float:
        """Return the value that a command line gives, as YAML; ScenarioError if not allowed."""
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError:
            value = None
        kind = type(self.default)
        if kind is str:
            return value if isinstance(value, str) else text
        fits = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not fits or kind(value) != value or not self.low <= value <= self.high:
            what = 'a number' if kind is float else 'a whole number'
            raise scenario.ScenarioError(
                f'{name}: {text!r} is not {what} from {self.low:g} to {self.high:g}'
            )
        return kind(value)


_TYPES = {
    'float': Parameter.Type.DOUBLE,
    'int': Parameter.Type.INTEGER,
    'bool': Parameter.Type.BOOL,
    'str': Parameter.Type.STRING,
    'float2': Parameter.Type.DOUBLE_ARRAY,
    'floats': Parameter.Type.DOUBLE_ARRAY,
}


def parameter_files(argv: list[str]) -> list[str]:
    """Return the files named by ``--params-file`` in a ROS command line, in order."""
    return [value for flag, value in zip(argv, argv[1:], strict=False) if flag == '--params-file']


def assignments(argv: list[str], node: str) -> Iterator[tuple[str, str]]:
    """
    Yield ``(name, YAML value)`` of each ``-p [NODE:]NAME:=VALUE`` that is meant for ``node``.

    They are read here and not from rclpy, where a file's own section for the
    node would win over them, and a rule for a node by name misses one that is
    in a namespace.
    """
    mine = (node, '*', '**')
    inside = False
    words = iter(argv)
    for word in words:
        inside = word == '--ros-args' or (inside and word != '--')
        if not inside or word not in ('-p', '--param'):
            continue
        name, _, value = next(words, '').partition(':=')
        owner, colon, key = name.rpartition(':')
        if not colon or owner.lstrip('/') in mine:
            yield key, value


def declare_and_load(node: Participant, role: str, argv: list[str]) -> RunConfig:
    """
    Declare the parameters of ``role`` on ``node`` and return the checked scenario.

    Raises ScenarioError where a file or an override is not allowed.
    """
    own = dict(assignments(argv, node.get_name()))
    config = scenario.load(parameter_files(argv), _overrides(own, node, role))
    for section, kind in (('run', RunParameters), (role, SECTIONS.get(role))):
        if kind is None:
            continue
        for key, (name, spec, _) in specs(kind).items():
            _declare(node, key, spec, getattr(getattr(config, section), name))
    return config


def _overrides(own: dict[str, str], node: Participant, role: str) -> Iterator[str]:
    """Yield ``section.key=value`` for what the command line sets of the scenario."""
    common, known = specs(RunParameters), specs(SECTIONS[role]) if role in SECTIONS else {}
    for key, value in own.items():
        if key in node.OWN_PARAMETERS or key.startswith(OF_ROS):
            continue
        section = '/**' if key in common and key not in known else role
        yield f'{section}.{key}={value}'


def declare_own(node: Node, role: str, parameters: Map[str, Own], argv: list[str]) -> None:
    """
    Declare what only this node has, and no scenario.

    Raises ScenarioError where the command line gives one that is not allowed.
    """
    given = dict(assignments(argv, node.get_name()))
    for key, own in parameters.items():
        value = own.read(f'{role}.{key}', given[key]) if key in given else own.default
        node.declare_parameter(key, value, own.describe(), ignore_override=True)


def _declare(node: Node, key: str, spec: Spec, value: Any) -> None:
    descriptor = ParameterDescriptor(
        description=spec.doc + (f' [{spec.unit}]' if spec.unit else ''),
        additional_constraints=_constraints(spec),
        read_only=not spec.live,
    )
    if spec.kind == 'float' and spec.low is not None and spec.high is not None:
        descriptor.floating_point_range = [
            FloatingPointRange(from_value=spec.low, to_value=spec.high)
        ]
    if spec.kind == 'int' and spec.low is not None and spec.high is not None:
        descriptor.integer_range = [
            IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)
        ]
    if value is None:
        node.declare_parameter(key, _TYPES[spec.kind], descriptor, ignore_override=True)
    else:
        node.declare_parameter(
            key, list(value) if isinstance(value, tuple) else value, descriptor,
            ignore_override=True,
        )  # fmt: skip


def _constraints(spec: Spec) -> str:
    if spec.choices:
        return 'one of: ' + ', '.join(spec.choices)
    if spec.kind in ('float2', 'floats') and spec.low is not None:
        above = 'above' if spec.low_open else 'from'
        return f'each value {above} {spec.low:g} to {spec.high:g}'
    return f'above {spec.low:g}' if spec.low_open else ''
