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

"""``flexarm view``: show a running simulation, or a recorded run, in a browser."""

from __future__ import annotations

import argparse
import importlib.util
import os
from pathlib import Path
import threading
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options import domain, namespace
from flexarm_ros.cli.options.page import OWN


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Serve a page that shows a run: the bending arm, its signals, pause, step, '
        'reset, and sliders for every parameter that may change while running. RUN is a recorded '
        'run, played with a scrubber; without it the page shows what runs in a ROS domain, and '
        'Foxglove, Lichtblick (a WebSocket server) and RViz (markers, URDF, TF) can too. The run '
        "does not wait for the viewer. The arm is read from the run's nodes; a replay has none "
        'and needs its SCENARIO.',
        epilog='For example: `flexarm run fls_tip --view`, or `flexarm view --domain 7`, and '
        'elsewhere `flexarm run fls_tip --domain 7 --rtf 1`. Ctrl-C ends it.',
    )
    parser.add_argument(
        'shown', metavar='RUN|SCENARIO', nargs='?',
        help="a recorded run or bag; or a replay's scenario, a file or a shipped name",
    )  # fmt: skip
    domain.add_option(parser, '0')
    namespace.add_option(parser, 'namespace of the arm')
    parser.add_argument(
        '--port', type=int, default=OWN['port'].default, choices=range(65536), metavar='P',
        help='port of the page (default %(default)s; 0: any free port)',
    )  # fmt: skip
    parser.add_argument(
        '--foxglove-port', type=int, default=OWN['foxglove_port'].default,
        choices=range(65536), metavar='P',
        help='port of the WebSocket server for Foxglove (default %(default)s; 0: any free port)',
    )  # fmt: skip
    parser.add_argument(
        '--host', default=OWN['host'].default, metavar='ADDRESS',
        help='address to listen on (default %(default)s: this machine only); on any other the '
        'page needs the token of the printed address',
    )  # fmt: skip
    parser.add_argument(
        '--rate', type=float, default=OWN['rate'].default, metavar='HZ',
        help='highest frame rate, 1/s (default %(default)g)',
    )  # fmt: skip
    parser.add_argument(
        '--no-server', action='store_true', help='markers, URDF and TF only, no server'
    )


def run(args: argparse.Namespace) -> int:
    """Show the run until a signal; return 130, 143 or 129, or 2 if it cannot be shown."""
    if args.shown is not None and _is_recorded(Path(args.shown)):
        return _show_recorded(args)
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError('rclpy is not installed: run `make env`, or source a ROS 2 installation')
    words = _words(args)
    os.environ['ROS_DOMAIN_ID'] = str(domain.chosen_domain(args.domain) or 0)
    from flexarm_ros.nodes.view.foxglove import layout
    from flexarm_ros.nodes.view.viewer import view

    print(f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]}', flush=True)
    if not args.no_server:
        print(f'layout for Foxglove: {layout()}', flush=True)
    print(f'for RViz: {layout().with_name("flexarm.rviz")}', flush=True)
    return view(['--ros-args', *words])


def _is_recorded(path: Path) -> bool:
    return path.is_dir() or path.suffix in ('.mcap', '.db3')


def _show_recorded(args: argparse.Namespace) -> int:
    from flexarm_ros.nodes.view.page import PageError, PageServer
    from flexarm_ros.nodes.view.page_data import recording

    data = recording(args.shown)
    try:
        page = PageServer(args.host, args.port, lambda _: 'this is a recorded run', data)
    except PageError as error:
        raise UsageError(str(error)) from None
    page.feed.put('hello', data['hello'])
    print(f'page: {page.address}', flush=True)
    try:
        threading.Event().wait()
    finally:
        page.close()
    return 0  # never: a signal ends the wait


def _words(args: argparse.Namespace) -> list[str]:
    """Return the ROS arguments of the viewer; ScenarioError for a bad scenario."""
    ports = (-1, -1) if args.no_server else (args.port, args.foxglove_port)
    values = {
        'rate': repr(args.rate), 'host': f"'{args.host}'", 'port': str(ports[0]),
        'foxglove_port': str(ports[1]),
    }  # fmt: skip
    words = [word for key, value in values.items() for word in ('-p', f'{key}:={value}')]
    if args.shown is not None:
        scenario.load(args.shown, [])
        words += ['--params-file', str(scenario.find(args.shown))]
    if space := namespace.checked(args.namespace):
        words += ['-r', f'__ns:={space}']
    return words
