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

"""Parameters of the node ``player``: declaration, reading and checks."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.nodes.runtime.parameters.declared import declare_own
from flexarm_ros.nodes.runtime.parameters.own import OWN
from flexarm_ros.scenario import ScenarioError
from rclpy.node import Node


class PlayerError(Exception):
    """An invalid parameter of the player; one line."""


@dataclass(frozen=True)
class PlayerOptions:
    """Settings of the player; see `OWN` for the fields."""

    bag: str
    rate: float
    start: float
    loop: bool
    paused: bool
    playback_duration: float
    topics: tuple[str, ...]
    exclude: tuple[str, ...]
    without: str
    timing: str
    delay: float
    tick_timeout: float
    scenario: str
    set: tuple[str, ...]
    namespace: str


def declare(node: Node, argv: list[str]) -> PlayerOptions:
    """
    Declare the parameters on ``node`` and return their values.

    Integers are accepted for numbers.  Raises PlayerError, one line.
    """
    try:
        values = declare_own(node, 'player', OWN['player'], argv, in_run=False)
    except ScenarioError as error:
        raise PlayerError(str(error)) from None
    node.describe_parameter('rate').dynamic_typing = True  # set: an integer will do
    for name in ('topics', 'exclude'):
        values[name] = _split(values[name], ',')
    values['set'] = _split(values['set'], ';')
    options = PlayerOptions(**values)
    if not options.bag:
        raise PlayerError("bag: missing; give a run's directory or the bag in it")
    if options.without not in ('', 'controller'):
        raise PlayerError(f"without: '{options.without}' is not allowed: controller, or empty")
    if options.timing not in ('even', 'recorded'):
        raise PlayerError(f"timing: '{options.timing}' is not allowed: even, or recorded")
    if options.without and options.loop:
        raise PlayerError('loop: true is not allowed with without: a controller runs once')
    if options.set and not options.scenario:
        raise PlayerError('set: needs scenario')
    return options


def _split(text: str, separator: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(separator) if word.strip())
