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

"""``ros2 node``: nodes of the graph."""

from __future__ import annotations

import argparse
import sys

from flexarm_ros.ros2_standin import session
from rclpy.action import (
    get_action_client_names_and_types_by_node,
    get_action_server_names_and_types_by_node,
)


def add_verbs(name: str, command: argparse.ArgumentParser) -> None:
    """Add the verbs of ``node``."""
    verbs = command.add_subparsers(title='Verbs', metavar='VERB')
    verb = verbs.add_parser('list', help='names of the nodes')
    session.add_options(verb)
    verb.add_argument('-a', '--all', action='store_true', help='hidden ones too')
    verb.add_argument('-c', '--count-nodes', action='store_true', help='only their number')
    verb.set_defaults(verb=list_nodes)
    verb = verbs.add_parser('info', help='topics and services of a node')
    session.add_options(verb)
    verb.add_argument('node_name')
    verb.add_argument('--include-hidden', action='store_true')
    verb.set_defaults(verb=info)


def list_nodes(options: argparse.Namespace) -> int:
    """Print the names, or the number, of the nodes."""
    with session.node(options) as looker:
        names = session.node_names(looker, options.all)
    if options.count_nodes:
        print(len(names))
        return 0
    if len(set(names)) < len(names):
        print(
            'WARNING: Be aware that there are nodes in the graph that share an exact name, which '
            'can have unintended side effects.',
            file=sys.stderr,
        )
    for name in names:
        print(name)
    return 0


def info(options: argparse.Namespace) -> int:
    """Print what a node reads, writes and serves."""
    name = session.absolute(options.node_name)
    with session.node(options) as looker:
        if not session.wait_until(
            looker, lambda: name in session.node_names(looker, True), session.PATIENCE_S
        ):
            raise RuntimeError(f"Unable to find node '{options.node_name}'")
        space, base = name.rsplit('/', 1)
        who = (base, space or '/')
        sections = {
            'Subscribers': looker.get_subscriber_names_and_types_by_node(*who),
            'Publishers': looker.get_publisher_names_and_types_by_node(*who),
            'Service Servers': looker.get_service_names_and_types_by_node(*who),
            'Service Clients': looker.get_client_names_and_types_by_node(*who),
            'Action Servers': get_action_server_names_and_types_by_node(looker, *who),
            'Action Clients': get_action_client_names_and_types_by_node(looker, *who),
        }
    print(name)
    for title, entries in sections.items():
        print(f'  {title}:')
        shown = [e for e in sorted(entries) if options.include_hidden or not session.hidden(e[0])]
        # An empty section is an empty line, as in the real command.
        print('\n'.join(f'    {entry}: {", ".join(types)}' for entry, types in shown))
    return 0
