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

"""``flexarm simulate``: simulate a scenario in one process, without ROS."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from flexarm_ros import scenario
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.signals import Deferred
from flexarm_ros.core.parameters.sections import RunConfig

if TYPE_CHECKING:
    from flexarm_ros.core.run.state import Block

Watch = Callable[[int, int], None]


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Simulate SCENARIO (a file or the name of a shipped one) in this process. '
        'Numbers and files are those of `flexarm run`, but ROS is not needed.',
        epilog='Exit status: 0; 1 if the arm becomes unstable; 2 for a bad scenario.',
    )
    parser.add_argument(
        'scenario', metavar='SCENARIO', nargs='?', help="a file or a shipped scenario's name"
    )
    parser.add_argument(
        '--set', dest='overrides', action='append', default=[], metavar='NODE.KEY=VALUE',
        help='override a parameter; may repeat; VALUE is YAML; without NODE: in section /**',
    )  # fmt: skip
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='output directory (default: runs/NAME)'
    )
    parser.add_argument('--no-bag', action='store_true', help='write no bag, only the other files')
    parser.add_argument('--no-pictures', action='store_true', help='write no figures')
    parser.add_argument(
        '--list-laws', action='store_true', help='print the names of the control laws and exit'
    )


def run(args: argparse.Namespace) -> int:
    """Simulate the scenario; return 0, 1 if unstable, 130, 143 or 129 after a signal."""
    if args.list_laws:
        return _list_laws()
    if args.scenario is None:
        raise UsageError('give a SCENARIO; `flexarm list` shows those that are shipped')
    from flexarm_ros.bag.simulation import simulate
    from flexarm_ros.cli.options.output import new_directory, show_outcome
    from flexarm_ros.cli.options.progress import Progress

    config = scenario.load(args.scenario, args.overrides)
    name = Path(args.scenario).stem
    directory = new_directory(args.out, name)
    run_case = _without_bag if args.no_bag else simulate
    with Deferred() as signals, Progress(config, name) as progress:
        summary = run_case(
            config, directory, name, watch=progress.update, stop=lambda: bool(signals.signum)
        )
    if summary['stable'] is None and not signals.signum:
        print(f'flexarm simulate: {summary["problem"]}', file=sys.stderr)
    show_outcome(directory, summary, pictures=not args.no_pictures)
    if signals.signum:
        return signals.status
    return 0 if summary['stable'] else 1


def _without_bag(
    config: RunConfig, directory: Path, name: str, watch: Watch, stop: Callable[[], bool]
) -> dict[str, Any]:
    """Simulate without a bag, writing ``trajectory.csv`` and ``summary.json`` during the run."""
    from flexarm_ros.bag import outputs
    from flexarm_ros.bag.provenance import Provenance
    from flexarm_ros.bag.recording import prepare_directory
    from flexarm_ros.core.run.loop import ClosedLoop
    from flexarm_ros.core.run.loop_blocks import loop_blocks

    loop = ClosedLoop(config)
    prepare_directory(directory, config, name)
    wall_s = 0.0

    def blocks() -> Iterator[Block]:
        nonlocal wall_s
        source = loop_blocks(loop)
        while not stop():
            start = time.perf_counter()
            block = next(source, None)
            wall_s += time.perf_counter() - start
            if block is None:
                return
            yield block
            watch(loop.k, loop.timeline.ticks)

    metrics = outputs.write_trajectory(directory, config, blocks())
    unstable = None
    if loop.unstable is not None and loop.unstable_tick is not None:
        unstable = (loop.unstable_tick, loop.unstable)
    cut = unstable is None and loop.k < loop.timeline.ticks
    problem = f'interrupted at tick {loop.k}' if cut else ''
    provenance = Provenance.here(name)
    summary = outputs.summary_of(config, metrics, provenance, wall_s, unstable, problem)
    outputs.write_summary(directory, summary)
    return summary


def _list_laws() -> int:
    from flexarm_ros.core.control import BUILT_IN
    from flexarm_ros.scenario.plugins.registry import installed_laws

    for name in (*BUILT_IN, *sorted(installed_laws())):
        print(name)
    return 0
