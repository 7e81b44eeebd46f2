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

"""``flexarm sweep``: run a parameter sweep in parallel into one table."""

from __future__ import annotations

import argparse
import contextlib
import os
from pathlib import Path
import sys
import time
from typing import Any, TYPE_CHECKING

from flexarm_ros.cli import UsageError
from flexarm_ros.cli.signals import Deferred

if TYPE_CHECKING:
    from flexarm_ros.analysis.sweep.engine import DaskCluster, LocalPool, Stop
    from flexarm_ros.analysis.sweep.store import SweepStore, Table
    from flexarm_ros.scenario.sweeps.sweep import Sweep

MOST_REASONS = 3


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Execute every run of SWEEP (a file or the name of a shipped one) in local '
        'processes or on a Dask cluster, and write one table and figures. Here stable means only '
        'that the run reached its end. For two parameters the figures and linear.csv also show '
        'the stability boundary about rest from the linear analysis of `flexarm stability`. '
        'An interrupted sweep continues when started again with the same --out.',
        epilog='Exit status: 0; 1 if a run failed for another reason than instability; '
        '2 for a bad sweep; 130, 143 or 129 after a signal.',
    )
    parser.add_argument('sweep', metavar='SWEEP', help='a file or the name of a shipped sweep')
    parser.add_argument(
        '--out', type=Path, metavar='DIR', help='output directory (default: runs/NAME)'
    )
    parser.add_argument(
        '--workers', type=_workers, metavar='N', help='processes (default: one per core)'
    )
    parser.add_argument(
        '--scheduler', metavar='ADDRESS', help='use the Dask scheduler at tcp://HOST:PORT instead'
    )
    parser.add_argument('--no-pictures', action='store_true', help='write no figures')


def run(args: argparse.Namespace) -> int:
    """Run the sweep; return 0, 1 if a run failed, 130, 143 or 129 after a signal."""
    from flexarm_ros.analysis.sweep.engine import EngineError
    from flexarm_ros.analysis.sweep.store import StoreError, SweepStore
    from flexarm_ros.cli.options.output import check_utf8, new_directory
    from flexarm_ros.scenario.sweeps import sweep as sweeps

    sweep = sweeps.load(args.sweep)
    try:
        with contextlib.closing(_engine(args, sweep)) as engine:
            directory = args.out or new_directory(None, sweep.name)
            check_utf8('--out ', str(directory.absolute()))
            with Deferred() as signals, SweepStore(directory, sweep) as store:
                _run_all(engine, sweep, store, stop=lambda: bool(signals.signum))
                _finish(args, sweep, store, lambda: bool(signals.signum))
                missing, counts = store.missing(), store.counts()
    except (StoreError, EngineError) as error:
        raise UsageError(str(error)) from None
    if signals.signum:
        again = f'flexarm sweep {args.sweep} --out {directory}'
        print(f'flexarm sweep: {len(missing)} runs left; `{again}` continues', file=sys.stderr)
        return signals.status
    return 1 if {'failed', 'crashed'} & set(counts) or set(counts) == {'invalid'} else 0


def _engine(args: argparse.Namespace, sweep: Sweep) -> LocalPool | DaskCluster:
    from flexarm_ros.analysis.sweep.engine import DaskCluster, LocalPool

    if args.scheduler is not None:
        return DaskCluster(sweep.bases, args.scheduler)
    return LocalPool(sweep.bases, min(_processes(args), sweep.count))


def _processes(args: argparse.Namespace) -> int:
    return args.workers or len(os.sched_getaffinity(0))


def _run_all(engine: LocalPool | DaskCluster, sweep: Sweep, store: SweepStore, stop: Stop) -> None:
    """Execute the runs that have no result yet."""
    from flexarm_ros.cli.options.progress import CountProgress

    missing = store.missing()
    if not missing:
        return
    done = sweep.count - len(missing)
    if done:
        print(f'flexarm sweep: {done} of {sweep.count} runs have results already', file=sys.stderr)
    cases = [sweep.case(index) for index in missing]
    tasks = [(case.index, case.base, case.overrides) for case in cases]
    start = time.monotonic()
    with CountProgress(sweep.name, sweep.count, done) as progress:
        for row in engine.rows(tasks, stop):
            store.add(row)
            progress.update(len(store.rows))
    seconds, count = time.monotonic() - start, len(store.rows) - done
    print(f'flexarm sweep: {count} runs in {seconds:.1f} s, {count / seconds:.1f} a second',
          file=sys.stderr)  # fmt: skip


def _finish(args: argparse.Namespace, sweep: Sweep, store: SweepStore, stop: Stop) -> None:
    """Write the table and the figures, and print a summary."""
    table, files = store.write()
    if not args.no_pictures and not stop() and store.rows:
        files += _pictures(args, sweep, table, store, stop)
    counts = ', '.join(f'{n} {outcome}' for outcome, n in store.counts().items()) or 'none'
    print(
        f'{len(store.rows)} of {sweep.count} runs: {counts} (stable: reached the end of its run)'
    )
    bad = [row for row in store.rows.values() if row['outcome'] in ('failed', 'crashed')]
    for row in bad[:1]:
        print(f'run {row["index"]} {row["outcome"]}: {row["error"]}', file=sys.stderr)
    for path in files:
        print(path)


def _pictures(
    args: argparse.Namespace, sweep: Sweep, table: Table, store: SweepStore, stop: Stop
) -> list[Path]:
    try:
        from flexarm_ros.analysis.sweep.pictures import write_pictures
    except ImportError as error:
        print(f'no pictures: {error}', file=sys.stderr)
        return []
    from flexarm_ros.analysis.sweep_linear import analyse_grid, linear_table

    files = []
    linear = analyse_grid(sweep, min(_processes(args), sweep.points), stop)
    if linear is not None:
        for reason in linear.reasons()[:MOST_REASONS]:
            print(f'flexarm sweep: no linear boundary: {reason}', file=sys.stderr)
        files = [store.write_table('linear.csv', linear_table(sweep, linear))]
    return files + write_pictures(sweep, table, store.directory / 'pictures', linear)


def _workers(text: str) -> int:
    value = int(text) if text.isdigit() else 0
    if not 1 <= value <= 1024:
        raise argparse.ArgumentTypeError(f'{text}: a whole number from 1 to 1024')
    return value
