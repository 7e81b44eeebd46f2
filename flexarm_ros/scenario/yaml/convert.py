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

"""Conversion of one value of a scenario from a tree to the type of its Spec."""

from __future__ import annotations

from typing import Any

from flexarm_ros.core.parameters.spec import check, Spec, wrong_kind
from flexarm_ros.scenario.errors import ScenarioError
from flexarm_ros.scenario.yaml.rclyaml import Scalar, SequenceTree, show, Tree

MAX_ITEMS = 10_000
"""Longest array of kind ``floats``."""


def convert(key: str, spec: Spec, tree: Tree) -> Any:
    """
    Return the value of ``key`` in the type of ``spec``.

    Raises ScenarioError naming ``key``, the value and what is allowed.
    """
    try:
        if spec.kind in ('float2', 'floats'):
            return _array(key, spec, tree)
        if isinstance(tree, Scalar):
            return _scalar(key, spec, tree)
        raise wrong_kind(key, spec, show(tree))
    except ValueError as error:
        raise ScenarioError(str(error)) from None


def _array(key: str, spec: Spec, tree: Tree) -> tuple[float, ...]:
    if not isinstance(tree, SequenceTree):
        raise wrong_kind(key, spec, show(tree))
    count = len(tree.items)
    if spec.kind == 'float2' and count != 2:
        raise ValueError(f'{key}: {show(tree)} has {count} values; it takes two')
    if not 1 <= count <= MAX_ITEMS:
        raise ValueError(f'{key}: {count} values; it takes 1 to {MAX_ITEMS}')
    values, one = [], spec.item
    for index, item in enumerate(tree.items):
        if not isinstance(item, Scalar):
            raise wrong_kind(key, spec, show(tree))
        values.append(_scalar(f'{key}[{index}]', one, item))
    return tuple(values)


def _scalar(key: str, spec: Spec, item: Scalar) -> Any:
    return check(key, spec, item.value, show(item), item.text)
