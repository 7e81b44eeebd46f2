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
The paper's ten cases come out as expected, and its claims with the verdicts on record.

The numbers in config/paper.yaml are those of a model written apart from this package.
"""

from __future__ import annotations

from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.sweep.worker import simulate_row
from flexarm_ros.scenario.suites import suite
import pytest

PAPER = suite.load('paper')


@pytest.fixture(scope='module')
def runs() -> dict[str, dict[str, Any]]:
    return {case.name: simulate_row(case.config) for case in PAPER.cases}


@pytest.mark.parametrize('case', PAPER.cases, ids=lambda case: case.name)
def test_a_case_has_the_numbers_expected(
    case: suite.Case, runs: dict[str, dict[str, Any]]
) -> None:
    outcomes = case.check(runs[case.name])
    assert outcomes
    assert not [outcome.text for outcome in outcomes if not outcome.holds]


@pytest.mark.parametrize('claim', PAPER.claims, ids=lambda claim: claim.text[:3])
def test_a_claim_has_the_verdict_on_record(
    claim: suite.Claim, runs: dict[str, dict[str, Any]]
) -> None:
    verdict, outcomes = claim.judge(runs)
    assert verdict == claim.known, [outcome.text for outcome in outcomes]


def test_the_physical_delay_is_too_much_for_both_laws_unless_rates_come_undelayed() -> None:
    for law in ('pd', 'fls'):
        for place in ('tip', 'mid'):
            physical = scenario.load(f'{law}_{place}_physical')
            assert simulate_row(physical)['outcome'] == 'unstable'
            mended = scenario.load(f'{law}_{place}_physical_encoder_rates')
            assert simulate_row(mended)['outcome'] == 'stable'


@pytest.mark.parametrize('latency', ['0', '0.001238'])
@pytest.mark.parametrize('law', ['pd', 'fls'])
def test_the_true_tip_is_too_much_for_both_laws(law: str, latency: str) -> None:
    config = scenario.load(f'{law}_tip_elastic', [f'tip_sensor.latency={latency}'])
    assert simulate_row(config)['outcome'] == 'unstable'
