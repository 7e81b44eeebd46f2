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

"""``flexarm report``: write figures and an HTML report of runs."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING
import webbrowser

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options.bags import add_bag_options, given_scenario

if TYPE_CHECKING:
    from flexarm_ros.analysis.report.runs import ReportedRun


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Write a self-contained HTML page, which works offline, and figures (PNG and '
        "SVG) of one run or of several overlaid: metrics, the paper's claims, paths, time series, "
        'an animation of the arm, the fuzzy logic system, the scenario.',
    )
    parser.add_argument(
        'runs',
        metavar='RUN',
        nargs='+',
        type=Path,
        help='output directory of a run, or its bag; reports and sweeps are skipped',
    )
    parser.add_argument(
        '--out', type=Path, metavar='DIR',
        help="output directory (default: report/ in the run's directory; "
        'for several runs, report/ in the current one)',
    )  # fmt: skip
    parser.add_argument('--no-pictures', action='store_true', help='write the page only')
    parser.add_argument('--open', action='store_true', help='open the page in a browser')
    add_bag_options(parser)


def run(args: argparse.Namespace) -> int:
    """Write the page and the figures; return 0, or 2 if a RUN is not a run."""
    from flexarm_ros.analysis.figures.runs import write_figures
    from flexarm_ros.analysis.report.page import write_report
    from flexarm_ros.analysis.report.runs import RunError

    try:
        runs = _load(args)
        out = args.out or (runs[0].directory if len(runs) == 1 else Path()) / 'report'
        page = write_report(runs, out)
        pictures = [] if args.no_pictures else write_figures(runs, out)
    except RunError as error:
        raise UsageError(str(error)) from None
    for one in runs:
        if problem := one.summary.get('problem'):
            print(f'flexarm report: {one.directory}: {problem}', file=sys.stderr)
    for path in (page, *pictures):
        print(path)
    if args.open:
        webbrowser.open(page.resolve().as_uri())
    return 0


def _load(args: argparse.Namespace) -> list[ReportedRun]:
    from flexarm_ros.analysis.report.runs import load_run, RunError
    from flexarm_ros.cli.options.output import skips

    given, runs = given_scenario(args), []
    for path in args.runs:
        try:
            runs.append(load_run(path, given, args.namespace))
        except RunError:
            if len(args.runs) == 1 or not skips(path, 'report'):
                raise
    if not runs:
        raise UsageError('none of the paths is a run')
    return runs
