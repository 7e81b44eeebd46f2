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

"""``ros2 param``: read and set parameters."""

from __future__ import annotations

import argparse
import re
import sys
from typing import Any

from flexarm_ros.ros2_standin import session
from rcl_interfaces.msg import ParameterType
from rclpy.node import Node
from rclpy.parameter import get_parameter_value, Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
import yaml

SERVICE_TIMEOUT_S = 5.0
TYPES = {
    ParameterType.PARAMETER_NOT_SET: 'not set',
    ParameterType.PARAMETER_BOOL: 'boolean',
    ParameterType.PARAMETER_INTEGER: 'integer',
    ParameterType.PARAMETER_DOUBLE: 'double',
    ParameterType.PARAMETER_STRING: 'string',
    ParameterType.PARAMETER_BYTE_ARRAY: 'byte array',
    ParameterType.PARAMETER_BOOL_ARRAY: 'boolean array',
    ParameterType.PARAMETER_INTEGER_ARRAY: 'integer array',
    ParameterType.PARAMETER_DOUBLE_ARRAY: 'double array',
    ParameterType.PARAMETER_STRING_ARRAY: 'string array',
}


def add_verbs(name: str, command: argparse.ArgumentParser) -> None:
    """Add the verbs of ``param``."""
    verbs = command.add_subparsers(title='Verbs', metavar='VERB')
    verb = verbs.add_parser('list', help='parameters of a node, or of all')
    session.add_options(verb)
    verb.add_argument('node_name', nargs='?')
    verb.add_argument('--include-hidden-nodes', action='store_true')
    verb.add_argument('--filter', metavar='REGEX', help='only names that match')
    verb.add_argument('--param-type', action='store_true', help='print types too')
    verb.set_defaults(verb=list_parameters)
    for word, text, function in (
        ('get', 'value of a parameter', get),
        ('set', 'set a parameter', set_parameter),
        ('describe', 'type, range and description', describe),
        ('dump', 'all parameters of a node, as a parameter file', dump),
    ):
        verb = verbs.add_parser(word, help=text)
        session.add_options(verb)
        verb.add_argument('node_name')
        verb.add_argument('--include-hidden-nodes', action='store_true')
        verb.add_argument(
            '--timeout',
            type=float,
            default=session.PATIENCE_S,
            metavar='N',
            help='seconds to wait for the node (default %(default)s)',
        )
        verb.set_defaults(verb=function)
        if word == 'dump':
            continue
        if word == 'describe':
            verb.add_argument('parameter_names', nargs='+')
            continue
        verb.add_argument('parameter_name')
        if word == 'get':
            verb.add_argument('--hide-type', action='store_true')
        else:
            verb.add_argument('value')


class Client:
    """The parameter services of one node."""

    def __init__(self, looker: Node, name: str) -> None:
        self._looker = looker
        self._client = AsyncParameterClient(looker, name)
        if not session.wait_until(looker, self._client.services_are_ready, SERVICE_TIMEOUT_S):
            raise RuntimeError(
                f'Wait for service timed out waiting for parameter services for node {name}'
            )

    def ask(self, what: str, *arguments: Any) -> Any:
        """Call one of the services and return its answer."""
        future = getattr(self._client, what)(*arguments)
        if not session.wait_until(self._looker, future.done, SERVICE_TIMEOUT_S):
            raise RuntimeError(f'No answer to {what} within {SERVICE_TIMEOUT_S:g} s')
        return future.result()


def found_client(looker: Node, options: argparse.Namespace) -> Client:
    """Return the client of the node that the options name; RuntimeError if it is not there."""
    return Client(looker, session.wait_for_node(looker, options.node_name, options.timeout))


def list_parameters(options: argparse.Namespace) -> int:
    """Print the names of the parameters, node by node."""
    with session.node(options) as looker:
        names = session.node_names(looker, options.include_hidden_nodes)
        if options.node_name is not None:
            names = [name for name in names if name == session.absolute(options.node_name)]
            if not names:
                raise RuntimeError('Node not found')
        for name in names:
            try:
                print_names(Client(looker, name), name, options)
            except RuntimeError as error:
                print(error)
    return 0


def print_names(client: Client, node_name: str, options: argparse.Namespace) -> None:
    """Print the names of one node's parameters."""
    names = sorted(client.ask('list_parameters').result.names)
    if options.filter is not None:
        names = [name for name in names if re.match(options.filter, name)]
    if options.node_name is None and names:
        print(f'{node_name}:')
    kinds = {}
    if options.param_type and names:
        descriptors = client.ask('describe_parameters', names).descriptors
        kinds = {d.name: f' (type: {TYPES[d.type]})' for d in descriptors}
    for name in names:
        print(f'  {name}{kinds.get(name, "")}')


def get(options: argparse.Namespace) -> int:
    """Print the value of a parameter."""
    with session.node(options, discover=False) as looker:
        response = found_client(looker, options).ask('get_parameters', [options.parameter_name])
    if not response.values:
        raise RuntimeError('Parameter not set')
    value = response.values[0]
    if value.type == ParameterType.PARAMETER_NOT_SET:
        print('Parameter not set.')
        return 0
    content: Any = parameter_value_to_python(value)
    kind = TYPES[value.type]
    if kind.endswith('array'):
        content = list(content)
        label = f'{kind.removesuffix(" array").capitalize()} values are:'
    else:
        label = f'{kind.capitalize()} value is:'
    print(content) if options.hide_type else print(label, content)
    return 0


def set_parameter(options: argparse.Namespace) -> int:
    """Set a parameter from YAML text; the reason goes to stderr if the node refuses it."""
    value = get_parameter_value(options.value)
    with session.node(options, discover=False) as looker:
        client = found_client(looker, options)
        parameter = Parameter(
            options.parameter_name, Parameter.Type(value.type), parameter_value_to_python(value)
        )
        result = client.ask('set_parameters', [parameter]).results[0]
    reason = f': {result.reason}' if result.reason else ''
    if result.successful:
        print(f'Set parameter successful{reason}')
    else:
        # The real command's exit status is 0 here too.
        print(f'Setting parameter failed{reason}', file=sys.stderr)
    return 0


def describe(options: argparse.Namespace) -> int:
    """Print type, description and limits of parameters."""
    with session.node(options, discover=False) as looker:
        response = found_client(looker, options).ask(
            'describe_parameters', options.parameter_names
        )
    if not response.descriptors:
        raise RuntimeError(f'Parameter not declared: {", ".join(options.parameter_names)}')
    for descriptor in response.descriptors:
        print_descriptor(descriptor)
    return 0


def print_descriptor(descriptor: Any) -> None:
    """Print one descriptor as ``ros2 param describe`` does."""
    print('Parameter name:', descriptor.name)
    print('  Type:', TYPES[descriptor.type])
    if descriptor.description:
        print('  Description:', descriptor.description)
    print('  Constraints:')
    if descriptor.read_only:
        print('    Read only: true')
    for limits in [*descriptor.floating_point_range, *descriptor.integer_range][:1]:
        print('    Min value:', limits.from_value)
        print('    Max value:', limits.to_value)
        if limits.step:
            print('    Step:', limits.step)
    if descriptor.additional_constraints:
        print('    Additional constraints:', descriptor.additional_constraints)


def dump(options: argparse.Namespace) -> int:
    """Print all parameters of a node as a parameter file; dotted names become nested maps."""
    with session.node(options, discover=False) as looker:
        name = session.wait_for_node(looker, options.node_name, options.timeout)
        client = Client(looker, name)
        keys = sorted(client.ask('list_parameters').result.names)
        values = client.ask('get_parameters', keys).values
    tree: dict[str, Any] = {}
    for key, value in zip(keys, values, strict=True):
        *path, last = key.split('.')
        place = tree
        for part in path:
            place = place.setdefault(part, {})
        place[last] = parameter_value_to_python(value)
    print(yaml.dump({name: {'ros__parameters': tree}}, default_flow_style=False))
    return 0
