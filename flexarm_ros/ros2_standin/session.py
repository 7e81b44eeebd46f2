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

"""A short-lived node that reads the graph."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import os
import time

from flexarm_ros.ros2_standin.frame import Terminated
import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter

# A participant announces itself every 3 s, and the faster announcements at its start may be
# missed; there is no daemon here that has listened before.
DISCOVERY_S = 3.5  # for verbs that list what there is
PATIENCE_S = 5.0  # at most, for verbs that name something: until it is there


def add_options(verb: argparse.ArgumentParser) -> None:
    """Add the options that every verb with a node has."""
    verb.add_argument(
        '--spin-time',
        type=float,
        default=DISCOVERY_S,
        metavar='S',
        help='seconds to wait for discovery (default %(default)s)',
    )
    verb.add_argument('-s', '--use-sim-time', action='store_true', help='use simulation time')


@contextmanager
def node(options: argparse.Namespace, discover: bool = True) -> Iterator[Node]:
    """Yield a hidden node, after the time for discovery unless `discover` is false."""
    rclpy.init(args=[])
    try:
        found = rclpy.create_node(
            f'_ros2cli_{os.getpid()}',
            start_parameter_services=False,
            enable_rosout=False,
            parameter_overrides=[Parameter('use_sim_time', value=options.use_sim_time)],
        )
        if discover:
            wait_until(found, lambda: False, options.spin_time)
        yield found
    except ExternalShutdownException:
        raise Terminated from None
    finally:
        rclpy.try_shutdown()


def wait_until(looker: Node, done: Callable[[], bool], seconds: float) -> bool:
    """Spin until `done`, at most for the given seconds; return whether it is done."""
    end = time.monotonic() + seconds
    while True:
        if not rclpy.ok():
            raise ExternalShutdownException
        if done():
            return True
        left = end - time.monotonic()
        if left <= 0:
            return False
        rclpy.spin_once(looker, timeout_sec=min(left, 0.05))


def hidden(name: str) -> bool:
    """Return whether a part of a graph name starts with an underscore."""
    return any(part.startswith('_') for part in name.split('/'))


def absolute(name: str) -> str:
    """Return a node or topic name with its leading slash."""
    return name if name.startswith('/') else '/' + name


def node_names(looker: Node, everything: bool = False) -> list[str]:
    """Return the full names of the nodes in the graph, sorted, repeated ones too."""
    pairs: list[tuple[str, str]] = looker.get_node_names_and_namespaces()
    names = sorted(f'{space.rstrip("/")}/{name}' for name, space in pairs)
    return [name for name in names if everything or not hidden(name)]


def wait_for_node(looker: Node, name: str, seconds: float) -> str:
    """Return the full name of a node once it is in the graph; RuntimeError if it is not there."""
    full = absolute(name)
    if not wait_until(looker, lambda: full in node_names(looker, everything=True), seconds):
        raise RuntimeError('Node not found')
    return full
