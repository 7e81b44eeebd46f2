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

"""One value of a scenario: from a tree to the type that its Spec asks for."""

from __future__ import annotations

from decimal import Decimal, DecimalException, InvalidOperation, localcontext
import math
import sys
from typing import Any

from flexarm_ros.core.parameters.sections import Spec
from flexarm_ros.scenario.errors import ScenarioError
from flexarm_ros.scenario.yaml.rclyaml import Mapping, Scalar, Sequence, show, Tree

MAX_ITEMS = 10_000
"""Longest array of kind ``floats``."""

_ARTICLES = {
    'float': 'a number',
    'int': 'an integer',
    'bool': 'true or false',
    'str': 'a text',
    'float2': 'an array of two numbers, [first, second]',
    'floats': 'an array of numbers',
}


def allowed(spec: Spec) -> str:
    """Return what a key takes as text: choices or range with its unit."""
    if spec.choices:
        return 'one of ' + ', '.join(spec.choices)
    parts = []
    if spec.low is not None:
        parts.append(f'{"above" if spec.low_open else "at least"} {short(spec.low)}')
    if spec.high is not None:
        parts.append(f'at most {short(spec.high)}')
    bounds = ' and '.join(parts)
    unit = f' {spec.unit}' if spec.unit and bounds else ''
    return bounds + unit


def short(number: float) -> str:
    """Return a bound in as few digits as it needs."""
    return f'{number:.12g}'


def convert(key: str, spec: Spec, tree: Tree) -> Any:
    """
    Return the value of ``key`` in the type of ``spec``.

    Raises ScenarioError naming ``key``, the value and what is allowed.
    """
    if spec.kind in ('float2', 'floats'):
        return _array(key, spec, tree)
    if isinstance(tree, (Mapping, Sequence)):
        raise _wrong(key, spec, tree)
    return _scalar(key, spec, tree)


def _wrong(key: str, spec: Spec, tree: Tree) -> ScenarioError:
    bounds = allowed(spec)
    return ScenarioError(
        f'{key}: {show(tree)} is not {_ARTICLES[spec.kind]}{f" ({bounds})" if bounds else ""}'
    )


def _array(key: str, spec: Spec, tree: Tree) -> tuple[float, ...]:
    if not isinstance(tree, Sequence):
        raise _wrong(key, spec, tree)
    count = len(tree.items)
    if spec.kind == 'float2' and count != 2:
        raise ScenarioError(f'{key}: {show(tree)} has {count} values; it takes two')
    if not 1 <= count <= MAX_ITEMS:
        raise ScenarioError(f'{key}: {count} values; it takes 1 to {MAX_ITEMS}')
    values = []
    for index, item in enumerate(tree.items):
        if not isinstance(item, Scalar):
            raise _wrong(key, spec, tree)
        values.append(_number(f'{key}[{index}]', spec, item))
    return tuple(values)


def _scalar(key: str, spec: Spec, item: Scalar) -> Any:
    value = item.value
    if spec.kind == 'float':
        return _number(key, spec, item)
    if spec.kind == 'bool':
        if isinstance(value, bool):
            return value
        raise _wrong(key, spec, item)
    if spec.kind == 'int':
        if isinstance(value, bool) or not isinstance(value, int):
            raise _wrong(key, spec, item)
        _check_range(key, spec, item, value)
        return value
    if not isinstance(value, str):
        raise _wrong(key, spec, item)
    return _text(key, spec, item, value)


def _text(key: str, spec: Spec, item: Scalar, value: str) -> str:
    if spec.choices and value not in spec.choices:
        raise ScenarioError(f'{key}: {show(item)} is not allowed; {allowed(spec)}')
    if not value or not value.isprintable() or len(value) > 4096:
        raise ScenarioError(f'{key}: {show(item)} is not a printable text of 1 to 4096 characters')
    return value


def _number(key: str, spec: Spec, item: Scalar) -> float:
    if isinstance(item.value, (bool, str)):
        raise _wrong(key, Spec('float', spec.unit, '', low=spec.low, high=spec.high,
                               low_open=spec.low_open), item)  # fmt: skip
    value = float(item.value)
    if not math.isfinite(value):
        raise ScenarioError(f'{key}: {show(item)} is not a finite number ({allowed(spec)})')
    if value != 0.0 and abs(value) < sys.float_info.min:
        raise ScenarioError(f'{key}: {show(item)} is too small a number; use 0')
    _check_range(key, spec, item, value)
    if spec.whole_ns:
        _check_whole_ns(key, item, value)
    return value


def _check_range(key: str, spec: Spec, item: Scalar, value: float) -> None:
    too_low = spec.low is not None and (value < spec.low or (spec.low_open and value == spec.low))
    too_high = spec.high is not None and value > spec.high
    if too_low or too_high:
        raise ScenarioError(f'{key}: {show(item)} is out of range; it must be {allowed(spec)}')


def exact_ns(text: str) -> int | None:
    """Return a decimal text of seconds in nanoseconds, ``None`` if that is not whole."""
    with localcontext() as context:
        context.prec = 60
        try:
            product = Decimal(text).scaleb(9)
        except DecimalException:
            return None
        # More digits than the context holds would have been rounded: compare back.
        if not product.is_finite() or product.adjusted() > 40:
            return None
        whole = product.to_integral_value()
        return int(whole) if whole == product and Decimal(text) == whole.scaleb(-9) else None


def _check_whole_ns(key: str, item: Scalar, value: float) -> None:
    text = item.text if _is_decimal(item.text) else repr(value)
    written, kept = exact_ns(text), exact_ns(repr(value))
    if written is None:
        raise ScenarioError(
            f'{key}: {show(item)} s is not a whole number of nanoseconds (at most 9 decimals)'
        )
    if written != kept:
        raise ScenarioError(
            f'{key}: {show(item)} s cannot be held to the nanosecond by a 64-bit number; use '
            'fewer digits'
        )


def _is_decimal(text: str) -> bool:
    try:
        Decimal(text.strip())
    except InvalidOperation:
        return False
    return True
