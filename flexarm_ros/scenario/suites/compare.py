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

"""Comparisons between the metrics of several runs, as in the claims of a suite."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
import itertools
import math
import operator
from typing import Any

from flexarm_ros.scenario.errors import clip, ScenarioError, suggestion
from flexarm_ros.scenario.suites.expect import CheckResult, known_metric, lookup, Metrics

_BINARY: dict[type, Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
_RELATIONS: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_FUNCTIONS: dict[str, Callable[..., float]] = {'abs': abs, 'min': min, 'max': max}
MAX_COMPARISON = 500
"""Longest text of a comparison, characters."""


class _Missing(Exception):
    """A comparison needs a number that the run does not have."""


@dataclass(frozen=True)
class MetricComparison:
    """
    A relation between metrics of cases, ``fls_tip.max_overshoot < pd_tip.max_overshoot``.

    Both sides consist of ``case.metric``, ``case.metric[index]``, numbers, ``+ - * /``,
    brackets, ``abs``, ``min`` and ``max``.  A case whose name is not an identifier is written
    ``case("name").metric``.
    """

    text: str

    @classmethod
    def parse(cls, text: str, cases: Iterable[str], where: str) -> MetricComparison:
        """Parse a comparison, checking the names of cases; ScenarioError if invalid."""
        made = cls(text)
        try:
            compare = made._tree()
            names = list(cases)
            for side in (compare.left, *compare.comparators):
                _check(side, names)
        except ScenarioError as error:
            raise ScenarioError(f"{where}: '{clip(text)}': {error}") from None
        return made

    def _tree(self) -> ast.Compare:
        if len(self.text) > MAX_COMPARISON:
            raise ScenarioError(f'longer than {MAX_COMPARISON} characters')
        try:
            body = ast.parse(self.text.strip(), mode='eval').body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ScenarioError('not a comparison like a.max_error < b.max_error') from None
        if not isinstance(body, ast.Compare) or any(type(op) not in _RELATIONS for op in body.ops):
            raise ScenarioError('not a comparison; it needs one of < <= > >= == !=')
        return body

    def check(self, runs: Mapping[str, Metrics]) -> CheckResult:
        """Compare the metrics of runs, ``{case: metrics}``."""
        compare = self._tree()
        try:
            sides = [_value(side, runs) for side in (compare.left, *compare.comparators)]
        except (_Missing, ZeroDivisionError, OverflowError) as error:
            reason = str(error) if isinstance(error, _Missing) else 'no finite value'
            return CheckResult(None, f'{self.text}: not known ({reason})')
        if not all(map(math.isfinite, sides)):
            return CheckResult(None, f'{self.text}: not known (no finite value)')
        relations = [_RELATIONS[type(op)] for op in compare.ops]
        pairs = zip(relations, itertools.pairwise(sides), strict=True)
        holds = all(relation(*pair) for relation, pair in pairs)
        shown = ' vs '.join(f'{value:.6g}' for value in sides)
        return CheckResult(holds, f'{self.text}: {shown}')


def _reference(node: ast.expr) -> tuple[str, str, int | None] | None:
    """Return ``(case, metric, index)`` if the node is a metric of a case."""
    index = None
    if isinstance(node, ast.Subscript):
        if not isinstance(node.slice, ast.Constant) or type(node.slice.value) is not int:
            return None
        index, node = node.slice.value, node.value
    if not isinstance(node, ast.Attribute):
        return None
    base = node.value
    if isinstance(base, ast.Name):
        return base.id, node.attr, index
    named = (
        isinstance(base, ast.Call) and isinstance(base.func, ast.Name) and base.func.id == 'case'
    )
    if named and isinstance(base, ast.Call) and len(base.args) == 1 and not base.keywords:
        argument = base.args[0]
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str):
            return argument.value, node.attr, index
    return None


def _check(node: ast.expr, cases: list[str]) -> None:
    reference = _reference(node)
    if reference is not None:
        case, metric, _ = reference
        if case not in cases:
            raise ScenarioError(f"unknown case '{clip(case)}'{suggestion(case, cases)}")
        known_metric(metric, 'metric')
        return
    if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)):
        if isinstance(node.value, bool) or not abs(node.value) < 1e300:
            raise ScenarioError(f'{clip(repr(node.value))} is not a finite number')
        return
    if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
        parts = [node.left, node.right]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        parts = [node.operand]
    elif _is_function(node):
        parts = node.args  # type: ignore[attr-defined]
    else:
        raise ScenarioError('only case.metric, numbers, + - * /, abs, min and max are allowed')
    for part in parts:
        _check(part, cases)


def _is_function(node: ast.expr) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in _FUNCTIONS
        and not node.keywords
        and (len(node.args) == 1 if node.func.id == 'abs' else len(node.args) >= 2)
    )


def _value(node: ast.expr, runs: Mapping[str, Metrics]) -> float:
    reference = _reference(node)
    if reference is not None:
        case, metric, index = reference
        found = lookup(runs.get(case, {}), metric, index)
        if found is None or isinstance(found, (str, list)):
            raise _Missing(f'{case}.{metric}' + (f'[{index}]' if index is not None else ''))
        return float(found)
    if isinstance(node, ast.Constant):
        return float(node.value)  # type: ignore[arg-type]
    if isinstance(node, ast.BinOp):
        return _BINARY[type(node.op)](_value(node.left, runs), _value(node.right, runs))
    if isinstance(node, ast.UnaryOp):
        value = _value(node.operand, runs)
        return -value if isinstance(node.op, ast.USub) else value
    assert isinstance(node, ast.Call)
    assert isinstance(node.func, ast.Name)
    return float(_FUNCTIONS[node.func.id](*(_value(item, runs) for item in node.args)))
