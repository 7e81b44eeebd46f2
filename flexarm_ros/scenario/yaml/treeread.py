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

"""Readers of suites and sweeps from a tree, with one-line errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
import itertools

from flexarm_ros.scenario.errors import clip, ScenarioError, suggestion
from flexarm_ros.scenario.yaml.rclyaml import (
    float_text,
    MappingTree,
    quoted,
    Scalar,
    SequenceTree,
    show,
    Tree,
)


def as_map(tree: Tree, where: str, known: Iterable[str] | None = None) -> dict[str, Tree]:
    """Return a map's entries; raise ScenarioError for another type or an unknown key."""
    if not isinstance(tree, MappingTree):
        raise ScenarioError(f'{where}: {show(tree)} is not a map')
    if known is not None:
        known = list(known)
        for key in tree.entries:
            if key not in known:
                hint = suggestion(key, known)
                raise ScenarioError(
                    f"{where}: unknown key '{clip(key)}'{hint} (allowed: {', '.join(known)})"
                )
    return tree.entries


def as_list(tree: Tree, where: str) -> tuple[Tree, ...]:
    """Return an array's items."""
    if not isinstance(tree, SequenceTree):
        raise ScenarioError(f'{where}: {show(tree)} is not a list')
    return tree.items


def as_text(tree: Tree, where: str, choices: Iterable[str] = ()) -> str:
    """Return a text, one of ``choices`` if given; ``on`` or ``5`` count as written."""
    choices = list(choices)
    if not isinstance(tree, Scalar) or not tree.text.strip():
        raise ScenarioError(f'{where}: {show(tree)} is not a text')
    if not tree.text.isprintable():
        raise ScenarioError(f'{where}: {show(tree)} is not printable text')
    if choices and tree.text not in choices:
        raise ScenarioError(
            f"{where}: '{clip(tree.text)}' is not allowed; one of {', '.join(choices)}"
        )
    return tree.text


def as_number(tree: Tree, where: str, low: float | None = None) -> float:
    """Return a finite number, at least ``low`` if given."""
    value = tree.value if isinstance(tree, Scalar) else None
    if isinstance(value, (bool, str)) or value is None:
        raise ScenarioError(f'{where}: {show(tree)} is not a number')
    number = float(value)
    if number - number != 0.0:
        raise ScenarioError(f'{where}: {show(tree)} is not a finite number')
    if low is not None and number < low:
        raise ScenarioError(f'{where}: {show(tree)} is below {low:g}')
    return number


def as_integer(tree: Tree, where: str, low: int, high: int) -> int:
    """Return an integer from ``low`` to ``high``."""
    value = tree.value if isinstance(tree, Scalar) else None
    if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
        raise ScenarioError(f'{where}: {show(tree)} is not an integer from {low} to {high}')
    return value


def yaml_text(tree: Tree) -> str:
    """Return a value as YAML text on one line that reads back the same."""
    if isinstance(tree, Scalar):
        if isinstance(tree.value, str):
            return quoted(tree.value)
        if isinstance(tree.value, float) and not tree.line:
            return float_text(tree.value)
        return tree.text.strip()
    if isinstance(tree, SequenceTree):
        return '[' + ', '.join(yaml_text(item) for item in tree.items) + ']'
    entries = (f'{quoted(key)}: {yaml_text(item)}' for key, item in tree.entries.items())
    return '{' + ', '.join(entries) + '}'


def overrides_of(tree: Tree, where: str) -> tuple[str, ...]:
    """Return ``set``: a map ``node.key: value`` or a list of ``node.key=value``, as texts."""
    if isinstance(tree, SequenceTree):
        return tuple(as_text(item, where) for item in tree.items)
    return tuple(f'{key}={yaml_text(value)}' for key, value in as_map(tree, where).items())


def grid_of(tree: Tree, where: str, limit: int) -> dict[str, tuple[str, ...]]:
    """Return ``grid``: ``{node.key: texts of its values}``; at most ``limit`` combinations."""
    axes: dict[str, tuple[str, ...]] = {}
    count = 1
    for key, values in as_map(tree, where).items():
        items = as_list(values, f'{where}.{clip(key)}')
        if not items:
            raise ScenarioError(f'{where}.{clip(key)}: no values; give at least one')
        axes[key] = tuple(yaml_text(item) for item in items)
        count *= len(items)
        if count > limit:
            raise ScenarioError(f'{where}: more than the {limit} combinations allowed')
    return axes


def combinations(axes: dict[str, tuple[str, ...]]) -> Iterator[dict[str, str]]:
    """Yield every combination of a grid, the last key varying fastest."""
    for values in itertools.product(*axes.values()):
        yield dict(zip(axes, values, strict=True))
