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
Suite files: many scenarios, their expectations, and claims about several of them.

A suite is a YAML file::

    # One line that describes it
    defaults:                       # for every case; those of a case are applied after them
      set: {duration: 4}
      expect: {stable: true}
    cases:
      - scenario: fls_tip           # a shipped name, or a file relative to the suite
        name: fls                   # default: the scenario's name
        mode: run                   # run (processes, default), compose or simulate
        set: {controller.kp: 100}
        grid: {tip_sensor.latency: [0.0, 0.001238]}
        expect: {max_overshoot: {lt: 0.5}, ticks: 4000}
        faults: [{at: 2.0, node: controller, action: kill}]
    compare:                        # each must hold, or the suite fails
      - fls.max_error < pd.max_error
    claims:                         # reported one by one: holds, in part, does not hold
      - claim: the FLS overshoots less
        verdict: holds              # the expected one; another verdict fails the suite
        checks: [fls.max_overshoot < pd.max_overshoot]

A case with a ``grid`` becomes one case per combination, named ``fls[latency=0.001238]``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.files import read_text
from flexarm_ros.scenario.locate import find, first_comment, shipped, shipped_suites
from flexarm_ros.scenario.reader import load as load_scenario
from flexarm_ros.scenario.suites.compare import MetricComparison
from flexarm_ros.scenario.suites.expect import CheckResult, Expectation, Metrics, read_expectations
from flexarm_ros.scenario.yaml.rclyaml import parse, Tree
from flexarm_ros.scenario.yaml.treeread import (
    as_list,
    as_map,
    as_number,
    as_text,
    combinations,
    grid_of,
    overrides_of,
)

ACTIONS = ('kill', 'terminate', 'pause', 'delay')
MODES = ('run', 'compose', 'simulate')
VERDICTS = ('holds', 'in part', 'does not hold')
MAX_BYTES = 1024 * 1024
MAX_CASES = 1000


@dataclass(frozen=True)
class Fault:
    """
    A fault of a node at a simulated time.

    ``kill`` is SIGKILL, ``terminate`` SIGTERM, ``pause`` SIGSTOP for the rest of the run,
    ``delay`` SIGSTOP for ``seconds`` of wall time.
    """

    at: float
    node: str
    action: str
    seconds: float = 0.0


@dataclass(frozen=True)
class Case:
    """One run of a suite: the scenario, the mode of execution and the expectations."""

    name: str
    source: Path
    overrides: tuple[str, ...]
    config: RunConfig
    mode: str = 'run'
    expect: tuple[Expectation, ...] = ()
    faults: tuple[Fault, ...] = ()

    def check(self, metrics: Metrics) -> list[CheckResult]:
        """Return the outcome of every expectation, in the file's order."""
        return [expectation.check(metrics) for expectation in self.expect]


@dataclass(frozen=True)
class Claim:
    """A statement about several cases, made of comparisons; it may be known to be false."""

    text: str
    checks: tuple[MetricComparison, ...]
    known: str | None = None

    def judge(self, runs: Mapping[str, Metrics]) -> tuple[str, list[CheckResult]]:
        """Return the verdict (one of ``VERDICTS``, or ``not known``) and each outcome."""
        outcomes = [check.check(runs) for check in self.checks]
        held = [outcome.holds for outcome in outcomes]
        if None in held:
            return 'not known', outcomes
        verdict = 'holds' if all(held) else 'in part' if any(held) else 'does not hold'
        return verdict, outcomes

    def fails(self, verdict: str) -> bool:
        """Return whether ``verdict`` fails the suite, by differing from the expected one."""
        return verdict == 'not known' or (self.known is not None and verdict != self.known)


@dataclass(frozen=True)
class Suite:
    """A complete, checked suite file."""

    name: str
    description: str
    cases: tuple[Case, ...]
    compare: tuple[MetricComparison, ...] = ()
    claims: tuple[Claim, ...] = ()
    paper: bool = False
    """Whether its claims are the paper's, which exclude external nodes: the shipped suite."""


@dataclass(frozen=True)
class _Defaults:
    mode: str = 'run'
    overrides: tuple[str, ...] = ()
    expect: tuple[Expectation, ...] = ()
    scenarios: dict[str, Path] = field(default_factory=dict)


def load(path_or_name: str | Path) -> Suite:
    """
    Read a suite: a file, or the bare name of a shipped one.

    Every case's scenario is read and checked.  Raises ScenarioError, one line.
    """
    path = find(path_or_name, shipped_suites())
    text = read_text(path, MAX_BYTES)
    suite = from_text(text, path.stem, path.resolve().parent, first_comment(path))
    paper = shipped_suites().get('paper')
    return replace(suite, paper=paper is not None and path.resolve() == paper.resolve())


def from_text(text: str, name: str, directory: Path, description: str = '') -> Suite:
    """Read a suite's text; scenarios' paths are relative to ``directory``."""
    try:
        tree = parse(text)
        if tree is None:
            raise ScenarioError('the file is empty; a suite has a list of cases')
        top = as_map(tree, 'suite', ('defaults', 'cases', 'compare', 'claims'))
        if 'cases' not in top:
            raise ScenarioError('cases: missing; a suite has a list of cases')
        defaults = _read_defaults(top.get('defaults'))
        cases = _read_cases(top['cases'], directory, defaults)
        names = [case.name for case in cases]
        compare = _read_comparisons(top.get('compare'), names, 'compare')
        return Suite(name, description, cases, compare, _read_claims(top.get('claims'), names))
    except ScenarioError as error:
        raise ScenarioError(f'{clip(name)}: {error}') from None


def _read_defaults(tree: Tree | None) -> _Defaults:
    if tree is None:
        return _Defaults(scenarios=shipped())
    entries = as_map(tree, 'defaults', ('mode', 'set', 'expect'))
    return _Defaults(
        as_text(entries['mode'], 'defaults.mode', MODES) if 'mode' in entries else 'run',
        overrides_of(entries['set'], 'defaults.set') if 'set' in entries else (),
        read_expectations(entries['expect'], 'defaults.expect') if 'expect' in entries else (),
        shipped(),
    )


def _read_cases(tree: Tree, directory: Path, defaults: _Defaults) -> tuple[Case, ...]:
    cases: list[Case] = []
    seen: set[str] = set()
    for number, item in enumerate(as_list(tree, 'cases')):
        for case in _read_case(item, f'cases[{number}]', directory, defaults):
            if case.name in seen:
                raise ScenarioError(f"cases[{number}]: name '{clip(case.name)}' is used twice")
            seen.add(case.name)
            cases.append(case)
            if len(cases) > MAX_CASES:
                raise ScenarioError(f'cases: more than the {MAX_CASES} cases allowed')
    if not cases:
        raise ScenarioError('cases: none; give at least one')
    return tuple(cases)


def _read_case(tree: Tree, where: str, directory: Path, defaults: _Defaults) -> list[Case]:
    keys = ('name', 'scenario', 'mode', 'set', 'grid', 'expect', 'faults')
    entries = as_map(tree, where, keys)
    if 'scenario' not in entries:
        raise ScenarioError(f'{where}: scenario: missing; a shipped name or a file')
    given = as_text(entries['scenario'], f'{where}.scenario')
    try:
        source = find(given, defaults.scenarios, directory)
    except ScenarioError as error:
        raise ScenarioError(f'{where}.scenario: {error}') from None
    name = as_text(entries['name'], f'{where}.name') if 'name' in entries else source.stem
    if not name.replace('_', '').replace('-', '').replace('.', '').isalnum():
        raise ScenarioError(
            f"{where}.name: '{clip(name)}' is not allowed; letters, digits and . _ - only"
        )
    mode = as_text(entries['mode'], f'{where}.mode', MODES) if 'mode' in entries else defaults.mode
    own = overrides_of(entries['set'], f'{where}.set') if 'set' in entries else ()
    grid = grid_of(entries['grid'], f'{where}.grid', MAX_CASES) if 'grid' in entries else {}
    expect = defaults.expect
    if 'expect' in entries:
        mine = read_expectations(entries['expect'], f'{where}.expect')
        expect = (*(e for e in expect if e.name not in {m.name for m in mine}), *mine)
    made = []
    for point in combinations(grid):
        overrides = (*defaults.overrides, *own, *(f'{key}={text}' for key, text in point.items()))
        full = name + point_name(point)
        config = _config(source, overrides, f"case '{clip(full)}'")
        faults = _read_faults(entries.get('faults'), f'{where}.faults', config, mode)
        made.append(Case(full, source, overrides, config, mode, expect, faults))
    return made


def point_name(point: Mapping[str, str]) -> str:
    """Return a grid point's values as appended to a case's name."""
    if not point:
        return ''
    short = {key: key.rpartition('.')[2] for key in point}
    if len(set(short.values())) < len(short):
        short = {key: key for key in point}
    return '[' + ','.join(f'{short[key]}={text}' for key, text in point.items()) + ']'


def _config(source: Path, overrides: tuple[str, ...], where: str) -> RunConfig:
    try:
        return load_scenario(source, overrides)
    except ScenarioError as error:
        raise ScenarioError(f'{where}: {error}') from None


def _read_faults(
    tree: Tree | None, where: str, config: RunConfig, mode: str
) -> tuple[Fault, ...]:  # fmt: skip
    if tree is None:
        return ()
    if mode != 'run':
        raise ScenarioError(f"{where}: mode '{mode}' starts no processes; use mode 'run'")
    faults = []
    for number, item in enumerate(as_list(tree, where)):
        faults.append(_read_fault(item, f'{where}[{number}]', config))
    return tuple(sorted(faults, key=lambda fault: fault.at))


def _read_fault(tree: Tree, where: str, config: RunConfig) -> Fault:
    entries = as_map(tree, where, ('at', 'node', 'action', 'for'))
    for key in ('at', 'node', 'action'):
        if key not in entries:
            raise ScenarioError(f'{where}.{key}: missing')
    at = as_number(entries['at'], f'{where}.at', 0.0)
    if at >= config.run.duration:
        raise ScenarioError(
            f"{where}.at: {at!r} s is not before the run's end at {config.run.duration!r} s"
        )
    action = as_text(entries['action'], f'{where}.action', ACTIONS)
    if ('for' in entries) != (action == 'delay'):
        raise ScenarioError(f"{where}.for: the seconds of action 'delay', and of no other")
    seconds = as_number(entries['for'], f'{where}.for', 0.0) if 'for' in entries else 0.0
    return Fault(at, as_text(entries['node'], f'{where}.node', roles(config)), action, seconds)


def _read_comparisons(
    tree: Tree | None, names: list[str], where: str
) -> tuple[MetricComparison, ...]:  # fmt: skip
    if tree is None:
        return ()
    texts = [as_text(item, f'{where}[{n}]') for n, item in enumerate(as_list(tree, where))]
    return tuple(
        MetricComparison.parse(text, names, f'{where}[{number}]')
        for number, text in enumerate(texts)
    )


def _read_claims(tree: Tree | None, names: list[str]) -> tuple[Claim, ...]:
    if tree is None:
        return ()
    claims = []
    for number, item in enumerate(as_list(tree, 'claims')):
        where = f'claims[{number}]'
        entries = as_map(item, where, ('claim', 'verdict', 'checks'))
        for key in ('claim', 'checks'):
            if key not in entries:
                raise ScenarioError(f'{where}.{key}: missing')
        known = None
        if 'verdict' in entries:
            known = as_text(entries['verdict'], f'{where}.verdict', VERDICTS)
        checks = _read_comparisons(entries['checks'], names, f'{where}.checks')
        if not checks:
            raise ScenarioError(f'{where}.checks: none; give at least one comparison')
        claims.append(Claim(as_text(entries['claim'], f'{where}.claim'), checks, known))
    return tuple(claims)
