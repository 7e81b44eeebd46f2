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

"""Suite files: cases, expectations, comparisons, claims, and their errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.scenario import ScenarioError
from flexarm_ros.scenario.suites import suite
from flexarm_ros.scenario.suites.compare import MetricComparison
from flexarm_ros.scenario.suites.expect import read_expectations
from flexarm_ros.scenario.yaml.rclyaml import parse
import pytest

HERE = Path(__file__).parent


def read(text: str) -> suite.Suite:
    return suite.from_text(text, 's', HERE)


def outcomes(wanted: str, metrics: dict[str, Any]) -> list[bool | None]:
    tree = parse(wanted)
    assert tree is not None
    return [item.check(metrics).holds for item in read_expectations(tree, 'expect')]


def test_defaults_come_before_a_cases_own() -> None:
    made = read(
        'defaults: {mode: simulate, set: {duration: 4, seed: 1},'
        ' expect: {stable: true, ticks: 1}}\n'
        'cases:\n'
        '  - {scenario: fls_tip, set: {seed: 2, plant.length: [5, 4]}, expect: {ticks: 4000}}\n'
        '  - {scenario: fls_tip, name: other, mode: run, set: [controller.kp=1e2]}\n'
    )
    first, second = made.cases
    assert (first.name, first.mode, second.name, second.mode) == (
        'fls_tip', 'simulate', 'other', 'run',
    )  # fmt: skip
    assert (first.config.run.duration, first.config.run.seed) == (4.0, 2)
    assert first.config.plant.length == (5.0, 4.0)
    assert second.config.controller.kp == 100.0
    assert [str(item) for item in first.expect] == ['stable = true', 'ticks = 4000']
    assert [str(item) for item in second.expect] == ['stable = true', 'ticks = 1']


def test_a_grid_makes_a_case_of_each_combination() -> None:
    made = read(
        'cases:\n  - scenario: fls_tip\n    grid:\n'
        '      tip_sensor.latency: [0, 1.238e-3]\n      plant.hub_inertia: [[8, 8], [10, 10]]\n'
    )
    assert [case.name for case in made.cases] == [
        'fls_tip[latency=0,hub_inertia=[8, 8]]',
        'fls_tip[latency=0,hub_inertia=[10, 10]]',
        'fls_tip[latency=1.238e-3,hub_inertia=[8, 8]]',
        'fls_tip[latency=1.238e-3,hub_inertia=[10, 10]]',
    ]
    last = made.cases[-1].config
    assert (last.tip_sensor.latency, last.plant.hub_inertia) == (0.001238, (10.0, 10.0))


def test_a_scenario_is_a_file_beside_the_suite_or_a_shipped_name(tmp_path: Path) -> None:
    (tmp_path / 'mine.yaml').write_text('/**: {ros__parameters: {duration: 2}}')
    text = 'cases: [{scenario: mine.yaml}, {scenario: pd_tip}]'
    cases = suite.from_text(text, 's', tmp_path).cases
    assert [case.config.run.duration for case in cases] == [2.0, 16.0]
    (tmp_path / 'suite.yaml').write_text(f'# About it\n{text}\n')
    made = suite.load(tmp_path / 'suite.yaml')
    assert (made.name, made.description, len(made.cases)) == ('suite', 'About it', 2)


def test_expectations_hold_or_not() -> None:
    metrics = {
        'stable': True,
        'max_error': 0.5,
        'overshoot': [0.1, 0.3],
        'problem': 'tick 4: gone',
    }
    assert outcomes('{stable: true, max_error: {lt: 0.6, ge: 0.5}}', metrics) == [True] * 3
    assert outcomes('{stable: false, max_error: {gt: 0.5}}', metrics) == [False] * 2
    assert outcomes('{overshoot: {lt: 0.3}}', metrics) == [False]
    assert outcomes("{'overshoot[0]': {lt: 0.3}}", metrics) == [True]
    assert outcomes('{max_error: {between: [0.5, 0.6]}}', metrics) == [True]
    assert outcomes('{max_error: {near: 0.504, rel: 0.01}}', metrics) == [True]
    assert outcomes('{max_error: {near: 0.51, rel: 0.01}}', metrics) == [False]
    assert outcomes('{max_error: {near: 0.51, abs: 0.02}}', metrics) == [True]
    assert outcomes('{problem: {contains: gone}}', metrics) == [True]
    assert outcomes('{max_error: {ne: 0.5}}', metrics) == [False]


@pytest.mark.parametrize(
    'metrics',
    [{}, {'max_error': None}, {'max_error': float('nan')}, {'max_error': float('inf')}],
)
def test_a_number_that_is_not_known_neither_holds_nor_fails(metrics: dict[str, Any]) -> None:
    assert outcomes('{max_error: {lt: 1}}', metrics) == [None]
    assert outcomes("{'overshoot[3]': {lt: 1}}", {'overshoot': [0.0]}) == [None]
    assert outcomes('{overshoot: {lt: 1}}', {'overshoot': [0.0, None]}) == [None]
    compared = MetricComparison.parse('a.max_error < 1', ['a'], 'compare')
    assert compared.check({'a': metrics}).holds is None


def test_null_is_what_a_run_does_not_know() -> None:
    """A run that was broken off is neither stable nor unstable."""
    broken = {'stable': None, 'max_error': None, 'ticks': 7}
    assert outcomes('{stable: null, max_error: {eq: null}}', broken) == [True] * 2
    assert outcomes('{stable: {ne: true}, max_error: {ne: 1.0}}', broken) == [True] * 2
    assert outcomes('{stable: {ne: null}, ticks: null}', broken) == [False] * 2
    assert outcomes('{ticks: {ne: null}}', broken) == [True]
    assert outcomes('{stable: true}', broken) == [None]
    assert outcomes('{stable: null, unstable_tick: null}', {'stable': True}) == [False, True]


RUNS = {
    'a': {'max_error': 2.0, 'overshoot': [0.1, 0.4]},
    'b': {'max_error': 3.0, 'overshoot': [0.3, 0.2]},
    'c[x=1]': {'max_error': 4.0},
}


@pytest.mark.parametrize(
    ('text', 'holds'),
    [
        ('a.max_error < b.max_error', True),
        ('a.max_error > b.max_error', False),
        ('a.max_error <= 2 * b.max_error - 4', True),
        ('a.overshoot[1] > b.overshoot[1]', True),
        ('abs(a.overshoot[0] - b.overshoot[0]) < 0.25', True),
        ('max(a.overshoot[0], a.overshoot[1], 0.0) == 0.4', True),
        ("a.max_error < b.max_error < case('c[x=1]').max_error", True),
        ('-a.max_error != 1e3 / (2 + 3)', True),
        ('a.max_error / (b.max_error - 3) < 1', None),
        ('1e299 * 1e299 < a.max_error', None),
        ('a.overshoot < 1', None),
    ],
)
def test_comparisons_between_cases(text: str, holds: bool | None) -> None:
    outcome = MetricComparison.parse(text, RUNS, 'compare').check(RUNS)
    assert outcome.holds is holds
    assert text in outcome.text


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('a.max_error', 'not a comparison'),
        ('a.max_error <', 'not a comparison'),
        ('d.max_error < 1', "unknown case 'd'"),
        ('a.max_eror < 1', "did you mean 'max_error'"),
        ('a.max_error ** 2 < 1', 'only case.metric'),
        ("__import__('os').system('x') < 1", 'only case.metric'),
        ('a.__class__ < 1', 'unknown metric'),
        ('(lambda: 1)() < 1', 'only case.metric'),
        ('a.max_error in b', 'not a comparison'),
        ('a.overshoot[-1] < 1', 'only case.metric'),
        ('a.overshoot[True] < 1', 'only case.metric'),
        ('True < a.max_error', 'finite'),
        ('a.max_error < 1e999', 'finite'),
        ('(' * 400 + ')' * 90, 'not a comparison'),
        ('1 < ' + '-' * 480 + '1 ', None),
        ('a' * 501, 'longer'),
        ('max(a.max_error) < 1', 'only case.metric'),
        ("'x' < a.max_error", 'only case.metric'),
    ],
)
def test_a_comparison_can_do_nothing_but_compare(text: str, words: str | None) -> None:
    if words is None:
        assert MetricComparison.parse(text, RUNS, 'compare').check(RUNS).holds is False
        return
    with pytest.raises(ScenarioError) as caught:
        MetricComparison.parse(text, RUNS, 'compare')
    assert words in str(caught.value)
    assert '\n' not in str(caught.value)


def claim(checks: str, verdict: str = '') -> suite.Claim:
    known = f', verdict: {verdict}' if verdict else ''
    made = read(
        'cases: [{scenario: pd_tip, name: a}, {scenario: pd_tip, name: b}]\n'
        f'claims: [{{claim: it is so, checks: [{checks}]{known}}}]\n'
    )
    return made.claims[0]


@pytest.mark.parametrize(
    ('checks', 'verdict'),
    [
        ('a.max_error < 3, b.max_error < 4', 'holds'),
        ('a.max_error < 3, b.max_error < 3', 'in part'),
        ('a.max_error < 2, b.max_error < 3', 'does not hold'),
        ('a.max_error < 2, b.rtf < 3', 'not known'),
    ],
)
def test_a_claim_is_judged_and_fails_only_if_the_verdict_is_a_new_one(
    checks: str, verdict: str
) -> None:
    found, lines = claim(checks).judge(RUNS)
    assert (found, len(lines)) == (verdict, 2)
    assert claim(checks).fails(found) is (verdict == 'not known')
    for known in suite.VERDICTS:
        assert claim(checks, known).fails(found) is (known != verdict)


def case(body: str) -> str:
    return f'cases: [{{scenario: pd_tip, {body}}}]'


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', ['empty']),
        ('[1]', ['suite', 'not a map']),
        ('{}', ['cases: missing']),
        ('cases: []', ['cases: none']),
        ('cases: 3', ['cases', '3', 'not a list']),
        ('cases: [{}]', ['cases[0]', 'scenario: missing']),
        ('cases: [{scenario: fls_tpi}]', ['cases[0].scenario', "did you mean 'fls_tip'"]),
        ('case: []', ["unknown key 'case'", "'cases'"]),
        (case('sett: {}'), ['cases[0]', "'sett'", "'set'"]),
        (case('name: a/b'), ['cases[0].name', "'a/b'"]),
        (case('name: ../b'), ['cases[0].name']),
        (case('mode: fast'), ['cases[0].mode', "'fast'", 'run, compose, simulate']),
        (case('set: {plant.modes: 9}'), ["case 'pd_tip'", 'plant.modes', '9', 'at most 6']),
        (case('set: [plant.modes]'), ['plant.modes', 'node.key=value']),
        (case('grid: {plant.modes: []}'), ['cases[0].grid.plant.modes', 'no values']),
        (case('grid: {plant.modes: 3}'), ['cases[0].grid.plant.modes', 'not a list']),
        (case('grid: {plant.modes: [1, 7]}'), ['modes=7', 'plant.modes', 'at most 6']),
        (case('expect: {max_eror: 1}'), ['cases[0].expect', "'max_eror'", "'max_error'"]),
        (case('expect: {max_error: {less: 1}}'), ['expect.max_error', "'less'", 'lt']),
        (case('expect: {max_error: {lt: x}}'), ['max_error.lt', "'x'", 'number']),
        (case('expect: {max_error: {near: 1}}'), ['max_error.near', 'tolerance']),
        (case('expect: {max_error: {rel: 1}}'), ['max_error', 'near']),
        (case('expect: {max_error: {near: 1, rel: -1}}'), ['max_error.rel', '-1']),
        (case('expect: {max_error: {between: [2, 1]}}'), ['max_error.between']),
        (case('expect: {overshoot: [1, 2]}'), ['expect.overshoot', 'index']),
        (case('faults: [{at: 17, node: plant, action: kill}]'), ['faults[0].at', '17', '16.0']),
        (case('faults: [{at: -1, node: plant, action: kill}]'), ['faults[0].at', '-1']),
        (case('faults: [{at: 1, node: plan, action: kill}]'), ['faults[0].node', "'plan'"]),
        (case('faults: [{at: 1, node: plant, action: hurt}]'), ['faults[0].action', "'hurt'"]),
        (case('faults: [{at: 1, node: plant, action: delay}]'), ['faults[0].for', 'delay']),
        (case('faults: [{node: plant, action: kill}]'), ['faults[0].at', 'missing']),
        (
            case('mode: simulate, faults: [{at: 1, node: plant, action: kill}]'),
            ['faults', "'simulate'"],
        ),
        ('cases: [{scenario: pd_tip}, {scenario: pd_tip}]', ["'pd_tip'", 'twice']),
        ('cases: [{scenario: pd_tip}]\ncompare: [a.rtf < 1]', ['compare[0]', "unknown case 'a'"]),
        ('cases: [{scenario: pd_tip}]\nclaims: [{claim: x}]', ['claims[0].checks', 'missing']),
        (
            'cases: [{scenario: pd_tip}]\n'
            'claims: [{claim: x, checks: [pd_tip.rtf < 1], verdict: y}]',
            ['claims[0].verdict', "'y'", 'holds'],
        ),
        (case('grid: {seed: [' + '1, ' * 1001 + '1]}'), ['grid', '1000']),
    ],
)
def test_an_error_names_where_it_is(text: str, words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        read(text)
    found = str(caught.value)
    assert '\n' not in found
    assert not [word for word in words if word not in found], found


def test_faults_are_read_in_order_of_time() -> None:
    made = read(
        case(
            'faults: [{at: 2, node: plant, action: kill},'
            ' {at: 0.5, node: controller, action: delay, for: 1.5}]'
        )
    )
    assert made.cases[0].faults == (
        suite.Fault(0.5, 'controller', 'delay', 1.5),
        suite.Fault(2.0, 'plant', 'kill'),
    )


@pytest.mark.parametrize('name', sorted(scenario.shipped_suites()))
def test_the_shipped_suites_can_be_read(name: str) -> None:
    made = suite.load(name)
    assert made.description
    assert made.cases
