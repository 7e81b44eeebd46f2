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

"""Scenario files: ordinary ROS 2 parameter files, read into a checked RunConfig."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
import os
from pathlib import Path
from typing import Any

from flexarm_ros.core.parameters.sections import (
    is_optional,
    keys,
    made,
    PaceParameters,
    RunConfig,
    SECTIONS,
    Spec,
    specs,
    values_of,
    with_section,
)
from flexarm_ros.scenario.check import check
from flexarm_ros.scenario.column_file import is_file, with_columns
from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError, suggestion
from flexarm_ros.scenario.files import read_text
from flexarm_ros.scenario.locate import find
from flexarm_ros.scenario.plugins.declarations import check_plugins, OF_ROS
from flexarm_ros.scenario.plugins.registry import find_laws, find_section, section_names
from flexarm_ros.scenario.torque_file import check_order, HEADER, read_torques, Torques
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import MappingTree, parse, Scalar, show, Tree, tree_of

PathLike = str | os.PathLike[str]
Values = dict[tuple[str, str], Tree]
"""
``{(section, key): value}`` of what was given, before defaults.

`PRESENT` in the place of a key: the scenario has this optional section.
"""

PRESENT = ''
MAX_BYTES = 1024 * 1024
WHOLE_RUN = '/**'
PACE = specs(PaceParameters)


def load(source: PathLike | Iterable[PathLike], overrides: Iterable[str] = ()) -> RunConfig:
    """
    Read a scenario and return it complete and checked.

    ``source`` is a path, the name of a shipped scenario, or several of them (a later file wins, as
    with several ``--params-file``).  ``overrides`` are texts ``node.key=value`` as after
    ``--set``; a key without a node is one of section ``/**``.

    Raises ScenarioError, one line.
    """
    sources = [source] if isinstance(source, (str, os.PathLike)) else list(source)
    values: Values = {}
    torque_base = Path()
    overrides = list(overrides)
    _find_overriding_laws(overrides)
    for item in sources:
        path = find(item)
        given = _read(read_text(path, MAX_BYTES), clip(str(path), PATH_WIDTH), user=True)
        if ('controller', 'torque_file') in given:
            torque_base = path.resolve().parent
        for where in given:
            if is_file(*where):
                given[where] = beside(given[where], path.resolve().parent)
        values.update(given)
    for override in overrides:
        where, tree = parse_override(override)
        if where == ('controller', 'torque_file'):
            torque_base = Path.cwd()
        values[where] = beside(tree, Path.cwd()) if is_file(*where) else tree
    return build(values, torque_base=torque_base)


def beside(path: Tree, base: Path) -> Tree:
    """Return the path of a file in a scenario, made absolute; what is no text stays."""
    if isinstance(path, Scalar) and isinstance(path.value, str):
        return tree_of(str(base / path.value))
    return path


def from_text(
    text: str, torques: Iterable[Iterable[float]] = (), name: str = 'scenario'
) -> RunConfig:
    """
    Read a scenario's text, as it travels in a bag.

    No file is opened: the torques of ``open_loop`` are given as rows.  No module that the text
    names is imported, unless it is installed as an entry point or trusted.
    Raises ScenarioError, one line.
    """
    return build(_read(text, name), torques=check_torques(torques))


def from_dict(
    data: Mapping[str, Any],
    torques: Iterable[Iterable[float]] = (),
    torque_base: Path | None = None,
    user: bool = False,
) -> RunConfig:
    """
    Build a RunConfig from ``{section: {key: value}}``; ``run`` means ``/**``.

    Keys may be dotted or nested, a value ``None`` means left out (so that ``to_dict`` is
    undone).  A torque file is opened only if ``torque_base``, the directory to which its
    path is relative, is given.  ``user``: the data come from the user, so
    that a law ``package.module:Class`` is imported.  Raises ScenarioError, one line.
    """
    values: Values = {}
    for section, body in data.items():
        name = WHOLE_RUN if section == 'run' else str(section)
        if not isinstance(body, Mapping):
            raise ScenarioError(f'{clip(name)}: {clip(repr(body))} is not a map of keys')
        given = _without_none(body.get('ros__parameters', body))
        _take_section(values, name, tree_of(given), '', user)
    if torque_base is not None:
        return build(values, torque_base=torque_base)
    return build(values, torques=check_torques(torques))


def with_values(
    config: RunConfig, overrides: Iterable[str] = (), data: Mapping[str, Any] | None = None
) -> RunConfig:
    """
    Return ``config`` with some keys set anew.

    ``overrides`` are texts as after ``--set``; ``data`` is ``{section: {key: value}}`` as for
    ``from_dict``, a value ``None`` leaving its key out again.  Raises ScenarioError.
    """
    overrides = list(overrides)
    _find_overriding_laws(overrides)
    values = _values_of(config)
    torque_base: Path | None = None
    given: Values = {}
    for section, body in (data or {}).items():
        name = WHOLE_RUN if section == 'run' else str(section)
        if not isinstance(body, Mapping):
            raise ScenarioError(f'{clip(name)}: {clip(repr(body))} is not a map of keys')
        for key in [key for key, value in body.items() if value is None]:
            values.pop(find_key(full_name(name, str(key))), None)
        _take_section(given, name, tree_of(_without_none(body)), '', user=True)
    for override in overrides:
        where, tree = parse_override(override)
        given[where] = tree
    if ('controller', 'torque_file') in given:
        torque_base = Path.cwd()
    values.update(given)
    if torque_base is not None or not config.torques:
        return build(values, torque_base=torque_base or Path.cwd())
    return build(values, torques=config.torques)


def _values_of(config: RunConfig) -> Values:
    values: Values = {}
    for section in SECTIONS:
        known = keys(section)
        for key, value in values_of(config, section).items():
            if key not in known:
                raise ScenarioError(f'{full_name(section, key)}: its law is not registered here')
            if value is not None:
                values[section, key] = tree_of(value)
    for key, (name, _, _) in PACE.items():
        values[WHOLE_RUN, key] = tree_of(getattr(config.pace, name))
    return values


def check_torques(rows: Iterable[Iterable[float]]) -> Torques:
    """Return rows of torques as data, checked as a torque file's rows are."""
    checked: list[tuple[float, float, float]] = []
    for number, row in enumerate(rows):
        place = f'torques: row {number}'
        values = tuple(float(value) for value in row)
        if len(values) != len(HEADER) or any(v - v != 0.0 for v in values):
            raise ScenarioError(f'{place}: {clip(repr(values))} is not three finite numbers')
        checked.append((values[0], values[1], values[2]))
        check_order(checked, place)
    return tuple(checked)


def _without_none(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {key: _without_none(value) for key, value in data.items() if value is not None}
    return data


def parse_override(text: str) -> tuple[tuple[str, str], Tree]:
    """
    Return ``((section, key), value)`` of a text ``node.key=value``.

    Raises ScenarioError naming the key, the value and what is allowed.
    """
    name, equals, value = text.partition('=')
    if not equals or not name.strip():
        raise ScenarioError(f'--set {clip(text)}: give node.key=value')
    name = name.strip()
    try:
        value.encode()
        tree = parse(value)
    except UnicodeEncodeError:
        raise ScenarioError(f'--set {clip(name)}: the value is not UTF-8 text') from None
    except ScenarioError as error:
        reason = str(error).removeprefix('line 1: ')
        raise ScenarioError(f'--set {clip(name)}={clip(value)}: {reason}') from None
    if tree is None:
        raise ScenarioError(f'--set {clip(name)}=: no value; give node.key=value')
    return find_key(name), tree


def _find_overriding_laws(overrides: Iterable[str]) -> None:
    """Register the laws that overrides name: keys of a law may stand before its name."""
    for text in overrides:
        name, _, value = text.partition('=')
        if name.strip().lstrip('/') == 'controller.law':
            find_laws(value.strip().strip('\'"'), (), user=True)


def find_key(name: str) -> tuple[str, str]:
    """
    Return ``(section, key)`` of a dotted name; without a node that of ``/**``.

    Raises ScenarioError with the nearest known name.
    """
    first, dot, rest = name.partition('.')
    first = first if first == WHOLE_RUN else first.lstrip('/')
    section, key = (first, rest) if dot and find_section(first) else (WHOLE_RUN, name)
    if section == 'controller':
        find_laws(None, [key], user=True)
    if key not in known_keys(section):
        raise ScenarioError(f'{clip(name)}: unknown key{_hint(section, key)}')
    return _place(section, key)


def known_keys(section: str) -> dict[str, tuple[str, Spec, Any]]:
    """Return the keys that may stand in a section, those of `PaceParameters` included."""
    own = keys(section)
    return {**own, **PACE} if section in (WHOLE_RUN, 'plant') else own


def _place(section: str, key: str) -> tuple[str, str]:
    """Return the section of a key's value: a key of `PaceParameters` may be in two sections."""
    return (WHOLE_RUN if key in PACE else section), key


def full_name(section: str, key: str) -> str:
    """Return a key's dotted name as it is written in errors and tables."""
    return f'{section}.{key}'


def _hint(section: str, key: str) -> str:
    """Return a hint: the key in another section, or the nearest spelling."""
    before, _, last = key.rpartition('.')
    elsewhere = [
        full_name(other, candidate)
        for other in SECTIONS
        for candidate in (key, last)
        if candidate in known_keys(other)
    ]
    if not before or section != WHOLE_RUN:  # the section is known, or empty
        elsewhere = elsewhere[:1]
    names = [full_name(s, k) for s in SECTIONS for k in known_keys(s)]
    name = full_name(section, key)
    return (
        suggestion(key, elsewhere, cutoff=0.0)
        or suggestion(name, [n for n in names if n.startswith(f'{section}.')])
        or suggestion(name, names)
        or '; docs/reference/parameters.md lists every key'
    )


def _read(text: str, name: str, user: bool = False) -> Values:
    """Return the parameters in the text of a parameter file; errors name ``name``."""
    try:
        tree = parse(text)
        if tree is None:
            raise ScenarioError('the file is empty; a scenario has sections like /** and plant')
        if not isinstance(tree, MappingTree):
            raise ScenarioError(f'{show(tree)} is not a map of sections like /** and plant')
        values: Values = {}
        for section, body in tree.entries.items():
            _read_section(values, section, body, user)
        return values
    except ScenarioError as error:
        raise ScenarioError(f'{name}: {error}') from None


def _read_section(values: Values, section: str, body: Tree, user: bool) -> None:
    name = section if section == WHOLE_RUN else section.removeprefix('/')
    if not find_section(name):
        raise _unknown_section(section, name)
    if not isinstance(body, MappingTree) or set(body.entries) != {'ros__parameters'}:
        raise ScenarioError(f'{clip(section)}: must hold one map, ros__parameters')
    _take_section(values, name, body.entries['ros__parameters'], '', user)


def _take_section(
    values: Values, section: str, tree: Tree, prefix: str, user: bool = False
) -> None:
    """Add a section's keys to ``values``; nested maps make dotted keys."""
    if not find_section(section):
        raise _unknown_section(section, section)
    if not isinstance(tree, MappingTree):
        raise ScenarioError(f'{section}: ros__parameters must be a map of keys, not {show(tree)}')
    if is_optional(section):
        values[section, PRESENT] = tree
    if section == 'controller' and not prefix:
        law = tree.entries.get('law')
        find_laws(law.value if isinstance(law, Scalar) else None, tree.entries, user)
    known = known_keys(section)
    for part, value in tree.entries.items():
        key = prefix + part
        if key in known:
            if (section, key) in values and key not in PACE:
                raise ScenarioError(f'{full_name(section, key)}: given twice')
            values[_place(section, key)] = value
        elif isinstance(value, MappingTree) and any(k.startswith(key + '.') for k in known):
            _take_section(values, section, value, key + '.', user)
        elif is_of_ros(key):
            _check_of_ros(full_name(section, key), value)
        else:
            name = clip(full_name(section, key))
            raise ScenarioError(f'{name}: unknown key{_hint(section, key)}')


def _unknown_section(section: str, name: str) -> ScenarioError:
    known = section_names()
    return ScenarioError(
        f'{clip(section)}: unknown section{suggestion(name, known)} (allowed: {", ".join(known)})'
    )


def is_of_ros(key: str) -> bool:
    """Whether every ROS 2 node has the parameter: rclpy reads it, and a scenario ignores it."""
    return key.partition('.')[0] in OF_ROS


def _check_of_ros(name: str, value: Tree) -> None:
    """Raise ScenarioError if a bool parameter of a ROS 2 node is neither true nor false."""
    switch = 'qos_overrides' not in name
    if switch and not (isinstance(value, Scalar) and isinstance(value.value, bool)):
        raise ScenarioError(f'{clip(name)}: {show(value)} is not allowed: true or false')


def build(
    values: Values, torques: Torques = (), torque_base: Path | None = None, whole: bool = True
) -> RunConfig:
    """
    Return the RunConfig of the given values, with defaults.

    Each value is checked, and with ``whole`` their consistency.  Raises ScenarioError.
    """
    config = RunConfig()
    present = {section for section, _ in values}
    for section in SECTIONS:
        if is_optional(section) and section not in present:
            continue
        given = {}
        for key, (_, spec, _) in keys(section).items():
            if (section, key) in values:
                given[key] = convert(full_name(section, key), spec, values[section, key])
        config = with_section(config, section, made(section, given))
    pace = {
        name: convert(full_name(WHOLE_RUN, key), spec, values[WHOLE_RUN, key])
        for key, (name, spec, _) in PACE.items()
        if (WHOLE_RUN, key) in values
    }
    controller = config.controller
    if controller.law == 'open_loop' and torque_base is not None and controller.torque_file:
        torques = read_torques(torque_base / controller.torque_file)
    elif controller.law != 'open_loop':
        torques = ()
    config = replace(config, torques=torques, pace=PaceParameters(**pace))
    if torque_base is not None:
        config = with_columns(config, torque_base)
    check_plugins(config)
    if whole:
        check(config)
    return config
