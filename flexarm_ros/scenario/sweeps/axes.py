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
Values of a sweep's axes: listed, evenly spaced, or drawn at random.

Computed times that must be whole nanoseconds are rounded to the nanosecond, integers to the
integer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction
from typing import Any, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import keys, RunConfig, Spec, values_of
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.plugins.registry import find_laws
from flexarm_ros.scenario.reader import find_key, full_name, PACE
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import (
    float_text,
    MappingTree,
    Scalar,
    SequenceTree,
    show,
    Tree,
)
from flexarm_ros.scenario.yaml.treeread import as_integer, as_list, as_map, as_number, yaml_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAX_VALUES = 100_000
"""Largest number of values of one axis."""


@dataclass(frozen=True)
class Parameter:
    """A key that is swept: its section and its type."""

    section: str
    key: str

    @classmethod
    def named(cls, name: str) -> Parameter:
        """Return the parameter of a dotted name; ScenarioError if there is none."""
        section, key = find_key(name)
        if key in PACE:
            raise ScenarioError(f'{name}: cannot be swept: it changes no number of a run')
        return cls(section, key)

    @property
    def spec(self) -> Spec:
        """Return its allowed values; an axis of ``controller.law`` adds the laws that it names."""
        return keys(self.section)[self.key][1]

    @property
    def name(self) -> str:
        """Return the dotted name, without ``/**``."""
        return self.key if self.section == '/**' else full_name(self.section, self.key)

    def value_of(self, config: RunConfig) -> Any:
        """Return its value in a scenario."""
        held = values_of(config, self.section)
        return held[self.key] if self.key in held else keys(self.section)[self.key][2]

    def number_text(self, value: float) -> str:
        """Return a computed number as text, rounded to what the key accepts."""
        if self.spec.kind == 'int':
            return str(round(value))
        if self.spec.whole_ns:
            text = format(Decimal(round(Fraction(value) * 10**9)).scaleb(-9).normalize(), 'f')
            return text if '.' in text else text + '.0'
        return float_text(value)

    def override(self, text: str) -> str:
        """Return an override with a value's text; one number sets both entries of a pair."""
        both = self.spec.kind == 'float2' and not text.startswith('[')
        return f'{full_name(self.section, self.key)}={f"[{text}, {text}]" if both else text}'

    def between(self, first: str, second: str, part: float) -> str:
        """Return the text of a value between two, ``part`` of the way from the first."""
        pair = numbers_in(first), numbers_in(second)
        size = max(map(len, pair))
        both = zip(*(numbers * (size // len(numbers)) for numbers in pair), strict=True)
        texts = [self.number_text(a + part * (b - a)) for a, b in both]
        return texts[0] if size == 1 else f'[{", ".join(texts)}]'

    def check(self, tree: Tree, where: str) -> str:
        """Return a listed value's text after checking it; ScenarioError names ``where``."""
        if (self.section, self.key) == ('controller', 'law') and isinstance(tree, Scalar):
            find_laws(tree.value, (), user=True)
        both = self.spec.kind == 'float2' and isinstance(tree, Scalar)
        convert(where, self.spec, SequenceTree((tree, tree)) if both else tree)
        return yaml_text(tree)

    def check_text(self, text: str, where: str) -> str:
        """Return a computed value's text after checking it."""
        number: int | float = int(text) if self.spec.kind == 'int' else float(text)
        return self.check(Scalar(number, text), where)


def numbers_in(text: str) -> list[float]:
    """Return the numbers of a value's text: one, or those of an array."""
    return [float(part) for part in text.strip('[]').split(',')]


def read_axis(parameter: Parameter, tree: Tree, where: str) -> tuple[str, ...]:
    """Read a grid's axis: a list, ``{from, to, count}``, with ``scale: log``, or ``step``."""
    if isinstance(tree, MappingTree):
        return _steps(parameter, tree, where)
    items = as_list(tree, where)
    if not 1 <= len(items) <= MAX_VALUES:
        raise ScenarioError(f'{where}: {len(items)} values; give 1 to {MAX_VALUES}')
    return tuple(parameter.check(item, f'{where}[{i}]') for i, item in enumerate(items))


def _steps(parameter: Parameter, tree: MappingTree, where: str) -> tuple[str, ...]:
    _needs_number(parameter, where)
    entries = as_map(tree, where, ('from', 'to', 'count', 'step', 'scale'))
    if not {'from', 'to'} <= set(entries) or ('count' in entries) == ('step' in entries):
        raise ScenarioError(f'{where}: give a list, or from, to and either count or step')
    low, high = (_exact(entries[key], f'{where}.{key}') for key in ('from', 'to'))
    scale = entries.get('scale')
    log = scale is not None and show(scale) == "'log'"
    if scale is not None and show(scale) not in ("'log'", "'linear'"):
        raise ScenarioError(f'{where}.scale: {show(scale)} is not allowed; linear or log')
    if 'step' in entries:
        values = _by_step(low, high, _exact(entries['step'], f'{where}.step'), where)
    else:
        count = as_integer(entries['count'], f'{where}.count', 1, MAX_VALUES)
        values = _by_count(low, high, count, log, where)
    texts = [parameter.number_text(value) for value in values]
    return tuple(parameter.check_text(text, f'{where}[{i}]') for i, text in enumerate(texts))


def _needs_number(parameter: Parameter, where: str) -> None:
    if parameter.spec.kind not in ('float', 'int', 'float2'):
        raise ScenarioError(f'{where}: {parameter.name} is not a number; give a list of values')


def _exact(tree: Tree, where: str) -> Fraction:
    return Fraction(Decimal(repr(as_number(tree, where))))


def _by_step(low: Fraction, high: Fraction, step: Fraction, where: str) -> list[float]:
    if step == 0 or (high - low) / step < 0:
        raise ScenarioError(
            f"{where}.step: {float(step):g} does not divide the span from 'from' to 'to'"
        )
    count = (high - low) // step + 1
    if count > MAX_VALUES:
        raise ScenarioError(f'{where}.step: {count} values; at most {MAX_VALUES}')
    return [float(low + i * step) for i in range(count)]


def _by_count(low: Fraction, high: Fraction, count: int, log: bool, where: str) -> list[float]:
    if count == 1:
        return [float(low)]
    if not log:
        return [float(low + (high - low) * i / (count - 1)) for i in range(count)]
    if low <= 0 or high <= 0:
        raise ScenarioError(f"{where}: scale log needs 'from' and 'to' above 0")
    if max(high / low, low / high) > 10**300:
        raise ScenarioError(f"{where}: 'from' and 'to' are too far apart")
    ratio = float(high / low)
    inner = [float(low) * ratio ** (i / (count - 1)) for i in range(1, count - 1)]
    return [float(low), *inner, float(high)]


@dataclass(frozen=True)
class Draw:
    """The distribution of one parameter: ``kind`` and its arguments."""

    parameter: Parameter
    kind: str
    arguments: tuple[Any, ...]
    independent: bool = False

    def texts(self, count: int, seed: int, config: RunConfig) -> list[str]:
        """
        Return ``count`` values as texts, determined by the seed.

        Each parameter has its own generator, seeded by ``seed`` and its name, so that adding
        one does not change the others' values.
        """
        import numpy as np

        name = tuple(full_name(self.parameter.section, self.parameter.key).encode())
        generator = np.random.Generator(
            np.random.PCG64(np.random.SeedSequence(seed, spawn_key=name))
        )
        if self.kind == 'choice':
            return [self.arguments[i] for i in generator.integers(len(self.arguments), size=count)]
        width = 2 if self.independent else 1
        numbers = _DRAWS[self.kind](generator, self.arguments, (count, width))
        if self.kind == 'factor':
            numbers = numbers * np.asarray(self.parameter.value_of(config), dtype=float)
        if not np.isfinite(numbers).all():
            raise ScenarioError(f'{self.parameter.name}: drawn values are not finite')
        rows = numbers.tolist()
        if len(rows[0]) == 1:
            return [self.parameter.number_text(row[0]) for row in rows]
        return ['[' + ', '.join(self.parameter.number_text(x) for x in row) + ']' for row in rows]


_DRAWS: dict[str, Callable[[np.random.Generator, Any, Any], NDArray[np.float64]]] = {
    'uniform': lambda g, a, size: g.uniform(a[0], a[1], size),
    'loguniform': lambda g, a, size: a[0] * (a[1] / a[0]) ** g.uniform(0.0, 1.0, size),
    'normal': lambda g, a, size: g.normal(a[0], a[1], size),
    'factor': lambda g, a, size: g.uniform(a[0], a[1], size),
    'integers': lambda g, a, size: g.integers(int(a[0]), int(a[1]) + 1, size).astype(float),
}


def read_draw(name: str, tree: Tree, config: RunConfig, where: str) -> Draw:
    """Read the distribution of a parameter, such as ``{uniform: [low, high]}``."""
    parameter = Parameter.named(name)
    kinds = (*_DRAWS, 'choice')
    entries = dict(as_map(tree, where, (*kinds, 'independent')))
    flag = entries.pop('independent', None)
    independent = flag is not None and isinstance(flag, Scalar) and flag.value is True
    if len(entries) != 1:
        raise ScenarioError(f'{where}: give exactly one of {", ".join(kinds)}')
    kind, values = next(iter(entries.items()))
    place = f'{where}.{kind}'
    if kind == 'choice':
        texts = read_axis(parameter, values, place)
        return Draw(parameter, kind, texts)
    _needs_number(parameter, place)
    if independent and parameter.spec.kind != 'float2':
        raise ScenarioError(f'{where}.independent: {parameter.name} is one number')
    if kind == 'factor' and parameter.value_of(config) is None:
        raise ScenarioError(f'{place}: the scenario gives no {parameter.name} to multiply')
    arguments = tuple(as_number(item, place) for item in as_list(values, place))
    _check_arguments(kind, arguments, place)
    return Draw(parameter, kind, arguments, independent)


def _check_arguments(kind: str, arguments: tuple[float, ...], where: str) -> None:
    if len(arguments) != 2:
        raise ScenarioError(f'{where}: {len(arguments)} values; it takes two')
    first, second = arguments
    if kind == 'normal':
        if second < 0.0:
            raise ScenarioError(f'{where}: a standard deviation of {second:g} is below 0')
    elif first > second:
        raise ScenarioError(f'{where}: [{first:g}, {second:g}] is not [low, high]')
    if kind == 'loguniform' and first <= 0.0:
        raise ScenarioError(f'{where}: {first:g} must be above 0')
    if kind == 'integers' and not (first.is_integer() and second.is_integer()):
        raise ScenarioError(f'{where}: [{first:g}, {second:g}] are not integers')
    sizes = [abs(value) for value in arguments if value]
    most, least = (2.0**53, 1.0) if kind == 'integers' else (1e100, 1e-100)
    if any(not least <= size <= most for size in sizes):
        raise ScenarioError(f'{where}: {clip(repr(list(arguments)))} is too large or too small')
