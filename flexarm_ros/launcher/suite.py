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

"""Execution of a suite: every case in its own domain and processes, then the comparisons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed, ThreadPoolExecutor
from dataclasses import dataclass, field
import hashlib
import os
from pathlib import Path
import re
import threading
import time
from types import MappingProxyType
from typing import Any

from flexarm_ros.bag.errors import BagError
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.launcher.domains import NoDomainError
from flexarm_ros.launcher.faults import FaultPlan
from flexarm_ros.launcher.run import run_scenario, RunOptions
from flexarm_ros.launcher.subprocess_simulation import simulate_apart
from flexarm_ros.scenario.suites.expect import CheckResult
from flexarm_ros.scenario.suites.suite import Case, Suite

CORES_PER_RUN = 2
"""Cores used by one distributed run; more concurrent runs slow one another down."""

_LONGEST_NAME = 200
"""Longest name of a directory, characters; file systems allow 255."""

NOT_STARTED = 'not started'


@dataclass
class CaseResult:
    """The result of one case."""

    case: Case
    directory: Path
    metrics: dict[str, Any] = field(default_factory=dict)
    outcomes: list[CheckResult] = field(default_factory=list)
    wall_s: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether every expectation holds."""
        return not self.not_started and all(outcome.holds for outcome in self.outcomes)

    @property
    def not_started(self) -> bool:
        """Whether the suite was ended before this case was started."""
        return self.metrics.get('error') == NOT_STARTED


@dataclass
class SuiteResult:
    """The result of a suite: cases, comparisons and claims."""

    suite: Suite
    cases: list[CaseResult]
    comparisons: list[CheckResult] = field(default_factory=list)
    claims: list[tuple[str, str, bool, list[CheckResult]]] = field(default_factory=list)
    """Text, verdict, whether it fails the suite, and the outcome of each check."""

    @property
    def passed(self) -> bool:
        """Whether the whole suite passes."""
        return (
            all(result.passed for result in self.cases)
            and all(outcome.holds for outcome in self.comparisons)
            and not any(failed for _, _, failed, _ in self.claims)
        )

    def failures(self) -> list[str]:
        """Return a line for each failed case, comparison and claim; empty if the suite passes."""
        found = [f'{case.case.name}: {NOT_STARTED}' for case in self.cases if case.not_started]
        found += [
            f'{case.case.name}: {outcome.text}'
            for case in self.cases
            for outcome in case.outcomes
            if not outcome.holds
        ]
        found += [outcome.text for outcome in self.comparisons if not outcome.holds]
        return found + [f'{text}: {verdict}' for text, verdict, failed, _ in self.claims if failed]


def case_directory(out: Path, name: str) -> Path:
    """
    Return a case's directory, unique for each name.

    Characters that are unsafe in a file name become ``_``, and long names are cut; a few
    digits computed from the name then keep the directories distinct.
    """
    plain = re.sub(r'[^A-Za-z0-9._=,\[\]-]', '_', name)
    if plain == name and len(name) <= _LONGEST_NAME:
        return out / name
    return out / f'{plain[:_LONGEST_NAME]}-{hashlib.sha256(name.encode()).hexdigest()[:8]}'


def default_jobs(suite: Suite) -> int:
    """Return the number of concurrent cases for this machine."""
    cores = os.cpu_count() or 1
    light = all(case.mode == 'simulate' for case in suite.cases)
    return max(1, cores if light else cores // CORES_PER_RUN)


def run_suite(
    suite: Suite,
    out: Path,
    jobs: int,
    watch: Callable[[Case, str], None] = lambda *_: None,
    stop: Callable[[], bool] = lambda: False,
    nodes: Mapping[str, Sequence[str]] = MappingProxyType({}),
) -> SuiteResult:
    """
    Run every case in a directory of ``out`` and judge the suite.

    ``watch(case, text)`` is called from the cases' threads with their state.  ``nodes`` has
    the commands of external nodes, by role: they take part in every case except simulated
    ones.
    """
    results: dict[str, CaseResult] = {}
    stopping = threading.Event()
    with ThreadPoolExecutor(max_workers=jobs) as pool:
        halted = lambda: stopping.is_set() or stop()  # noqa: E731
        futures = {
            pool.submit(_run_and_judge, case, out, nodes, watch, halted): case
            for case in suite.cases
        }
        try:
            for future in as_completed(futures):
                results[futures[future].name] = future.result()
        except BaseException:
            stopping.set()
            raise
    return judge(suite, [results[case.name] for case in suite.cases])


def judge(suite: Suite, cases: list[CaseResult]) -> SuiteResult:
    """
    Return the suite's result: its comparisons and claims over the cases' metrics.

    The paper's claims are about the package's own nodes: with external ones they are not judged.
    """
    runs = {result.case.name: result.metrics for result in cases}
    roles = {role for metrics in runs.values() for role in metrics.get('external') or ()}
    claims = []
    for claim in suite.claims:
        if suite.paper and roles:
            not_judged = f'not judged, external nodes: {", ".join(sorted(roles))}'
            claims.append((claim.text, not_judged, False, list[CheckResult]()))
            continue
        verdict, outcomes = claim.judge(runs)
        claims.append((claim.text, verdict, claim.fails(verdict), outcomes))
    return SuiteResult(suite, cases, [c.check(runs) for c in suite.compare], claims)


def _run_and_judge(
    case: Case,
    out: Path,
    nodes: Mapping[str, Sequence[str]],
    watch: Callable[[Case, str], None],
    stop: Callable[[], bool],
) -> CaseResult:
    """Run one case; an error is its result and does not end the suite."""
    result = CaseResult(case, case_directory(out, case.name))
    if stop():
        result.metrics = {'status': 130, 'error': NOT_STARTED, 'complete': False}
        result.outcomes = case.check(result.metrics)
        return result
    start = time.monotonic()
    watch(case, 'starting')
    try:
        summary, error, status = _run_case(case, result.directory, nodes, watch, stop)
    except (BagError, NoDomainError, OSError, ValueError) as problem:
        summary, error, status = {}, str(problem), 1
    result.wall_s = time.monotonic() - start
    result.metrics = {**summary, 'status': status, 'error': error}
    result.outcomes = case.check(result.metrics)
    watch(case, 'passed' if result.passed else 'FAILED')
    return result


def _run_case(
    case: Case,
    directory: Path,
    nodes: Mapping[str, Sequence[str]],
    watch: Callable[[Case, str], None],
    stop: Callable[[], bool],
) -> tuple[dict[str, Any], str, int]:
    """Return the summary, the reason of the end, and the exit status."""

    def progress(ticks: int, total: int) -> None:
        watch(case, f'{100 * ticks // max(1, total)} %')

    if case.mode == 'simulate':
        summary = simulate_apart(case.config, directory, case.name, progress, stop)
        return summary, str(summary.get('problem') or ''), 0 if summary.get('stable') else 1
    plan = FaultPlan(case.faults, Timeline.of(case.config.run)) if case.faults else None
    options = RunOptions(compose=case.mode == 'compose', nodes=nodes)
    outcome = run_scenario(
        case.config, case.name, directory, options,
        watch=progress, stop=stop, faults=plan,
    )  # fmt: skip
    status = 0 if outcome.stable and not outcome.problem else 1
    return outcome.summary, outcome.problem, status
