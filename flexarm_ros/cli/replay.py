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

"""``flexarm replay``: publish a recorded run again, with ``/clock``."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
from pathlib import Path
from typing import Any

from flexarm_ros.cli import domain, UsageError
from flexarm_ros.cli.bag_options import add_bag_options


def add_parser(subparsers: Any) -> None:
    """Add the command to the main parser."""
    parser = subparsers.add_parser(
        'replay',
        help='publish a recorded run again',
        usage='flexarm replay RUN [options]',
        description='Publish every message of RUN (its directory, the bag in it or the .mcap '
        'file) again, with /clock, in the recorded order. While it plays, the services '
        '/player/pause, resume, play_next and toggle_paused and the parameter rate of /player '
        'steer it.',
        epilog='Exit status: 0 played; 1 the bag is damaged, or the controller did not answer; '
        '2 bad usage.',
    )
    parser.add_argument('run', metavar='RUN', help='output directory of a run, or its bag')
    parser.add_argument(
        '--rate', type=_rate, default=1.0, metavar='X',
        help='multiple of real time (default 1; 0: as fast as it goes)',
    )  # fmt: skip
    parser.add_argument(
        '--start', type=_rate, default=0.0, metavar='S', help='start at this simulated time, s'
    )
    parser.add_argument('--loop', action='store_true', help='start again at the end')
    parser.add_argument('--paused', action='store_true', help='start paused')
    parser.add_argument(
        '--topics', nargs='+', default=[], metavar='TOPIC',
        help='only these, and /clock (default: all)',
    )  # fmt: skip
    parser.add_argument(
        '--without', choices=('controller',), default='',
        help='leave the torque to your own controller, in lock-step',
    )  # fmt: skip
    parser.add_argument(
        '--delay', type=_rate, default=1.0, metavar='S',
        help='wall time to wait for subscribers first (default 1)',
    )  # fmt: skip
    domain.add_option(parser, '0')
    add_bag_options(parser)


def run(args: argparse.Namespace) -> int:
    """Play the run; 0, 1 if it broke off, 2 for a bad option, 129, 130 or 143 by signals."""
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError('rclpy is not installed: run `make env`, or source a ROS 2 installation')
    os.environ['ROS_DOMAIN_ID'] = str(domain.chosen_domain(args.domain) or 0)
    from flexarm_ros.nodes.middleware import prepare

    prepare()
    values = {
        'bag': json.dumps(str(Path(args.run).resolve())),
        'rate': repr(args.rate),
        'start': repr(args.start),
        'loop': str(args.loop).lower(),
        'paused': str(args.paused).lower(),
        'topics': json.dumps(','.join(args.topics)),
        'without': f"'{args.without}'",
        'delay': repr(args.delay),
        'scenario': json.dumps(args.scenario or ''),
        'set': json.dumps(';'.join(args.overrides)),
        'namespace': json.dumps(args.namespace or ''),
    }
    words = [word for key, value in values.items() for word in ('-p', f'{key}:={value}')]
    print(f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]}', flush=True)
    from flexarm_ros.nodes.player import play

    return play(['--ros-args', *words])


def _rate(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1e6:
        raise argparse.ArgumentTypeError(f'{text}: a number from 0 to 1e6')
    return value
