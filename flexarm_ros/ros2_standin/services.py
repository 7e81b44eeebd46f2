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

"""``ros2 service``: list and call services."""

from __future__ import annotations

import argparse
from typing import Any

from flexarm_ros.ros2_standin import session, values
import yaml


def add_verbs(name: str, command: argparse.ArgumentParser) -> None:
    """Add the verbs of ``service``."""
    verbs = command.add_subparsers(title='Verbs', metavar='VERB')
    verb = verbs.add_parser('list', help='names of the services')
    session.add_options(verb)
    verb.add_argument('-t', '--show-types', action='store_true')
    verb.add_argument('-c', '--count-services', action='store_true')
    verb.add_argument('--include-hidden-services', action='store_true')
    verb.set_defaults(verb=list_services)
    verb = verbs.add_parser('type', help='type of a service')
    session.add_options(verb)
    verb.add_argument('service_name')
    verb.set_defaults(verb=print_type)
    verb = verbs.add_parser('call', help='call a service')
    session.add_options(verb)
    verb.add_argument('service_name')
    verb.add_argument('service_type')
    verb.add_argument('values', nargs='?', default='{}', help="request as YAML: '{data: true}'")
    verb.set_defaults(verb=call)


def list_services(options: argparse.Namespace) -> int:
    """Print the names of the services."""
    with session.node(options) as looker:
        found = [
            (name, types)
            for name, types in sorted(looker.get_service_names_and_types())
            if options.include_hidden_services or not session.hidden(name)
        ]
    if options.count_services:
        print(len(found))
        return 0
    for name, types in found:
        print(f'{name} [{", ".join(types)}]' if options.show_types else name)
    return 0


def print_type(options: argparse.Namespace) -> int:
    """Print the type of a service; 1 if there is no such service."""
    name = session.absolute(options.service_name)
    with session.node(options, discover=False) as looker:
        session.wait_until(
            looker, lambda: name in dict(looker.get_service_names_and_types()), session.PATIENCE_S
        )
        types = dict(looker.get_service_names_and_types()).get(name, [])
    for kind in types:
        print(kind)
    return 0 if types else 1


def call(options: argparse.Namespace) -> int:
    """Call a service and print its answer; waits until the service is there."""
    kind = values.interface(options.service_type, 'srv')
    if not hasattr(kind, 'Request'):
        raise RuntimeError('The passed type is not a service')
    request = kind.Request()
    try:
        content = yaml.safe_load(options.values)
    except yaml.YAMLError as error:
        raise RuntimeError(f'The passed value needs to be YAML: {error}') from None
    if content is not None and not isinstance(content, dict):
        raise RuntimeError('The passed value needs to be a dictionary in YAML format')
    values.fill(request, content)
    with session.node(options, discover=False) as looker:
        client: Any = looker.create_client(kind, options.service_name)
        if not client.service_is_ready():
            print('waiting for service to become available...')
            session.wait_until(looker, client.service_is_ready, float('inf'))
        print(f'requester: making request: {request!r}\n')
        future = client.call_async(request)
        session.wait_until(looker, future.done, float('inf'))
        print(f'response:\n{future.result()!r}\n')
    return 0
