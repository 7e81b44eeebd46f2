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
The paper's claims (its section 5) held against the runs at hand.

The claims are those of the shipped suite ``paper``: its words, its reading of "markedly" and
"little", its comparisons.  Which of the paper's ten cases a run is comes from its resolved
scenario, not from its name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
import json

from flexarm_ros import scenario
from flexarm_ros.analysis.report_runs import COLLOCATED, CORRECTED, NONCOLLOCATED, number, Run
from flexarm_ros.scenario import suite
from flexarm_ros.scenario.expect import Outcome

TIP, MID = 'tip', 'mid'
Key = tuple[str, str, str]

TEN: dict[Key, str] = {
    (law, role, place): f'{law}_{name}'
    for law in ('pd', 'fls')
    for role, place, name in (
        (COLLOCATED, '', 'collocated'),
        (NONCOLLOCATED, TIP, 'tip'),
        (CORRECTED, TIP, 'tip_corrected'),
        (NONCOLLOCATED, MID, 'mid'),
        (CORRECTED, MID, 'mid_corrected'),
    )
}
"""Law, role and place of the paper's ten cases -> the case's name in the suite."""


@dataclass(frozen=True)
class Claim:
    """A claim, the verdict over the checks that could be made, those, and how many there are."""

    text: str
    verdict: str
    outcomes: tuple[Outcome, ...]
    checks: int


@dataclass(frozen=True)
class Claims:
    """The verdicts, the texts of the claims that the runs cannot decide, and remarks."""

    tested: tuple[Claim, ...]
    untested: tuple[str, ...]
    remarks: tuple[str, ...]


def evaluate(runs: Sequence[Run]) -> Claims:
    """Return which of the paper's claims hold over the given runs, with the numbers."""
    cases, remarks = _cases(runs)
    if not cases:
        return Claims((), (), remarks)
    try:
        claims = suite.load('paper').claims
    except scenario.ScenarioError as error:
        return Claims((), (), (f'No claims: {error}',))
    metrics = {TEN[key]: run.summary for key, run in cases.items()}
    renamed = [f'{TEN[key]} is {run.name}' for key, run in cases.items() if run.name != TEN[key]]
    if renamed:
        remarks = (f"Of the paper's cases, {', '.join(renamed)} here.", *remarks)
    tested, untested = [], []
    for claim in claims:
        outcomes = [check.check(metrics) for check in claim.checks]
        decided = tuple(outcome for outcome in outcomes if outcome.holds is not None)
        if decided:
            tested.append(Claim(claim.text, _verdict(decided), decided, len(outcomes)))
        else:
            untested.append(claim.text)
    return Claims(tuple(tested), tuple(untested), remarks)


def _verdict(outcomes: Sequence[Outcome]) -> str:
    """Return one of the suite's verdicts; all outcomes are decided."""
    held = [outcome.holds for outcome in outcomes]
    holds, in_part, fails = suite.VERDICTS
    return holds if all(held) else in_part if any(held) else fails


def _cases(runs: Sequence[Run]) -> tuple[dict[Key, Run], tuple[str, ...]]:
    """
    Return law, role and place -> run; only runs that are alike in all else count.

    Of several kinds the most frequent is taken, of two runs of one case the first.
    """
    placed = [(run, (run.law, run.role, _place(run))) for run in runs]
    candidates = [(run, key) for run, key in placed if key in TEN]
    remarks = [f"{run.name} is none of the paper's ten cases." for run, key in placed
               if key not in TEN]  # fmt: skip
    arm, sensor = _usual_kind([run for run, _ in candidates])
    cases: dict[Key, Run] = {}
    for run, key in candidates:
        if _arm(run) != arm or (run.role != COLLOCATED and _sensor(run) != sensor):
            remarks.append(f'{run.name} differs from the others in more than the case.')
        elif key in cases:
            remarks.append(f'{run.name} is the same case as {cases[key].name}.')
        else:
            cases[key] = run
    return cases, tuple(f'Left out: {text}' for text in remarks)


def _place(run: Run) -> str:
    """Return which of the paper's two places the sensor is at; empty for an encoder."""
    if run.location is None:
        return ''
    places = {TIP: 9.0, MID: 6.75}
    return next((name for name, x in places.items() if abs(run.location - x) < 1e-9), 'elsewhere')


def _usual_kind(runs: Sequence[Run]) -> tuple[str, str]:
    """Return the most frequent kind of arm, and of sensor on such an arm."""
    arms = Counter(_arm(run) for run in runs)
    arm = max(arms, key=arms.__getitem__, default='')
    sensors = Counter(_sensor(run) for run in runs if _arm(run) == arm and run.role != COLLOCATED)
    return arm, max(sensors, key=sensors.__getitem__, default='')


CASE_KEYS = {
    '/**': {'sync', 'start_timeout', 'tick_timeout', 'on_invalid'},
    'trajectory': {'delay'},
    'controller': {'law', 'feedback', 'velocity_source', 'ks', 'kn', 'torque_file'},
}
"""Section -> keys that may differ between cases that are compared."""


def _arm(run: Run) -> str:
    """Return a text that is equal for runs whose arm, path and gains are equal."""
    held = {
        section: {key: keys[key] for key in sorted(set(keys) - CASE_KEYS.get(section, set()))}
        for section, keys in run.scenario.items()
        if section not in ('tip_sensor', 'recorder')
    }
    return json.dumps(held, sort_keys=True)


def _sensor(run: Run) -> str:
    """
    Return a text that is equal for sensors with one reading of the paper's delay.

    The delay goes with the distance: of both only their quotient counts, a wave's speed.
    """
    keys = run.scenario.get('tip_sensor', {})
    held = {key: keys[key] for key in sorted(set(keys) - {'location', 'latency'})}
    latency = number(keys.get('latency')) or 0.0
    speed = f'{(run.location or 0.0) / latency:.1e}' if latency > 0.0 else ''
    return json.dumps([held, speed, run.value('controller', 'velocity_source')], sort_keys=True)
