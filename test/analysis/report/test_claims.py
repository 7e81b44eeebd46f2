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

"""The paper's claims over given runs: which are decided, by which numbers, and how."""

from __future__ import annotations

from dataclasses import replace
import json
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.report.claims import Claims, evaluate
from flexarm_ros.analysis.report.runs import ReportedRun
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.scenario.suites import suite
import numpy as np
import pytest

# Section 4.3 of the contract and its neighbours, as the shipped scenarios give them.
OVERSHOOTS = {
    'pd_collocated': [0.806, 0.568, 0.711],
    'pd_tip': [0.798, 0.565, 0.706],
    'pd_tip_corrected': [0.796, 0.565, 0.704],
    'pd_mid': [0.801, 0.568, 0.708],
    'pd_mid_corrected': [0.800, 0.568, 0.708],
    'fls_collocated': [0.362, 0.496, 0.456],
    'fls_tip': [0.366, 0.505, 0.465],
    'fls_tip_corrected': [0.368, 0.510, 0.471],
    'fls_mid': [0.366, 0.502, 0.462],
    'fls_mid_corrected': [0.366, 0.503, 0.462],
}


def made(case: str, *overrides: str, name: str = '', **summary: Any) -> ReportedRun:
    """Return a shipped scenario's run with given metrics and no rows."""
    held = json.loads(json.dumps(scenario.to_dict(scenario.load(case, list(overrides)))))
    metrics = {
        'stable': True, 'overshoot': OVERSHOOTS.get(case), 'rms_error': 0.2, 'max_error': 0.9
    }  # fmt: skip
    columns = {column: np.zeros(0) for column in COLUMNS}
    return ReportedRun(Path('/runs') / (name or case), columns, {**metrics, **summary}, held)


def verdicts(claims: Claims) -> dict[str, str]:
    """Return letter -> verdict."""
    return {claim.text[1]: claim.verdict for claim in claims.tested}


def test_the_ten_cases_are_the_shipped_ones() -> None:
    assert sorted(case.name for case in suite.load('paper').cases) == sorted(OVERSHOOTS)
    assert set(OVERSHOOTS) <= set(scenario.shipped())


def test_all_ten_decide_every_claim() -> None:
    claims = evaluate([made(case) for case in OVERSHOOTS])
    assert verdicts(claims) == {
        'a': 'in part', 'b': 'in part', 'c': 'holds', 'd': 'in part', 'e': 'holds', 'f': 'holds'
    }  # fmt: skip
    assert claims.untested == () and claims.remarks == ()
    assert all(len(claim.outcomes) == claim.checks for claim in claims.tested)


def test_a_claim_follows_the_numbers() -> None:
    worse = [0.4, 0.6, 0.5]
    good = evaluate([made('fls_collocated'), made('fls_tip')])
    none = evaluate([made('fls_collocated', overshoot=worse), made('fls_tip')])
    some = evaluate([made('fls_collocated', overshoot=[0.1, 0.6, 0.5]), made('fls_tip')])
    assert [verdicts(claims)['c'] for claims in (good, none, some)] == [
        'holds', 'does not hold', 'in part'
    ]  # fmt: skip
    (claim,) = (claim for claim in good.tested if claim.text.startswith('(c)'))
    first = claim.outcomes[0].text
    assert first.startswith('fls_tip.overshoot[0] > fls_collocated.overshoot[0]: ')
    assert '0.366' in first and '0.362' in first


def test_only_what_the_runs_allow_is_decided() -> None:
    claims = evaluate([made('fls_tip')])
    assert verdicts(claims) == {'f': 'holds'}
    assert (len(claims.tested[0].outcomes), claims.tested[0].checks) == (1, 10)
    assert [text[1] for text in claims.untested] == ['a', 'b', 'c', 'd', 'e']


def test_no_case_no_claim() -> None:
    claims = evaluate([made('fls_tip', 'tip_sensor.location=8.0')])
    assert claims.tested == ()
    assert claims.remarks == ("Left out: fls_tip is not one of the paper's ten cases as shipped.",)
    assert evaluate([]).tested == ()


def test_an_unstable_run_decides_stability_alone() -> None:
    claims = evaluate([made('fls_tip', stable=False, overshoot=[None, None, None])])
    assert verdicts(claims) == {'f': 'does not hold'}


def test_a_run_that_was_broken_off_decides_nothing() -> None:
    claims = evaluate([made('fls_tip', stable=None, overshoot=None)])
    assert claims.tested == () and len(claims.untested) == 6


def test_cases_are_known_by_their_scenario_not_their_name() -> None:
    claims = evaluate([made('fls_tip', name='a'), made('fls_collocated', name='b')])
    assert verdicts(claims)['c'] == 'holds'
    assert claims.remarks == ("Of the paper's cases, fls_tip is a, fls_collocated is b here.",)


@pytest.mark.parametrize(
    ('case', 'override'),
    [
        ('fls_tip', 'plant.hub_inertia=[10.0, 10.0]'),
        ('fls_tip', 'plant.model=full'),
        ('fls_tip', 'trajectory.side=10.0'),
        ('fls_tip', 'controller.kp=100.0'),
        ('fls_mid', 'tip_sensor.latency=0.0234'),
        ('fls_mid', 'tip_sensor.measurand=elastic'),
        ('fls_mid', 'controller.velocity_source=encoder'),
        ('fls_mid', 'controller.ks=14.0'),
        ('fls_mid', 'seed=1'),
        ('fls_mid', 'sync=free'),
    ],
)
def test_unlike_runs_are_not_compared(case: str, override: str) -> None:
    alike = [made('fls_collocated'), made('fls_tip_corrected'), made('pd_tip')]
    claims = evaluate([made(case, override, name='odd'), *alike])
    told = "odd is not one of the paper's ten cases as shipped."
    assert claims.remarks == (f'Left out: {told}',)
    assert evaluate([made(case, override)]).tested == ()


@pytest.mark.parametrize('key', ['tick_timeout', 'start_timeout'])
def test_what_no_number_depends_on_may_differ(key: str) -> None:
    claims = evaluate([made('fls_tip', f'{key}=9.0', 'recorder.compression=none')])
    assert verdicts(claims) == {'f': 'holds'}


def test_a_run_whose_parameters_were_changed_on_the_way_is_no_case() -> None:
    assert evaluate([made('fls_tip', changes=[{'key': 'kp'}])]).tested == ()


def test_a_scenario_that_is_none_is_no_case() -> None:
    run = made('fls_tip')
    assert evaluate([replace(run, scenario={'plant': {'evil': '<b>'}})]).tested == ()


def test_of_two_runs_of_one_case_the_first_counts() -> None:
    claims = evaluate([made('fls_tip', name='a'), made('fls_tip', name='b', stable=False)])
    assert verdicts(claims)['f'] == 'holds'
    assert 'Left out: b is the same case as a.' in claims.remarks
