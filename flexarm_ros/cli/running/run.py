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

"""``flexarm run``: run a scenario as ROS 2 nodes in lock-step and record it."""

from __future__ import annotations

import argparse
from contextlib import AbstractContextManager, nullcontext
import importlib.util
from pathlib import Path
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.recording import default_name
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options import domain, namespace, page
from flexarm_ros.cli.options.own_nodes import add_option, check_roles, own_nodes
from flexarm_ros.cli.signals import Deferred

_NO_ROS = (
    'rclpy is not installed: run `make env` (x86_64 Linux), or source a ROS 2 installation; '
    '`flexarm simulate` needs no ROS'
)


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Run SCENARIO (a file or the name of a shipped one) with one process per '
        'node, in lock-step on one simulated clock, and record every message in a bag.',
    )
    parser.add_argument('scenario', metavar='SCENARIO', help="a file or a shipped scenario's name")
    parser.add_argument(
        '--set', dest='overrides', action='append', default=[], metavar='NODE.KEY=VALUE',
        help='override a parameter; may repeat; VALUE is YAML; without NODE: in section /**',
    )  # fmt: skip
    parser.add_argument(
        '--out',
        type=Path,
        metavar='DIR',
        help='output directory (default: runs/NAME, or runs/NS-NAME)',
    )
    parser.add_argument(
        '--rtf', type=_positive, default=0.0, metavar='X',
        help='limit the run to X times real time (default: /**.real_time_factor); with '
        '--set sync=free: its speed (default 1)',
    )  # fmt: skip
    parser.add_argument('--compose', action='store_true', help='run all nodes in one process')
    domain.add_option(parser, 'a free one')
    namespace.add_option(
        parser, 'namespace of all nodes and topics but /clock; also to be set in a --node command'
    )
    parser.add_argument(
        '--without', action='append', default=[], metavar='NODE',
        help='do not start NODE, an external node replaces it; may repeat (a part of the scenario '
        'except plant and recorder: flexarm list --parts)',
    )  # fmt: skip
    add_option(parser)
    parser.add_argument(
        '--network', action='store_true',
        help='allow nodes on other machines (default: this machine only)',
    )  # fmt: skip
    page.add_options(parser)
    parser.add_argument('--no-pictures', action='store_true', help='write no figures')


def run(args: argparse.Namespace) -> int:
    """Run the scenario; return 0, 1 if failed or unstable, 130, 143 or 129 after a signal."""
    from flexarm_ros.cli.options.output import new_directory, show_outcome
    from flexarm_ros.cli.options.progress import Progress

    config = scenario.load(args.scenario, args.overrides)
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError(_NO_ROS)
    from flexarm_ros.launcher.run import run_scenario, RunOptions

    check_roles('--without', args.without, config)
    nodes = own_nodes(args.nodes, [config])
    if args.view:
        page.check_port(args.port)
    name = Path(args.scenario).stem
    chosen = domain.chosen_domain(args.domain)
    space = namespace.checked(args.namespace)
    directory = new_directory(args.out, default_name(name, space))
    options = RunOptions(
        compose=args.compose,
        rtf=args.rtf or (1.0 if args.view and not config.pace.real_time_factor else 0.0),
        attended=True,
        namespace=space,
        domain=chosen,
        without=tuple(args.without),
        nodes=nodes,
        discovery='SUBNET' if args.network else 'LOCALHOST',
    )
    told: list[str] = []
    with Deferred() as signals, Progress(config, name) as progress:

        def verdict(text: str) -> None:
            progress.say(f'flexarm run: {text}')
            told.append(text)

        def beside(domain: int) -> AbstractContextManager[None]:
            if not args.view:
                return nullcontext()
            return page.page_beside(domain, space, args.port, progress.say)

        outcome = run_scenario(
            config, name, directory, options,
            announce=progress.say, watch=progress.update, stop=lambda: bool(signals.signum),
            verdict=verdict, work=progress.work, beside=beside, timing=progress.timing,
        )  # fmt: skip
    if outcome.problem and not told:
        print(f'flexarm run: {outcome.problem}', file=sys.stderr)
    show_outcome(directory, outcome.summary, pictures=not args.no_pictures)
    if outcome.interrupted:
        return signals.status
    return 0 if outcome.stable and not outcome.problem else 1


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < 1e6:
        raise argparse.ArgumentTypeError(f'{text}: a number above 0')
    return value
