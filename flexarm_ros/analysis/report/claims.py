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
The paper's claims (its section 5), checked against the given runs.

The claims, with the meaning of "markedly" and "little" and the comparisons, are those of the
shipped suite ``paper``.  Only its ten cases count: every value of the scenario as shipped,
whatever the run's name, and no external nodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from flexarm_ros import scenario
from flexarm_ros.analysis.report.runs import ReportedRun
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.scenario.suites import suite
from flexarm_ros.scenario.suites.expect import CheckResult

_WALL_CLOCK = ('start_timeout', 'tick_timeout', 'on_invalid', 'record', 'clock_rate')
"""Keys of section ``/**`` that the numbers do not depend on."""


@dataclass(frozen=True)
class Claim:
    """A claim, the verdict of the possible checks, these checks, and how many there are."""

    text: str
    verdict: str
    outcomes: tuple[CheckResult, ...]
    checks: int


@dataclass(frozen=True)
class Claims:
    """The verdicts, the texts of the claims that the runs cannot decide, and remarks."""

    tested: tuple[Claim, ...]
    untested: tuple[str, ...]
    remarks: tuple[str, ...]


def evaluate(runs: Sequence[ReportedRun]) -> Claims:
    """Return the verdicts on the paper's claims for the given runs."""
    try:
        paper = suite.load('paper')
    except scenario.ScenarioError as error:
        return Claims((), (), (f'No claims: {error}',))
    cases, remarks = _cases(runs, {_numbers(case.config): case.name for case in paper.cases})
    if not cases:
        return Claims((), (), remarks)
    metrics = {name: run.summary for name, run in cases.items()}
    renamed = [f'{name} is {run.name}' for name, run in cases.items() if run.name != name]
    if renamed:
        remarks = (f"Of the paper's cases, {', '.join(renamed)} here.", *remarks)
    tested, untested = [], []
    for claim in paper.claims:
        outcomes = [check.check(metrics) for check in claim.checks]
        decided = tuple(outcome for outcome in outcomes if outcome.holds is not None)
        if decided:
            tested.append(Claim(claim.text, _verdict(decided), decided, len(outcomes)))
        else:
            untested.append(claim.text)
    return Claims(tuple(tested), tuple(untested), remarks)


def _verdict(outcomes: Sequence[CheckResult]) -> str:
    """Return the suite's verdict; all outcomes are decided."""
    held = [outcome.holds for outcome in outcomes]
    holds, in_part, fails = suite.VERDICTS
    return holds if all(held) else in_part if any(held) else fails


def _cases(
    runs: Sequence[ReportedRun], shipped: Mapping[RunConfig, str]
) -> tuple[dict[str, ReportedRun], tuple[str, ...]]:
    """Return case name -> run (the first of equal ones), and remarks on excluded runs."""
    cases: dict[str, ReportedRun] = {}
    remarks = []
    for run in runs:
        name = _case(run, shipped)
        if run.external:
            remarks.append(
                f'{run.name} was recorded with external nodes: {", ".join(run.external)}.'
            )
        elif name is None:
            remarks.append(f"{run.name} is not one of the paper's ten cases as shipped.")
        elif name in cases:
            remarks.append(f'{run.name} is the same case as {cases[name].name}.')
        else:
            cases[name] = run
    return cases, tuple(f'Left out: {text}' for text in remarks)


def _case(run: ReportedRun, shipped: Mapping[RunConfig, str]) -> str | None:
    """Return the name of the shipped case whose scenario the run has unchanged, if any."""
    if run.summary.get('changes'):
        return None
    config = run.config
    return None if config is None else shipped.get(_numbers(config))


def _numbers(config: RunConfig) -> RunConfig:
    """Return a scenario without the keys that the numbers do not depend on."""
    default = RunConfig()
    same = {key: getattr(default.run, key) for key in _WALL_CLOCK}
    run = replace(config.run, **same)
    return replace(config, run=run, recorder=default.recorder, pace=default.pace)
