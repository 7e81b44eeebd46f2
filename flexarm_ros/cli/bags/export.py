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

"""``flexarm export``: export a bag's messages as CSV, Parquet or MATLAB files."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from flexarm_ros.cli.options.bags import add_bag_options, given_scenario


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description="Write one table for each topic of BAG (a run's directory, the bag in it or "
        'the .mcap file), the trajectory, and scenario.yaml, which repeats the run, into the new '
        'directory DIR. Parquet needs pyarrow. A MATLAB file has one struct of column '
        'vectors.',
        epilog='Exit status: 0 exported; 1 not possible, or the bag is damaged and was exported '
        'up to the damage; 2 bad usage.',
    )
    parser.add_argument('bag', metavar='BAG', help='a bag, or the output directory of a run')
    parser.add_argument(
        '--format', choices=('csv', 'parquet', 'mat'), default='csv', help='default: csv'
    )
    parser.add_argument('--out', metavar='DIR', required=True, help='new directory for the files')
    add_bag_options(parser)


def run(args: argparse.Namespace) -> int:
    """Export the bag; return 0, or 1 if it is damaged or cannot be exported."""
    from flexarm_ros.bag.tables.export import export

    given = given_scenario(args)
    exported = export(args.bag, args.out, args.format, given, args.namespace)
    for name, rows in exported.rows.items():
        print(f'{rows:9} rows  {args.out}/{name}')
    if exported.has_scenario:
        print(f'     scenario  {args.out}/scenario.yaml')
    for text in exported.notes:
        print(f'note: {text}')
    if exported.damage:
        print(f'flexarm export: only in part: {exported.damage}', file=sys.stderr)
        return 1
    return 0
