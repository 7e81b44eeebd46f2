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

"""Parameters of a node that are no part of a scenario: every one of every node."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.sections import PaceParameters, Spec, specs
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import Scalar, Tree

FASTEST = 1e6
"""Largest multiple of real time, and largest number of seconds."""

_KINDS = {float: 'float', int: 'int', bool: 'bool', str: 'str'}


@dataclass(frozen=True)
class Own:
    """A parameter of one node that is no part of a scenario: text, number or true or false."""

    default: str | bool | int | float
    doc: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    live: bool = False

    @property
    def spec(self) -> Spec:
        """Return what is allowed, as for a key of a scenario."""
        kind = _KINDS[type(self.default)]
        return Spec(kind, self.unit, self.doc, low=self.low, high=self.high, live=self.live)

    def read(self, name: str, tree: Tree) -> str | bool | int | float:
        """Return a value that was given; any text will do.  Raises ScenarioError."""
        if isinstance(self.default, str) and isinstance(tree, Scalar):
            return tree.text
        value: str | bool | int | float = convert(name, self.spec, tree)
        return value


def how_to_go_on(plant: str) -> str:
    """Return what lets the run of the node ``plant``, with its namespace, begin or go on."""
    return f"ros2 service call {plant}/pause std_srvs/srv/SetBool '{{data: false}}'"


OWN = {
    'plant': {
        **{
            key: Own(default, spec.doc, spec.unit, spec.low, spec.high, spec.live)
            for key, (_, spec, default) in specs(PaceParameters).items()
        },
        'hold_at': Own(
            '', 'ticks, comma separated, before which the launcher has something to do'
        ),
    },
    'recorder': {
        'output': Own('', 'directory of the run; empty: a new one below runs/'),
        'name': Own('', 'name of the scenario, for the record'),
    },
    'player': {
        'bag': Own('', 'the run: its directory, or the bag in it'),
        'rate': Own(
            1.0, 'multiple of real time; 0: as fast as it goes; may change while playing',
            low=0.0, high=FASTEST, live=True,
        ),
        'start': Own(0.0, 'simulated time to start from', 's', low=0.0, high=FASTEST),
        'loop': Own(False, 'start again at the end'),
        'paused': Own(
            False, 'wait for the service ~/resume or ~/play_next before the first tick'
        ),
        # Not "duration": a scenario has that under /**, which holds for the player too.
        'playback_duration': Own(
            -1.0, 'simulated time to play from start on; below 0: to the end', 's', low=-FASTEST,
            high=FASTEST,
        ),
        'topics': Own('', 'topics to publish beside /clock, comma separated; empty: all'),
        'exclude': Own('', 'topics not to publish, comma separated; /clock may be one'),
        'without': Own(
            '', 'controller: leave the torque to another node, in lock-step; empty: play it too'
        ),
        'delay': Own(
            1.0, 'wall time to wait for subscribers before the first message', 's', low=0.0,
            high=FASTEST,
        ),
        'tick_timeout': Own(
            5.0, 'wall time that the controller may take to answer a tick', 's', low=0.0,
            high=FASTEST,
        ),
        'scenario': Own('', 'the scenario of a bag that has none: a file or a shipped name'),
        'set': Own('', 'changes of its parameters, NODE.KEY=VALUE, separated by semicolons'),
        'namespace': Own(
            '', 'namespace of the run in a bag of another recorder; empty: the only one, or that '
            'of the player'
        ),
    },
    'viewer': {
        'rate': Own(
            30.0, 'frames a second of wall time at most', 'Hz', low=0.1, high=1000.0
        ),
        'host': Own('127.0.0.1', 'address that the page and the WebSocket server listen on'),
        'port': Own(
            8764, 'port of the page for browsers; 0: a free one; -1: none', low=-1, high=65535
        ),
        'foxglove_port': Own(
            8765, 'port of the WebSocket server for Foxglove; 0: a free one; -1: none', low=-1,
            high=65535,
        ),
        'trail': Own(600, "frames of the tip's trail that are shown", low=2, high=100000),
    },
}  # fmt: skip
"""Role -> its parameters."""
