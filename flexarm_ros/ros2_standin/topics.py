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

"""``ros2 topic``: topics, their messages and rates."""

from __future__ import annotations

import argparse
from collections import deque
import statistics
from typing import Any

from flexarm_ros.ros2_standin import session, values
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile, ReliabilityPolicy


def add_verbs(name: str, command: argparse.ArgumentParser) -> None:
    """Add the verbs of ``topic``."""
    verbs = command.add_subparsers(title='Verbs', metavar='VERB')
    verb = verbs.add_parser('list', help='names of the topics')
    session.add_options(verb)
    verb.add_argument('-t', '--show-types', action='store_true')
    verb.add_argument('-c', '--count-topics', action='store_true')
    verb.add_argument('--include-hidden-topics', action='store_true')
    verb.set_defaults(verb=list_topics)
    for word, text, function in (
        ('type', 'type of a topic', print_type),
        ('info', 'publishers and subscriptions of a topic', info),
        ('hz', 'rate of a topic', hz),
        ('echo', 'messages of a topic', echo),
    ):
        verb = verbs.add_parser(word, help=text)
        session.add_options(verb)
        verb.add_argument('topic_name')
        verb.set_defaults(verb=function)
        if word == 'info':
            verb.add_argument('-v', '--verbose', action='store_true', help='each endpoint')
        elif word == 'hz':
            verb.add_argument('-w', '--window', type=int, default=10000, help='messages averaged')
        elif word == 'echo':
            add_echo_options(verb)


def add_echo_options(verb: argparse.ArgumentParser) -> None:
    """Add the options of ``topic echo``."""
    verb.add_argument('message_type', nargs='?')
    verb.add_argument('--once', action='store_true', help='print one message and exit')
    verb.add_argument('--timeout', type=float, metavar='N', help='exit after N seconds')
    verb.add_argument('--field', help='a field of the message: pose.pose.position')
    verb.add_argument('--csv', action='store_true', help='all fields, separated by commas')
    verb.add_argument('--no-arr', action='store_true', help='leave arrays out')
    verb.add_argument('--flow-style', action='store_true')
    verb.add_argument('-f', '--full-length', action='store_true', help='arrays in full')
    verb.add_argument('-l', '--truncate-length', type=int, default=128, metavar='N')
    verb.add_argument('--qos-reliability', choices=('reliable', 'best_effort'))
    verb.add_argument('--qos-durability', choices=('volatile', 'transient_local'))


def topics(looker: Node, everything: bool = True) -> dict[str, list[str]]:
    """Return ``{name: types}`` of the topics in the graph, sorted by name."""
    pairs = sorted(looker.get_topic_names_and_types())
    return {name: types for name, types in pairs if everything or not session.hidden(name)}


def wait_for_topic(looker: Node, name: str) -> list[str]:
    """Return the types of a topic once it is in the graph; none if it does not come in time."""
    session.wait_until(looker, lambda: name in topics(looker), session.PATIENCE_S)
    return topics(looker).get(name, [])


def list_topics(options: argparse.Namespace) -> int:
    """Print the names of the topics."""
    with session.node(options) as looker:
        found = topics(looker, options.include_hidden_topics)
    if options.count_topics:
        print(len(found))
        return 0
    for name, types in found.items():
        print(f'{name} [{", ".join(types)}]' if options.show_types else name)
    return 0


def print_type(options: argparse.Namespace) -> int:
    """Print the type of a topic; 1 if there is no such topic."""
    with session.node(options, discover=False) as looker:
        types = wait_for_topic(looker, session.absolute(options.topic_name))
    for name in types:
        print(name)
    return 0 if types else 1


def info(options: argparse.Namespace) -> int:
    """Print the type of a topic and how many write and read it."""
    name = session.absolute(options.topic_name)
    with session.node(options) as looker:
        types = wait_for_topic(looker, name)
        if not types:
            raise RuntimeError(f"Unknown topic '{options.topic_name}'")
        writers = looker.get_publishers_info_by_topic(name)
        readers = looker.get_subscriptions_info_by_topic(name)
    end = '\n\n' if options.verbose else '\n'
    print(f'Type: {types[0] if len(types) == 1 else types}', end=end)
    for title, endpoints in (('Publisher', writers), ('Subscription', readers)):
        print(f'{title} count: {len(endpoints)}', end=end)
        for endpoint in endpoints if options.verbose else ():
            print(endpoint, end=end)
    return 0


def message_class(looker: Node, topic: str, name: str | None = None) -> Any:
    """Return the class of a topic's messages, from the graph unless its name is given."""
    if name is None:
        types = wait_for_topic(looker, topic)
        if not types:
            print(f'WARNING: topic [{topic}] does not appear to be published yet')
            raise RuntimeError('Could not determine the type for the passed topic')
        if len(types) > 1:
            raise RuntimeError(f"Cannot echo topic '{topic}', as it contains more than one type")
        name = types[0]
    return values.interface(name, 'msg')


def fitting_qos(looker: Node, topic: str, options: argparse.Namespace) -> QoSProfile:
    """Return a profile that matches every publisher: as strict as all of them are."""
    offered = [end.qos_profile for end in looker.get_publishers_info_by_topic(topic)]
    reliable = bool(offered) and all(q.reliability == ReliabilityPolicy.RELIABLE for q in offered)
    latched = bool(offered) and all(
        q.durability == DurabilityPolicy.TRANSIENT_LOCAL for q in offered
    )
    if options.qos_reliability is not None:
        reliable = options.qos_reliability == 'reliable'
    if options.qos_durability is not None:
        latched = options.qos_durability == 'transient_local'
    return QoSProfile(
        depth=qos_profile_sensor_data.depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def echo(options: argparse.Namespace) -> int:
    """Print the messages of a topic as they come."""
    topic = session.absolute(options.topic_name)
    limit = None if options.full_length else options.truncate_length
    printed = 0

    def show(message: Any) -> None:
        nonlocal printed
        if options.once and printed:
            return
        printed += 1
        chosen = message if options.field is None else values.field(message, options.field)
        content = values.plain(chosen, limit, not options.no_arr)
        if options.csv:
            print(','.join(str(leaf) for leaf in values.leaves(content)))
        else:
            print(values.as_yaml(content, options.flow_style), end='---\n')

    with session.node(options, discover=False) as looker:
        kind = message_class(looker, topic, options.message_type)
        looker.create_subscription(kind, topic, show, fitting_qos(looker, topic, options))
        forever = float('inf') if options.timeout is None else options.timeout
        session.wait_until(looker, lambda: options.once and printed > 0, forever)
    return 0


def hz(options: argparse.Namespace) -> int:
    """Print the rate of a topic once a second."""
    topic = session.absolute(options.topic_name)
    periods: deque[float] = deque(maxlen=options.window)
    last: float | None = None

    def arrived(message: Any) -> None:
        nonlocal last
        now = looker.get_clock().now().nanoseconds * 1e-9
        if last is not None:
            periods.append(now - last)
        last = now

    with session.node(options, discover=False) as looker:
        if not wait_for_topic(looker, topic):
            print(f'WARNING: topic [{topic}] does not appear to be published yet')
            session.wait_until(looker, lambda: topic in topics(looker), float('inf'))
        kind = message_class(looker, topic)
        looker.create_subscription(kind, topic, arrived, qos_profile_sensor_data, raw=True)
        shown = last
        while rclpy.ok():
            session.wait_until(looker, lambda: False, 1.0)
            if periods and shown != last:
                print_rate(periods)
            shown = last
    return 0


def print_rate(periods: deque[float]) -> None:
    """Print the statistics of a window of periods, s."""
    mean = statistics.fmean(periods)
    print(
        f'average rate: {1.0 / mean if mean > 0 else 0.0:.3f}\n'
        f'\tmin: {min(periods):.3f}s max: {max(periods):.3f}s '
        f'std dev: {statistics.pstdev(periods, mean):.5f}s window: {len(periods)}'
    )
