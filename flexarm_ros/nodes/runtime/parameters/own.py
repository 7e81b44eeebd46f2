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

"""All parameters of nodes that are not part of a scenario."""

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
    """A parameter of a node outside scenarios: text, number or bool."""

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
        """Return a given value; every text is valid for a text.  Raises ScenarioError."""
        if isinstance(self.default, str) and isinstance(tree, Scalar):
            return tree.text
        value: str | bool | int | float = convert(name, self.spec, tree)
        return value


def how_to_go_on(plant: str) -> str:
    """Return the command that starts or resumes the run of ``plant`` (full node name)."""
    return f"ros2 service call {plant}/pause std_srvs/srv/SetBool '{{data: false}}'"


OWN = {
    'plant': {
        **{
            key: Own(default, spec.doc, spec.unit, spec.low, spec.high, spec.live)
            for key, (_, spec, default) in specs(PaceParameters).items()
        },
        'hold_at': Own(
            '', 'ticks before which the plant waits for the launcher, comma separated'
        ),
    },
    'recorder': {
        'output': Own('', 'output directory of the run; empty: a new directory below runs/'),
        'name': Own('', 'name of the scenario, recorded in the bag'),
    },
    'player': {
        'bag': Own('', 'recorded run: output directory, bag directory or bag file'),
        'rate': Own(
            1.0, 'playback speed as a multiple of real time; 0: as fast as possible',
            low=0.0, high=FASTEST, live=True,
        ),
        'start': Own(0.0, 'simulated time at which playback starts', 's', low=0.0, high=FASTEST),
        'loop': Own(False, 'restart playback at its end'),
        'paused': Own(
            False, 'start paused: wait for the service ~/resume or ~/play_next'
        ),
        # Not "duration": a scenario has that under /**, which holds for the player too.
        'playback_duration': Own(
            -1.0, 'simulated duration of playback from `start` on; negative: to the end', 's',
            low=-FASTEST, high=FASTEST,
        ),
        'topics': Own('', 'topics to publish in addition to /clock, comma separated; empty: all'),
        'exclude': Own('', 'topics that are not published, comma separated; may include /clock'),
        'without': Own(
            '', '`controller`: an external controller computes the torque, in lock-step; empty: '
            'the recorded torque is published'
        ),
        'timing': Own(
            'even', 'even: ticks at equal intervals; recorded: ticks and torques at the wall '
            'times of a free-running run'
        ),
        'delay': Own(
            1.0, 'wall time to wait for subscribers before the first message', 's', low=0.0,
            high=FASTEST,
        ),
        'tick_timeout': Own(
            5.0, 'wall time within which the controller must answer a tick', 's', low=0.0,
            high=FASTEST,
        ),
        'scenario': Own(
            '', 'scenario of a bag without one: a file or the name of a shipped scenario'
        ),
        'set': Own(
            '', 'overrides of parameters of `scenario`: NODE.KEY=VALUE, separated by semicolons'
        ),
        'namespace': Own(
            '', 'namespace of the run in a bag written by another recorder; empty: the only '
            'namespace in the bag, or that of the player'
        ),
    },
    'viewer': {
        'rate': Own(
            30.0, 'maximum number of frames per second of wall time', 'Hz', low=0.1, high=1000.0
        ),
        'host': Own('127.0.0.1', 'address that the page and the WebSocket server listen on'),
        'port': Own(
            8764, 'port of the page for browsers; 0: a free one; -1: none', low=-1, high=65535
        ),
        'foxglove_port': Own(
            8765, 'port of the WebSocket server for Foxglove; 0: a free one; -1: none', low=-1,
            high=65535,
        ),
        'trail': Own(600, 'frames of the path of the tip that are shown', low=2, high=100000),
    },
}  # fmt: skip
"""Role -> its parameters."""
