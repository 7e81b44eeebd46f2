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
Expectations of a suite on a run's metrics.

A metric is a key of ``summary.json``.  For a metric with several values (``overshoot``: one per
direction switch) all are given in order, or one is selected by an index from 0,
``overshoot[1]``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import math
import operator
import re
from typing import Any

from flexarm_ros.core.run.results.metric_list import NUMBERS
from flexarm_ros.scenario.errors import clip, ScenarioError, suggestion
from flexarm_ros.scenario.yaml.rclyaml import MappingTree, Scalar, SequenceTree, show, Tree
from flexarm_ros.scenario.yaml.treeread import as_list, as_map, as_number

Metrics = Mapping[str, Any]

METRICS = (
    'stable', *(metric.name for metric in NUMBERS), 'complete', 'unstable_tick', 'problem',
    'status',
)  # fmt: skip
"""Names that may be expected: those of ``summary.json``, and ``status``, the exit status of the
run alone."""

_REFERENCE = re.compile(r'([A-Za-z_][A-Za-z0-9_]*)(?:\[(\d{1,4})\])?')
_COMPARE: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
    'eq': ('=', operator.eq),
    'ne': ('!=', operator.ne),
    'lt': ('<', operator.lt),
    'le': ('<=', operator.le),
    'gt': ('>', operator.gt),
    'ge': ('>=', operator.ge),
}
OPERATORS = (*_COMPARE, 'near', 'between', 'contains')


def known_metric(name: str, where: str) -> tuple[str, int | None]:
    """Return ``(metric, index)`` of ``name`` or ``name[index]``; ScenarioError if unknown."""
    match = _REFERENCE.fullmatch(name)
    if match is None or match[1] not in METRICS:
        hint = suggestion(name, METRICS)
        raise ScenarioError(
            f"{where}: unknown metric '{clip(name)}'{hint} (allowed: {', '.join(METRICS)})"
        )
    return match[1], int(match[2]) if match[2] else None


@dataclass(frozen=True)
class CheckResult:
    """Whether an expectation holds (``None``: a number is missing), and a line of explanation."""

    holds: bool | None
    text: str


@dataclass(frozen=True)
class Expectation:
    """One condition on one metric of a case."""

    metric: str
    index: int | None
    op: str
    value: Any
    tolerance: float = 0.0

    @property
    def name(self) -> str:
        """Return the metric as written, with its index."""
        return self.metric if self.index is None else f'{self.metric}[{self.index}]'

    def __str__(self) -> str:
        if self.op == 'near':
            return f'{self.name} = {self.value:.6g} +- {self.tolerance:.3g}'
        if self.op == 'between':
            return f'{self.value[0]:.6g} <= {self.name} <= {self.value[1]:.6g}'
        sign = _COMPARE[self.op][0] if self.op in _COMPARE else self.op
        return f'{self.name} {sign} {format_value(self.value)}'

    def check(self, metrics: Metrics) -> CheckResult:
        """
        Compare with a run's metrics.

        An unknown metric fulfils ``null`` and every ``ne`` except that of ``null``.
        """
        found = lookup(metrics, self.metric, self.index)
        if found is None and (self.op == 'ne' or (self.op == 'eq' and self.value is None)):
            return CheckResult(_COMPARE[self.op][1](None, self.value), f'{self}: null')
        if found is None:
            return CheckResult(None, f'{self}: not known')
        items = found if isinstance(found, list) else [found]
        holds = bool(items) and all(self._holds(item) for item in items)
        return CheckResult(holds, f'{self}: {format_value(found)}')

    def _holds(self, item: Any) -> bool:
        if self.op == 'contains':
            return str(self.value) in str(item)
        if self.op in ('eq', 'ne'):
            return _COMPARE[self.op][1](item, self.value)
        if isinstance(item, (str, bool)) or item is None:
            return False
        if self.op == 'near':
            return bool(abs(item - self.value) <= self.tolerance)
        if self.op == 'between':
            return bool(self.value[0] <= item <= self.value[1])
        return _COMPARE[self.op][1](item, self.value)


def lookup(metrics: Metrics, name: str, index: int | None) -> Any:
    """Return a metric, or ``None`` if it is missing, null, not finite or shorter."""
    found = metrics.get(name)
    if isinstance(found, (list, tuple)):
        found = list(found)
        if index is not None:
            found = found[index] if index < len(found) else None
    elif index is not None:
        found = None
    items = found if isinstance(found, list) else [found]
    if not items or any(
        x is None or (isinstance(x, float) and not math.isfinite(x)) for x in items
    ):
        return None
    return found


def format_value(value: Any) -> str:
    """Return a metric's value with few digits."""
    if isinstance(value, float):
        return f'{value:.6g}'
    if isinstance(value, (list, tuple)):
        return '[' + ', '.join(format_value(item) for item in value) + ']'
    if isinstance(value, bool):
        return str(value).lower()
    return 'null' if value is None else str(value)


def read_expectations(tree: Tree, where: str) -> tuple[Expectation, ...]:
    """Read ``expect``: ``{metric: value}`` or ``{metric: {operator: value, ...}}``."""
    found: list[Expectation] = []
    for name, wanted in as_map(tree, where).items():
        metric, index = known_metric(name, where)
        place = f'{where}.{name}'
        if isinstance(wanted, MappingTree):
            found += _conditions(metric, index, wanted, place)
        else:
            found.append(Expectation(metric, index, 'eq', _literal(wanted, place)))
    return tuple(found)


def _literal(tree: Tree, where: str) -> Any:
    if isinstance(tree, SequenceTree):
        raise ScenarioError(f'{where}: {show(tree)}: expect one item by its index, name[0]')
    assert isinstance(tree, Scalar)
    if isinstance(tree.value, float):
        return as_number(tree, where)
    return None if tree.value == 'null' else tree.value  # a text in rcl's YAML


def _conditions(
    metric: str, index: int | None, tree: MappingTree, where: str
) -> Iterable[Expectation]:  # fmt: skip
    entries = as_map(tree, where, (*OPERATORS, 'abs', 'rel'))
    tolerances = {'abs', 'rel'} & set(entries)
    if tolerances and 'near' not in entries:
        raise ScenarioError(f"{where}: 'abs' and 'rel' are tolerances of 'near', which is missing")
    if not entries:
        raise ScenarioError(f'{where}: no condition (allowed: {", ".join(OPERATORS)})')
    for op, value in entries.items():
        place = f'{where}.{op}'
        if op in ('abs', 'rel'):
            continue
        if op == 'near':
            yield _near(metric, index, entries, where)
        elif op == 'between':
            bounds = tuple(as_number(item, place) for item in as_list(value, place))
            if len(bounds) != 2 or bounds[0] > bounds[1]:
                raise ScenarioError(f'{place}: {show(value)} is not [low, high]')
            yield Expectation(metric, index, op, bounds)
        elif op in ('eq', 'ne', 'contains'):
            yield Expectation(metric, index, op, _literal(value, place))
        else:
            yield Expectation(metric, index, op, as_number(value, place))


def _near(
    metric: str, index: int | None, entries: dict[str, Tree], where: str
) -> Expectation:  # fmt: skip
    value = as_number(entries['near'], f'{where}.near')
    if 'abs' not in entries and 'rel' not in entries:
        raise ScenarioError(f"{where}.near: give a tolerance beside it, 'abs' or 'rel'")
    absolute = as_number(entries['abs'], f'{where}.abs', 0.0) if 'abs' in entries else 0.0
    relative = as_number(entries['rel'], f'{where}.rel', 0.0) if 'rel' in entries else 0.0
    return Expectation(metric, index, 'near', value, max(absolute, relative * abs(value)))
