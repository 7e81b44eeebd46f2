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

"""``flexarm suite``: run many scenarios and check their expectations."""

from __future__ import annotations

import argparse
import contextlib
from dataclasses import replace
import importlib.util
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.options.own_nodes import add_option, own_nodes
from flexarm_ros.cli.signals import Deferred

if TYPE_CHECKING:
    from flexarm_ros.launcher.suite import SuiteResult
    from flexarm_ros.scenario.suites.suite import Case


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Run every case of SUITE (a file or the name of a shipped one), each in its '
        'own ROS domain and processes, and check its expectations, comparisons and claims.',
    )
    parser.add_argument(
        'suite', metavar='SUITE.yaml', help='a file or the name of a shipped suite'
    )
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='output directory (default: runs/SUITE)'
    )
    parser.add_argument('--junit', type=Path, metavar='FILE', help='write JUnit XML')
    parser.add_argument(
        '--jobs',
        type=_count,
        metavar='N',
        help='concurrent cases (default: from the number of cores)',
    )
    parser.add_argument(
        '--mode', choices=('run', 'compose', 'simulate'),
        help='run every case in this mode, overriding the suite',
    )  # fmt: skip
    add_option(parser)


def run(args: argparse.Namespace) -> int:
    """Run the suite; return 0 if it passed, 1 if not, 130, 143 or 129 after a signal."""
    from flexarm_ros.cli.options.output import new_directory
    from flexarm_ros.cli.running.suite_table import print_result, SuiteTable
    from flexarm_ros.launcher.junit import write_junit
    from flexarm_ros.launcher.suite import default_jobs, run_suite
    from flexarm_ros.scenario.suites.suite import load

    suite = load(args.suite)
    if args.mode:
        suite = replace(suite, cases=tuple(_flown(case, args.mode) for case in suite.cases))
    nodes = own_nodes(args.nodes, (case.config for case in suite.cases))
    processes = any(case.mode != 'simulate' for case in suite.cases)
    if processes and importlib.util.find_spec('rclpy') is None:
        raise UsageError('rclpy is not installed (`make env`); --mode simulate needs no ROS')
    if args.junit and args.junit.is_dir():
        raise UsageError(f'--junit {args.junit}: is a directory')
    out = new_directory(args.out, suite.name)
    with Deferred() as signals, SuiteTable(suite) as table:
        result = run_suite(
            suite, out, args.jobs or default_jobs(suite), table.update,
            lambda: bool(signals.signum), nodes,
        )  # fmt: skip
    print_result(result)
    if args.junit:
        write_junit(result, args.junit)
        print(f'junit  {args.junit}')
    print(f'runs   {out}')
    if result.claims:
        _report(result, out)
    if signals.signum:
        print('flexarm suite: interrupted', file=sys.stderr)
        return signals.status
    return 0 if result.passed else 1


def _report(result: SuiteResult, out: Path) -> None:
    """Write page and figures of a suite with claims, and name the paper's figures among them."""
    from flexarm_ros.analysis.figures.runs import write_figures
    from flexarm_ros.analysis.report.page import write_report
    from flexarm_ros.analysis.report.runs import load_run, RunError

    runs = []
    for case in result.cases:
        with contextlib.suppress(RunError):  # a case that failed may have left no run
            runs.append(load_run(case.directory))
    if not runs:
        return
    folder = out / 'report'
    page, pictures = write_report(runs, folder), write_figures(runs, folder)
    figures = sorted(path.name for path in pictures if path.stem.startswith('figure_'))
    print(f'report {page}')
    if figures:
        print(f"paper's figures in {folder}: {', '.join(figures)}")


def _flown(case: Case, mode: str) -> Case:
    """Return ``case`` in another mode; UsageError for a case with faults, which needs ``run``."""
    if case.faults and mode != 'run':
        raise UsageError(f'--mode {mode}: case {case.name} has faults, which need mode run')
    return replace(case, mode=mode)


def _count(text: str) -> int:
    if not text.isdigit() or not 1 <= int(text) <= 64:
        raise argparse.ArgumentTypeError(f'{text}: a whole number from 1 to 64')
    return int(text)
