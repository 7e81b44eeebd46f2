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

"""``flexarm compare``: compare the messages of two runs."""

from __future__ import annotations

import argparse
from dataclasses import asdict
import json
import math
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli.options.bags import add_bag_options, given_scenario

if TYPE_CHECKING:
    from flexarm_ros.bag.checks.compare import Comparison, FieldDifference


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Compare the messages of two runs (directories, bags or .mcap files) at equal '
        'times since the start, field by field. A value is beyond tolerance where '
        '|A - B| > ATOL + RTOL |B|.',
        epilog='Exit status: 0 all values within tolerance; 1 otherwise, or if a message has no '
        'counterpart, a bag is damaged, or there is nothing to compare.',
    )
    parser.add_argument('a', metavar='A', help='output directory of a run, or its bag')
    parser.add_argument('b', metavar='B', help='output directory of the second run, or its bag')
    parser.add_argument(
        '--atol', type=_tolerance, default=0.0, help='absolute tolerance (default 0)'
    )
    parser.add_argument(
        '--rtol', type=_tolerance, default=0.0, help='relative tolerance (default 0)'
    )
    parser.add_argument('--json', action='store_true', help='print JSON instead of text')
    add_bag_options(parser)


def _tolerance(text: str) -> float:
    value = float(text)
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f'{text}: 0 or more')
    return value


def run(args: argparse.Namespace) -> int:
    """Compare the runs; return 0 if all values are within tolerance, else 1."""
    from flexarm_ros.bag.checks.compare import compare

    given = given_scenario(args)
    result = compare(args.a, args.b, args.atol, args.rtol, given, args.namespace)
    if args.json:
        _show_json(result)
    else:
        _show(result)
    return 0 if result.within else 1


def _show_json(result: Comparison) -> None:
    data = {**asdict(result), 'within': result.within}
    for entry, difference in zip(data['fields'], result.fields, strict=True):
        del entry['square_sum']
        entry['rms'] = difference.rms
        for key in ('largest', 'rms'):
            entry[key] = entry[key] if math.isfinite(entry[key]) else None
    print(json.dumps(data, indent=1))


def _show(result: Comparison) -> None:
    for text in result.parameters:
        print(f'parameter {text}')
    for text in result.notes:
        print(f'note: {text}')
    for path, count in result.only_a.items():
        if count:
            print(f'{path}: {count} message{"s" * (count != 1)} only in A')
    for path, count in result.only_b.items():
        if count:
            print(f'{path}: {count} message{"s" * (count != 1)} only in B')
    shown = [f for f in result.fields if f.largest > 0.0]
    width = max([len(f.topic) + len(f.name) + 1 for f in shown], default=0)
    if shown:
        print(f'{"topic field":{width}}  {"largest":>10} {"at, s":>10} {"rms":>10}  beyond')
    for f in shown:
        print(
            f'{f.topic + " " + f.name:{width}}  {f.largest:10.3g} {f.at_ns / 1e9:10g} '
            f'{f.rms:10.3g}  {_beyond(f)}'
        )
    if not result.compared:
        print('NOTHING compared: no message at the same time in both')
        return
    print(
        f'{result.compared} values compared: '
        + ('all within tolerance' if result.within else 'DIFFERENT')
    )


def _beyond(f: FieldDifference) -> str:
    if f.first_ns is None:
        return '-'
    return f'{f.beyond} of {f.count}, first at {f.first_ns / 1e9:g} s'
