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
A run whose nodes are started by `ros2 launch`: arguments, progress, final table.

The counterpart is ``launch/run.launch.py``, which imports launch; this module does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import os
from pathlib import Path
import shlex
import sys
from typing import NamedTuple

from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.recording import default_name, prepare_directory
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options import namespace
from flexarm_ros.cli.options.domain import chosen_domain
from flexarm_ros.cli.options.output import new_directory, show_outcome
from flexarm_ros.cli.options.progress import Progress
from flexarm_ros.launcher.reports import RunWatch
from flexarm_ros.launcher.run import (
    dispensable,
    finish,
    own_arguments,
    Reported,
    write_resolved,
)
from flexarm_ros.wire.fused_step import warm_up_nodes


class Argument(NamedTuple):
    """A launch argument."""

    default: str
    description: str


ARGUMENTS = {
    'scenario': Argument(
        'fls_tip',
        'a parameter file, or the name of a shipped scenario; `ros2 launch` exits with status 1 '
        'if the run fails, is unstable or is interrupted',
    ),
    'set': Argument(
        '',
        'parameters to override, as for `flexarm run --set`, separated by spaces: '
        'set:="plant.payload_mass=1 controller.kp=80"; quote a value that contains spaces',
    ),
    'out': Argument(
        '',
        'directory of the run, new or empty; empty: a new one, runs/SCENARIO or '
        'runs/NAMESPACE-SCENARIO',
    ),
    'namespace': Argument('', 'namespace of all nodes and topics'),
    'rtf': Argument(
        '0.0', 'limit the run to this multiple of real time; 0.0: as set in the scenario'
    ),
}
"""Name -> default and description of the arguments of ``run.launch.py``."""


class LaunchedRun:
    """
    A run that is ready to be started and watched.

    ``given`` has a text for each of `ARGUMENTS`; ``around`` is the namespace pushed by the
    including launch files.  Raises ScenarioError, UsageError, BagError or OSError (one line)
    before anything is started if they are unusable.
    """

    def __init__(self, given: Mapping[str, str], around: str = '') -> None:
        self.config = scenario.load(given['scenario'], split_overrides(given['set']))
        rtf = read_rtf(given['rtf'])
        chosen_domain(None)
        self.name = Path(given['scenario']).stem
        # The shell does not expand a tilde after :=.
        out = Path(os.path.expanduser(given['out'])) if given['out'] else None
        inner = namespace.checked(given['namespace'], 'namespace:=')
        space = inner if given['namespace'].startswith('/') else around + inner
        self.directory = new_directory(out, default_name(self.name, space), option='out:=')
        prepare_directory(self.directory, self.config, self.name)
        self.nodes = RunWatch(self.directory / 'logs')
        self._scenario = write_resolved(self.directory, self.config)
        pace = self.config.pace
        pace = replace(pace, real_time_factor=rtf or pace.real_time_factor)
        self._own = own_arguments(self.directory, self.name, pace)
        self.nodes.dispensable = dispensable(self.config)
        self._progress = Progress(self.config, self.name)
        progress = self._progress
        self._reported = Reported(progress.update, progress.say, progress.timing)
        self._total = round(self.config.run.duration / self.config.run.control_period)
        warm_up_nodes(self.config)  # once, before all processes do it at the same time

    def ros_arguments(self, role: str) -> list[str]:
        """Return the arguments after ``--ros-args`` for the node ``role``."""
        return ['--params-file', str(self._scenario), *self._own.get(role, [])]

    def look(self) -> None:
        """Process the nodes' reports and show progress; call this often."""
        self.nodes.take_reports()
        if not self.nodes.ending:
            self._reported(self.nodes, self._total)

    def finish(self, interrupted: bool) -> str:
        """
        Write the files of a run whose nodes have all exited, and print the metrics.

        Returns the reason of a failure in one line, empty on success.
        """
        self.nodes.close()
        try:
            outcome = finish(self.directory, self.config, self.name, self.nodes, interrupted)
        except (BagError, OSError) as error:
            return str(error)
        show_outcome(self.directory, outcome.summary)
        sys.stdout.flush()
        return outcome.problem


def split_overrides(text: str) -> list[str]:
    """Return the assignments in ``text``, split as a shell does; UsageError if it cannot be."""
    try:
        return shlex.split(text)
    except ValueError as error:
        raise UsageError(f'set:={text}: {str(error).lower()}') from None


def read_rtf(text: str) -> float:
    """Return a multiple of real time; UsageError unless a number of at least 0."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value < 1e6:
        raise UsageError(f'rtf:={text}: not a number from 0 to 1e6')
    return value
