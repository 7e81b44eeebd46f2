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
The scenario in a bag, possibly written by a newer version or with packages not installed here.

Parts that this version does not know are left out and reported; nothing that a bag names is
imported.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

from flexarm_ros.core.parameters.sections import is_optional, keys, RunConfig
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.plugins.registry import find_section
from flexarm_ros.scenario.reader import (
    build,
    check_torques,
    from_text,
    is_of_ros,
    PRESENT,
    Values,
    WHOLE_RUN,
)
from flexarm_ros.scenario.yaml.rclyaml import MappingTree, parse, Scalar, Tree

RECORDER = 'recorder'
"""The section that no message depends on."""


@dataclass(frozen=True)
class Recorded:
    """
    A recorded scenario as far as this version knows it.

    ``unknown``: section -> its unknown parts.  An unknown ``controller.law`` keeps its name in
    ``config``, for which no law can be created.
    """

    config: RunConfig
    unknown: dict[str, list[str]] = field(default_factory=dict)


def from_recorded(
    text: str, torques: Iterable[Iterable[float]] = (), name: str = 'scenario'
) -> Recorded:
    """
    Read the scenario's text in a bag; raises ScenarioError if it is invalid.

    It is invalid if a known section is wrong: a bad value does not indicate another version.
    """
    rows = tuple(tuple(row) for row in torques)
    try:
        return Recorded(from_text(text, rows, name))
    except ScenarioError:
        values, unknown = _known_values(parse(text))
        if not unknown:
            raise
    law = values.get(_LAW)
    external_law = law.value if isinstance(law, Scalar) and _not_a_choice(*_LAW, law) else None
    if external_law is not None:
        del values[_LAW]
    try:
        config = build(values, torques=check_torques(rows))
    except ScenarioError as error:
        raise ScenarioError(f'{name}: {error}') from None
    if isinstance(external_law, str):
        config = replace(config, controller=replace(config.controller, law=external_law))
    return Recorded(config, unknown)


_LAW = ('controller', 'law')


def _known_values(tree: Tree | None) -> tuple[Values, dict[str, list[str]]]:
    values: Values = {}
    unknown: dict[str, list[str]] = {}
    for section, body in tree.entries.items() if isinstance(tree, MappingTree) else ():
        name = section if section == WHOLE_RUN else section.removeprefix('/')
        try:
            known = find_section(name)
        except ScenarioError as error:  # a part that is installed here and cannot be used
            unknown[name] = [str(error)]
            continue
        if not known:
            unknown[name] = ['unknown section']
            continue
        held = body.entries.get('ros__parameters') if isinstance(body, MappingTree) else None
        if not isinstance(held, MappingTree):
            continue
        if is_optional(name):
            values[name, PRESENT] = held
        for key, value in _flat(name, held, ''):
            if key not in keys(name):
                unknown.setdefault(name, []).append(f'unknown key {clip(key)}')
            elif _not_a_choice(name, key, value):
                hint = _trust_hint(value) if (name, key) == _LAW else ''
                unknown.setdefault(name, []).append(f'{key}: {_shown(value)} is not known{hint}')
                if (name, key) == _LAW:
                    values[name, key] = value
            else:
                values[name, key] = value
    return values, unknown


def _flat(section: str, tree: MappingTree, prefix: str) -> Iterator[tuple[str, Tree]]:
    """Yield dotted keys: those that are known, and of an unknown map its name alone."""
    known = keys(section)
    for part, value in tree.entries.items():
        key = prefix + part
        if isinstance(value, MappingTree) and any(k.startswith(key + '.') for k in known):
            yield from _flat(section, value, key + '.')
        elif key in known or not is_of_ros(key):
            yield key, value


def _not_a_choice(section: str, key: str, value: Tree) -> bool:
    """Return whether a text is none of those that the key takes here."""
    choices = keys(section)[key][1].choices
    text = value.value if isinstance(value, Scalar) else None
    return bool(choices) and isinstance(text, str) and text not in choices


def _trust_hint(law: Tree) -> str:
    """Return how a law that names its module could be used."""
    text = law.value if isinstance(law, Scalar) else None
    if not isinstance(text, str) or ':' not in text:
        return ''
    return f' (--trust {clip(text.partition(":")[0])} uses it)'


def _shown(value: Tree) -> str:
    return clip(str(value.value)) if isinstance(value, Scalar) else 'a value'
