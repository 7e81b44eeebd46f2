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

"""``flexarm verify``: recompute a recorded run and compare every message."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options.bags import add_bag_options, given_scenario

if TYPE_CHECKING:
    from flexarm_ros.bag.checks.verify import Verdict

_OTHER_SOURCE = 'recorded by other source code, which may give other numbers:'
_OTHER_VERSIONS = 'recorded with other versions, which must give the same numbers:'


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description="Recompute each RUN (a run's directory, the bag in it or the .mcap file) from "
        'the scenario in the bag (or --scenario), node by node from the recorded inputs and as a '
        'closed loop, and compare every recorded message byte for byte.',
        epilog='A law, section or key of the scenario that this version does not know is taken as '
        'recorded, like an external node, and the rest is verified; nothing that a bag names is '
        'imported. Exit status: 0 if all messages match; 1 if one differs or is missing, the bag '
        'is damaged although its run was completed, or the bag cannot be read.',
    )
    parser.add_argument(
        'runs', metavar='RUN', nargs='+', type=Path,
        help='output directory of a run, or its bag; reports and sweeps are skipped',
    )  # fmt: skip
    parser.add_argument(
        '--without', action='append', default=[], metavar='NODE',
        help='take the messages of NODE, an external node, as recorded; may repeat',
    )  # fmt: skip
    add_bag_options(parser)


def run(args: argparse.Namespace) -> int:
    """Verify the runs; return 0 if all messages match, else 1."""
    if len(args.runs) == 1:
        return _verify(args, args.runs[0])
    statuses = [_one_of_several(args, path) for path in args.runs]
    if set(statuses) == {None}:
        raise UsageError('none of the paths is a run')
    return max(status for status in statuses if status is not None)


def _one_of_several(args: argparse.Namespace, path: Path) -> int | None:
    """Verify one run, None if skipped; an unreadable bag does not stop the others."""
    from flexarm_ros.bag.errors import BagError
    from flexarm_ros.cli.options.output import skips

    try:
        print(f'{path}:', flush=True)
        return _verify(args, path)
    except BagError as error:
        if skips(path, 'verify'):
            return None
        print(f'NOT VERIFIED: {error}')
        return 1


def _verify(args: argparse.Namespace, path: Path) -> int:
    from flexarm_ros.bag.checks.verify import verify

    verdict = verify(path, args.without, given_scenario(args), args.namespace)
    _show(verdict)
    return 0 if verdict.same else 1


def _show(verdict: Verdict) -> None:
    from flexarm_ros.scenario.errors import counted

    print(f'{verdict.ticks} of {counted(verdict.planned, "tick")} compared')
    if verdict.versions:
        print(_OTHER_SOURCE if verdict.other_source else _OTHER_VERSIONS)
        for text in verdict.versions:
            print(f'  {text}')
    for check, count in verdict.compared.items():
        bad = verdict.differing.get(check, 0)
        messages, differ = counted(count, 'message'), 'differs' if count == 1 else 'differ'
        result = f'{bad} of {messages} {differ}' if bad else f'{messages} the same'
        print(f'  {check:12} {result}')
    for text in verdict.notes:
        print(f'note: {text}')
    for text in verdict.faults:
        print(f'fault: {text}')
    for difference in sorted(verdict.first.values(), key=lambda d: d.tick):
        print(f'first of {difference.check}: {difference}')
    earliest = verdict.earliest
    if earliest is not None:
        print(f'DIFFERS: {earliest}')
        if not verdict.source_known:
            print(
                'the run may have had another scenario (--scenario, --set), external nodes '
                '(--without NODE) or other source code'
            )
        elif not verdict.other_source:
            print('the source is the same: the bag was changed, or flexarm_ros has a bug')
    else:
        print('the same' if verdict.same else 'NOT VERIFIED: see above')
