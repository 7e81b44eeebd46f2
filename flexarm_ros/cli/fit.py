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

"""``flexarm fit``: estimate parameters of a scenario from recordings of an arm."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli.predict import add_data_options, positive, print_table, say_notes
from flexarm_ros.cli.signals import Deferred

if TYPE_CHECKING:
    from flexarm_ros.identification.estimate.fitting import Fit

WINDOW = 2.0
"""Default length of the windows, s, except in mode closed_loop."""

MOST_STARTS = 1000


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Estimate the numbers KEY of a scenario by least squares, so that it predicts '
        'the recordings DATA (CSV files, runs or bags) best. Each number gets a standard '
        'deviation, from the sensitivities and the correlation time of the residuals, and a '
        'status: identified, prior (determined by the prior only), or not identifiable. Writes '
        'fit.json, fitted.yaml (a scenario), pictures and fit.html into DIR. An interrupted fit '
        'continues when started again with the same --out.',
        epilog='Exit status: 0; 1 if the search did not converge; 2 for bad data or a bad '
        'scenario; 130, 143 or 129 after a signal, with the best numbers so far in DIR.',
    )
    parser.add_argument('data', nargs='+', metavar='DATA', help='a CSV file, a run or a bag')
    add_data_options(parser)
    parser.add_argument(
        '--free', required=True, action='append', metavar='KEY[,KEY...]',
        help='numbers to estimate: section.key (both numbers of an array) or section.key.1 (one)',
    )  # fmt: skip
    parser.add_argument(
        '--prior', action='append', default=[], metavar='KEY=VALUE+-STD',
        help='mean and standard deviation of a free number known beforehand; may repeat',
    )  # fmt: skip
    parser.add_argument(
        '--hold-out', action='append', default=[], metavar='DATA or T0:T1',
        help='a recording, or a time span (s) of every recording: checked, not fitted',
    )  # fmt: skip
    parser.add_argument(
        '--window', type=_window, metavar='T',
        help=f'predict windows of T s, or whole: all data from rest (default {WINDOW:g}; '
        'closed_loop: whole). Windows suit a real arm, whose model is never exact; whole suits '
        'data with more noise than model error.',
    )  # fmt: skip
    parser.add_argument(
        '--channels', metavar='NAME[,NAME...]',
        help='fit these channels, as strain1,theta1_rate (default: all channels of the mode)',
    )  # fmt: skip
    parser.add_argument(
        '--starts', type=_count, default=1, metavar='N',
        help='search from N points and take the best result: from the scenario, then from others '
        'within two std of a prior or a factor of 3; for latencies, frequencies and friction, '
        'whose squares may have several minima (default 1)',
    )  # fmt: skip
    parser.add_argument('--out', type=Path, required=True, metavar='DIR', help='output directory')
    parser.add_argument('--no-pictures', action='store_true', help='write no figures and no page')


def _window(text: str) -> float:
    return math.inf if text == 'whole' else positive(text)


def _count(text: str) -> int:
    value = int(text) if text.isascii() and text.isdigit() else 0
    if not 1 <= value <= MOST_STARTS:
        raise argparse.ArgumentTypeError(f'{text!r}: a whole number from 1 to {MOST_STARTS}')
    return value


def run(args: argparse.Namespace) -> int:
    """Fit, write the results; return 0, 1 without convergence, 130, 143 or 129 after a signal."""
    from flexarm_ros.cli.options.output import check_utf8
    from flexarm_ros.cli.options.progress import FitProgress
    from flexarm_ros.identification.estimate.fitting import fit, prepare
    from flexarm_ros.identification.report.store import write

    default = math.inf if args.mode == 'closed_loop' else WINDOW
    window = default if args.window is None else args.window
    keys = [key for given in args.free for key in given.split(',') if key.strip()]
    request = prepare(
        args.data, args.scenario, keys, args.mode,
        window if math.isfinite(window) else None, args.zero, args.prior, args.hold_out,
        args.overrides,
        [name.strip() for name in args.channels.split(',')] if args.channels else (),
        args.starts,
    )  # fmt: skip
    for task in (*request.problem.tasks, *request.others):
        say_notes('fit', task.recording.name, task.recording.notes)
    check_utf8('--out ', str(args.out.absolute()))
    args.out.mkdir(parents=True, exist_ok=True)
    with Deferred() as signals, FitProgress('fit') as progress:
        found = fit(
            request, progress.update, lambda: bool(signals.signum), args.out / 'search.json'
        )
        files = write(found, args.out, not (args.no_pictures or signals.signum))
    _print(found)
    for path in files:
        print(path)
    if signals.signum:
        print('flexarm fit: stopped; the same command resumes the search', file=sys.stderr)
        return signals.status
    return 0 if found.complete else 1


def _print(found: Fit) -> None:
    width = max(len(key) for key in found.parameters)
    print(f'{"key":{width}s} {"value":>12s} {"std":>10s} {"start":>12s}  status')
    for key, row in found.parameters.items():
        std = '-' if row['std'] is None else f'{row["std"]:.2g}'
        value, start = f'{row["value"]:.5g}', f'{row["start"]:.5g}'
        print(f'{key:{width}s} {value:>12s} {std:>10s} {start:>12s}  {row["status"]}')
    parts = {'fitted': found.channels, 'hold-out': found.held_out}
    for title, channels in parts.items():
        if channels:
            print_table({name: channel.numbers() for name, channel in channels.items()}, title)
    for warning in found.warnings:
        print(f'flexarm fit: warning: {warning}', file=sys.stderr)
