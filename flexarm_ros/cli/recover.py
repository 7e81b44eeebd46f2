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

"""``flexarm recover``: rescue a damaged bag into a new one."""

from __future__ import annotations

import argparse
import sys
from typing import Any


def add_parser(subparsers: Any) -> None:
    """Add the command to the main parser."""
    parser = subparsers.add_parser(
        'recover',
        help='rescue a damaged bag into a new one',
        description="Copy every sound chunk of RUN's bag (a run's directory, the bag in it or the "
        '.mcap file) into the new bag NEWBAG. Exit status: 0 whole, 3 in part, 1 nothing.',
    )
    parser.add_argument('run', metavar='RUN', help='output directory of a run, or its bag')
    parser.add_argument('--out', metavar='NEWBAG', required=True, help='new directory of the bag')


def run(args: argparse.Namespace) -> int:
    """Rescue the bag; 0 whole, 3 in part, 1 nothing."""
    from flexarm_ros.bag.mcap.recover import recover

    rescue = recover(args.run, args.out)
    verdict = {0: 'whole', 3: 'in part', 1: 'nothing'}[rescue.status]
    if rescue.kept:
        ticks = f'{rescue.complete} of {rescue.planned} ticks' if rescue.planned else 'no scenario'
        ticks = 'all topics as recorded' if rescue.as_recorded else ticks
        print(f'{verdict}: {rescue.kept} messages, {ticks}, in {args.out}')
    else:
        print(f'{verdict}: {"; ".join(rescue.damages)}', file=sys.stderr)
        return rescue.status
    for count, what in (
        (rescue.foreign, 'are on topics that the run does not have'),
        (rescue.repeated, 'are second ones of a topic at a tick'),
        (rescue.dropped, 'fit nowhere'),
    ):
        if count:
            print(f'  {count} messages {what} and were left out')
    for damage in rescue.damages:
        print(f'  {damage}')
    return rescue.status
