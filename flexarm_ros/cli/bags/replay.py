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
import os
from pathlib import Path
from typing import Any

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options import domain, namespace
from flexarm_ros.cli.options.bags import add_bag_options
from flexarm_ros.cli.options.numbers import number
from flexarm_ros.cli.options.output import check_utf8
from flexarm_ros.scenario.yaml.rclyaml import quoted


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        usage='flexarm replay RUN [options]',
        description='Publish every message of RUN (its directory, the bag in it or the .mcap '
        'file) again, with /clock, in the recorded order. Playback is controlled by the services '
        '/player/pause, resume, play_next and toggle_paused and by the parameter rate of /player.',
        epilog='Exit status: 0 played; 1 the bag is damaged, or the controller did not answer; '
        '2 bad usage.',
    )
    parser.add_argument('run', metavar='RUN', help='output directory of a run, or its bag')
    parser.add_argument(
        '--rate', type=_rate, default=1.0, metavar='X',
        help='multiple of real time (default 1; 0: as fast as possible)',
    )  # fmt: skip
    parser.add_argument(
        '--start', '--start-offset', type=_rate, default=0.0, metavar='S',
        help='simulated time at which to start, s',
    )  # fmt: skip
    parser.add_argument(
        '--duration', '--playback-duration', type=_number, default=-1.0, metavar='S',
        help='simulated time to play, s (default: to the end)',
    )  # fmt: skip
    parser.add_argument('--loop', action='store_true', help='repeat from the start at the end')
    parser.add_argument('--paused', '--start-paused', action='store_true', help='start paused')
    parser.add_argument(
        '--topics', nargs='+', default=[], metavar='TOPIC',
        help='topics to play, besides /clock (default: all)',
    )  # fmt: skip
    parser.add_argument(
        '--exclude', '--exclude-topics', nargs='+', default=[], metavar='TOPIC',
        help='topics to leave out; may include /clock',
    )  # fmt: skip
    parser.add_argument(
        '--remap', '-m', nargs='+', action='extend', type=_rule, default=[], metavar='OLD:=NEW',
        help='ROS 2 remapping rules for the published names',
    )  # fmt: skip
    namespace.add_option(
        parser, 'publish in this namespace, except /clock; of a bag with runs in several '
        'namespaces, play this one',
    )  # fmt: skip
    parser.add_argument(
        '--without', choices=('controller',), default='',
        help='do not publish the torque: an external controller computes it, in lock-step '
        'or with --timing recorded by the wall clock',
    )  # fmt: skip
    parser.add_argument(
        '--timing', choices=('even', 'recorded'), default='even',
        help='even: ticks at equal intervals (default); recorded: of a free-running run, ticks '
        'and torques at their recorded wall times',
    )  # fmt: skip
    parser.add_argument(
        '--delay', type=_rate, default=1.0, metavar='S',
        help='wall time to wait for subscribers, s (default 1)',
    )  # fmt: skip
    domain.add_option(parser, '0')
    add_bag_options(parser, '--from-namespace')


def run(args: argparse.Namespace) -> int:
    """Play the run; return 0, 1 if it broke off, 2 for a bad option, 129, 130, 143 by signals."""
    if importlib.util.find_spec('rclpy') is None:
        raise UsageError('rclpy is not installed: run `make env`, or source a ROS 2 installation')
    space = namespace.checked(args.namespace)
    for name, text in (('RUN', args.run), ('--scenario', args.scenario or '')):
        check_utf8(f'{name} ', os.path.abspath(text))
    os.environ['ROS_DOMAIN_ID'] = str(domain.chosen_domain(args.domain) or 0)
    values = {
        'bag': quoted(str(Path(args.run).resolve())),
        'rate': repr(args.rate),
        'start': repr(args.start),
        'loop': str(args.loop).lower(),
        'paused': str(args.paused).lower(),
        'playback_duration': repr(args.duration),
        'topics': quoted(','.join(args.topics)),
        'exclude': quoted(','.join(args.exclude)),
        'without': f"'{args.without}'",
        'timing': args.timing,
        'delay': repr(args.delay),
        'scenario': quoted(args.scenario or ''),
        'set': quoted(';'.join(args.overrides)),
        'namespace': quoted(args.from_namespace or ''),
    }
    words = [word for key, value in values.items() for word in ('-p', f'{key}:={value}')]
    rules = [f'__ns:={space}'] if space else []
    words += [word for rule in rules + args.remap for word in ('-r', rule)]
    print(f'ROS_DOMAIN_ID={os.environ["ROS_DOMAIN_ID"]}', flush=True)
    from flexarm_ros.nodes.player.player import play

    return play(['--ros-args', *words])


def _rule(text: str) -> str:
    old, assigned, new = text.partition(':=')
    if not (old and assigned and new):
        raise argparse.ArgumentTypeError(f'{text}: not a remapping rule OLD:=NEW')
    return text


def _rate(text: str) -> float:
    return _number(text, 0.0)


def _number(text: str, least: float = -1e6) -> float:
    value = number(text)
    if not least <= value <= 1e6:
        raise argparse.ArgumentTypeError(f'{text}: a number from {least:g} to 1e6')
    return value
