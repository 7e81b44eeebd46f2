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

"""Parameters of the node ``player``: declared, read and checked."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

from flexarm_ros.nodes.parameters import assignments, OF_ROS, Own
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

MOST = 1e6
"""Largest value of a parameter that is a number."""

PARAMETERS = {
    'bag': Own('', 'the run: its directory, or the bag in it'),
    'rate': Own(
        1.0, 'multiple of real time; 0: as fast as it goes; may change while playing', high=MOST,
        live=True,
    ),
    'start': Own(0.0, 'simulated time to start from', 's', high=MOST),
    'loop': Own(False, 'start again at the end'),
    'paused': Own(False, 'wait for the service ~/resume or ~/play_next before the first tick'),
    'topics': Own('', 'topics to publish beside /clock, comma separated; empty: all'),
    'without': Own(
        '', 'controller: leave the torque to another node, in lock-step; empty: play it too'
    ),
    'delay': Own(
        1.0, 'wall time to wait for subscribers before the first message', 's', high=MOST
    ),
    'tick_timeout': Own(
        5.0, 'wall time that the controller may take to answer a tick', 's', high=MOST
    ),
    'scenario': Own('', 'the scenario of a bag that has none: a file or a shipped name'),
    'set': Own('', 'changes of parameters of `scenario`, NODE.KEY=VALUE, separated by semicolons'),
    'namespace': Own('', "the run's namespace in a bag of another recorder; empty: the only one"),
}  # fmt: skip


class PlayerError(Exception):
    """A parameter of the player that cannot be; one line."""


@dataclass(frozen=True)
class PlayerOptions:
    """What the player is to do; see `PARAMETERS` for the fields."""

    bag: str
    rate: float
    start: float
    loop: bool
    paused: bool
    topics: tuple[str, ...]
    without: str
    delay: float
    tick_timeout: float
    scenario: str
    set: tuple[str, ...]
    namespace: str


def declare(node: Node, argv: list[str]) -> PlayerOptions:
    """
    Declare the parameters on ``node`` and return their values.

    Integers are taken where a number is due.  Raises PlayerError, one line.
    """
    for name, _ in assignments(argv, node.get_name()):
        if name not in PARAMETERS and not name.startswith(OF_ROS):
            raise PlayerError(f"unknown parameter '{name}' (allowed: {', '.join(PARAMETERS)})")
    values: dict[str, Any] = {}
    for name, own in PARAMETERS.items():
        descriptor = own.describe()
        descriptor.dynamic_typing = True  # rcl tells 2 from 2.0; the user need not
        # Limits only after the check: rclpy's own words for a value outside name no parameter.
        free = ParameterDescriptor(dynamic_typing=True)
        value = node.declare_parameter(name, own.default, free).value
        values[name] = _checked(name, value, own.default)
        node.set_descriptor(name, descriptor)
    values['topics'] = _split(values['topics'], ',')
    values['set'] = _split(values['set'], ';')
    options = PlayerOptions(**values)
    if not options.bag:
        raise PlayerError("bag: missing; give a run's directory or the bag in it")
    if options.without not in ('', 'controller'):
        raise PlayerError(f"without: '{options.without}' is not allowed: controller, or empty")
    if options.without and options.loop:
        raise PlayerError('loop: true is not allowed with without: a controller runs once')
    if options.set and not options.scenario:
        raise PlayerError('set: needs scenario')
    return options


def _split(text: str, separator: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(separator) if word.strip())


def number(name: str, value: Any) -> float:
    """Return a parameter that is a number from 0 to `MOST`; PlayerError if it is none."""
    fits = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not fits or not math.isfinite(value) or not 0.0 <= value <= MOST:
        raise PlayerError(f'{name}: {value!r} is not allowed: a number from 0 to {MOST:g}')
    return float(value)


def _checked(name: str, value: Any, default: Any) -> Any:
    if isinstance(default, float):
        return number(name, value)
    if not isinstance(value, type(default)):
        kind = 'true or false' if isinstance(default, bool) else 'a text'
        raise PlayerError(f'{name}: {value!r} is not allowed: {kind}')
    return value
