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

"""
The paper's claims under one changed assumption at a time: the tables of docs/paper.md.

    python -m validation.paper_claims                # all rows; writes docs/data, docs/paper.md
    python -m validation.paper_claims --only full_3  # one row, printed
    python -m validation.paper_claims --tables       # docs/paper.md from docs/data only

Each row runs the paper's ten cases (config/paper.yaml) with some parameters set anew and
judges the claims as they are written there, without changing a limit.  All rows take some
ten minutes on two cores, nine of ten for those with a tick of 0.02 ms.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
import multiprocessing
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.sweep.worker import simulate_row
from flexarm_ros.scenario.suites import suite
from validation.paper_tables import (
    claims_table,
    commands_table,
    numbers_table,
    read_csv,
    TABLE,
    write_csv,
    write_page,
)
from validation.paper_variants import judge, Row, Variant, variants


def _simulate(task: tuple[str, tuple[str, ...]]) -> dict[str, Any]:
    case, overrides = task
    return simulate_row(scenario.load(case, overrides))


def compute(chosen: list[Variant], workers: int) -> list[Row]:
    """Simulate all cases of the variants and judge them."""
    cases = [case.name for case in suite.load('paper').cases]
    tasks = {(case, v.overrides(case)): None for v in chosen for case in cases}
    context = multiprocessing.get_context('spawn')
    with ProcessPoolExecutor(workers, context) as pool:
        for number, (task, result) in enumerate(
            zip(tasks, pool.map(_simulate, list(tasks)), strict=True), start=1
        ):
            tasks[task] = result
            print(f'\r{number} of {len(tasks)} runs', end='', file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return [
        judge(v, {case: tasks[case, v.overrides(case)] or {} for case in cases}) for v in chosen
    ]


def main() -> int:
    """Simulate, judge, and write or print."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--only', nargs='+', metavar='ROW', help='these rows, printed only')
    parser.add_argument('--tables', action='store_true', help='the page from the table, no runs')
    parser.add_argument('--workers', type=int, default=2)
    args = parser.parse_args()
    known = {variant.name: variant for variant in variants()}
    if args.only and not set(args.only) <= set(known):
        parser.error(f'rows are {", ".join(known)}')
    if args.tables:
        write_page(read_csv(TABLE))
        return 0
    rows = compute([known[name] for name in args.only or known], args.workers)
    if args.only:
        tables = (claims_table(rows), numbers_table(rows), commands_table(rows))
        print('\n\n'.join('\n'.join(table) for table in tables))
        return 0
    write_csv(rows, TABLE)
    write_page(rows)
    return 0


if __name__ == '__main__':
    sys.exit(main())
