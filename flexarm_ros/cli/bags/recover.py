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

"""``flexarm recover``: recover a damaged bag into a new one."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from flexarm_ros.cli.options.bags import add_trust_option


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description="Copy every intact chunk of the bag of RUN (a run's directory, its bag or "
        'the .mcap file) into the new bag NEWBAG. Exit status: 0 complete, 3 in part, 1 nothing.',
    )
    parser.add_argument('run', metavar='RUN', help='output directory of a run, or its bag')
    parser.add_argument('--out', metavar='NEWBAG', required=True, help='new directory of the bag')
    add_trust_option(parser)


def run(args: argparse.Namespace) -> int:
    """Recover the bag; return 0 (complete), 3 (in part) or 1 (nothing)."""
    from flexarm_ros.bag.mcap.recover import recover
    from flexarm_ros.scenario.errors import counted

    rescue = recover(args.run, args.out)
    verdict = {0: 'complete', 3: 'in part', 1: 'nothing'}[rescue.status]
    if rescue.kept:
        planned = counted(rescue.planned, 'tick')
        ticks = f'{rescue.complete} of {planned}' if rescue.planned else 'no scenario'
        ticks = 'all topics as recorded' if rescue.as_recorded else ticks
        print(f'{verdict}: {counted(rescue.kept, "message")}, {ticks}, in {args.out}')
    else:
        print(f'{verdict}: {"; ".join(rescue.damages)}', file=sys.stderr)
        return rescue.status
    for count, noun, which in (
        (rescue.unexpected, 'message', 'on topics that the run does not have'),
        (rescue.repeated, 'second message', 'of a topic at a tick'),
        (rescue.dropped, 'message', 'with no place in the run'),
    ):
        if count:
            print(f'  left out: {counted(count, noun)} {which}')
    for damage in rescue.damages:
        print(f'  {damage}')
    return rescue.status
