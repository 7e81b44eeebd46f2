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
Parameter files as a ROS 2 node reads them: the sections for the node's name.

Sections are chosen and ordered as in rcl: a section applies if its name, wildcards included,
matches the node's fully qualified name; a later section overrides an earlier one, and a section
keeps the position of its first appearance in all the files.  In addition:

- A section named after the role alone (``plant``) applies to that role in every namespace and
  under every name, with lower priority than rcl's.  So one scenario serves any arm of a graph.
- Sections of the other roles in the node's namespace are read too if they name the role: an
  external node reports no parameters, so that a file is the only source.
- An unknown key is an error, since rclpy would ignore a typing mistake.  In a section that ends
  with a wildcard, which applies to other nodes too, keys of the package's other nodes are skipped;
  and if the file also has sections of external nodes, so are keys that do not resemble one of this
  node's (with a note).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
import re
import sys

from flexarm_ros.core.parameters.sections import is_optional, RunConfig, SECTIONS
from flexarm_ros.core.parameters.sections import keys as keys_of
from flexarm_ros.core.run.parts import parts_of
from flexarm_ros.scenario.check import check
from flexarm_ros.scenario.column_file import is_file
from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError, suggestion
from flexarm_ros.scenario.files import read_text
from flexarm_ros.scenario.plugins.registry import find_laws, find_section
from flexarm_ros.scenario.reader import (
    beside,
    build,
    is_of_ros,
    MAX_BYTES,
    PathLike,
    PRESENT,
    WHOLE_RUN,
)
from flexarm_ros.scenario.yaml.rclyaml import MappingTree, parse, Scalar, show, Tree

PARAMETERS = 'ros__parameters'
UNSET = 'null'
"""The text of `ros2 param dump` for a parameter without a value."""


@dataclass(frozen=True)
class NodeName:
    """A node that reads parameter files."""

    role: str
    name: str
    """Fully qualified, after remapping."""
    own: Collection[str] = ()
    """Keys that do not belong to a scenario."""
    others: Mapping[str, Collection[str]] = field(default_factory=dict)
    """Such keys of the package's other nodes, by role."""
    in_run: bool = True
    """Whether the node reads a scenario; if not, it reads its own keys only."""


@dataclass(frozen=True)
class Given:
    """A value and its source: the file, and the number of sources before it."""

    tree: Tree
    place: str
    file: Path | None = None
    """None: the command line."""
    number: int = 0


Section = dict[str, Given]
_PRESENT = Given(MappingTree({}), '')
Files = Collection[Path | None]

_LIST = '; see `ros2 param list`, or docs/reference/parameters.md'


@dataclass
class NodeParameters:
    """Values from parameter files and the command line, before defaults."""

    own: dict[str, Given] = field(default_factory=dict)
    scenario: dict[tuple[str, str], Given] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    """Notes for the user on values that are not used, one line each."""
    whole: bool = False
    """Whether sections of other roles were given."""

    @property
    def torque_base(self) -> Path:
        """Return the directory of relative paths of the torque file."""
        given = self.scenario.get(('controller', 'torque_file'))
        return Path() if given is None or given.file is None else given.file.resolve().parent

    def config(self) -> RunConfig:
        """
        Return the scenario, defaults filled in; ScenarioError if it is invalid.

        Consistency of the sections is checked only if those of other roles were given; otherwise
        these parameters are known once their nodes report them
        (`flexarm_ros.nodes.runtime.joining.config_exchange`).
        """
        values = {
            where: beside(given.tree, given.file.resolve().parent)
            if given.file is not None and is_file(*where)
            else given.tree
            for where, given in self.scenario.items()
        }
        config = build(values, torque_base=self.torque_base, whole=False)
        try:
            parts_of(config)
            check(config)
        except ScenarioError:
            if self.whole:
                raise
        except ValueError as error:
            raise ScenarioError(str(error)) from None
        return config


def matches(section: str, name: str) -> bool:
    """Whether rcl applies the section to a node with the fully qualified ``name``."""
    pattern = re.escape(section if section.startswith('/') else f'/{section}')
    pattern = pattern.replace(r'/\*', r'(/\w+)').replace(r'\*', '*')
    return re.fullmatch(pattern, name, re.ASCII) is not None


def read_sections(files: Iterable[PathLike]) -> dict[str, Section]:
    """Return the sections of several files, each with its keys, in rcl's order."""
    sections: dict[str, Section] = {}
    for number, file in enumerate(map(Path, files)):
        place = f'{clip(str(file), PATH_WIDTH)}: '
        try:
            tree = parse(read_text(file, MAX_BYTES))
            for name, body in _sections('', MappingTree({}) if tree is None else tree):
                keys = sections.setdefault(name, {})
                for key, value in _flat('', body):
                    where = f'{place}{clip(name)}.{clip(key)}'
                    keys[key] = Given(value, where, file, number)
        except ScenarioError as error:
            raise ScenarioError(f'{place}{str(error).removeprefix(place)}') from None
    return sections


def _sections(prefix: str, tree: Tree) -> Iterator[tuple[str, MappingTree]]:
    """Yield ``(name, keys)`` of each section; nested maps are namespaces."""
    if not isinstance(tree, MappingTree):
        raise ScenarioError(f'{clip(prefix or show(tree))}: must be a map with {PARAMETERS}')
    for name, body in tree.entries.items():
        if name != PARAMETERS:
            yield from _sections(f'{prefix.rstrip("/")}/{name}' if prefix else name, body)
        elif isinstance(body, MappingTree) and prefix:
            yield prefix, body
        else:
            raise ScenarioError(f'{clip(prefix)}: {PARAMETERS} must be a map of keys in a section')


def _flat(prefix: str, tree: MappingTree) -> Iterator[tuple[str, Tree]]:
    for name, value in tree.entries.items():
        if isinstance(value, MappingTree):
            yield from _flat(f'{prefix}{name}.', value)
        else:
            yield prefix + name, value


def read_node(
    files: Iterable[PathLike], node: NodeName, assignments: Iterable[tuple[str, str]] = ()
) -> NodeParameters:
    """
    Return the values of ``files`` for ``node``, overridden by ``assignments`` of ``(key, YAML)``.

    Raises ScenarioError, one line, for an unknown key or an invalid parameter file.
    """
    sections = read_sections(files)
    assignments = list(assignments)
    found = NodeParameters()
    if node.in_run:
        named_parts(sections)
        _find_laws(sections, node, assignments)
        if find_section(node.role) and is_optional(node.role):
            found.scenario[node.role, PRESENT] = _PRESENT
        _take_other_roles(found, node, sections)
    for name in _chosen(sections, node.role, node.name):
        _take(found, node, name, sections[name], _shared_files(sections, node))
    for key, text in assignments:
        place = f'{node.role}.{clip(key)}'
        try:
            tree = parse(text)
        except ScenarioError as error:
            reason = str(error).removeprefix('line 1: ')
            raise ScenarioError(f'{place}: {clip(text)}: {reason}') from None
        if tree is None:
            raise ScenarioError(f'{place}: no value; give -p {clip(key)}:=VALUE')
        _take(found, node, node.role, {key: Given(tree, place, None, sys.maxsize)})
    return found


def _take_other_roles(
    found: NodeParameters, node: NodeName, sections: dict[str, Section]
) -> None:  # fmt: skip
    """Add the values of sections named after other roles in the node's own namespace."""
    namespace = node.name.rpartition('/')[0]
    for role in SECTIONS:
        if role in (WHOLE_RUN, node.role):
            continue
        for name in _chosen(sections, role, f'{namespace}/{role}'):
            if not name.endswith('*'):
                found.whole = True
                if is_optional(role):
                    found.scenario[role, PRESENT] = _PRESENT
                known = sections[name].keys() & keys_of(role).keys()
                _put(found, role, {key: sections[name][key] for key in known})


def named_parts(sections: Iterable[str]) -> list[str]:
    """Return the optional parts that names of sections name, in any namespace."""
    names = dict.fromkeys(section.rpartition('/')[2] for section in sections)
    return [name for name in names if find_section(name) and is_optional(name)]


def _find_laws(
    sections: dict[str, Section], node: NodeName, assignments: Iterable[tuple[str, str]]
) -> None:
    """Register the laws that files and command line name: their keys may stand before the law."""
    given = [(key, held.tree) for keys in sections.values() for key, held in keys.items()]
    if node.role == 'controller':
        given += [(key, Scalar(text, text)) for key, text in assignments]
    names = [key for key, _ in given if '.' in key]
    for key, tree in given:
        if key == 'law' and isinstance(tree, Scalar):
            find_laws(str(tree.value).strip('\'"'), (), user=True)
    find_laws(None, names, user=True)


def _chosen(sections: dict[str, Section], role: str, name: str) -> list[str]:
    """Return the sections of a node, in order of ascending priority."""
    matching = [section for section in sections if matches(section, name)]
    return [role, *matching] if role in sections and role not in matching else matching


def _shared_files(sections: dict[str, Section], node: NodeName) -> Files:
    """Return the files that have a section of an external node."""
    ours = {*SECTIONS, *node.others, '*', '**'}
    return {
        given.file
        for section, keys in sections.items()
        if section.rpartition('/')[2] not in ours and not matches(section, node.name)
        for given in keys.values()
    }


def _take(
    found: NodeParameters, node: NodeName, section: str, keys: Section, shared: Files = ()
) -> None:
    """Add a section's keys to what the node has."""
    known = keys_of(node.role) if node.in_run and node.role in SECTIONS else {}
    run = keys_of(WHOLE_RUN) if node.in_run else {}
    for key, given in keys.items():
        if key in node.own:
            before = found.own.get(key)
            found.own[key] = given
        elif key in known or key in run:
            part = node.role if key in known else WHOLE_RUN
            before = found.scenario.get((part, key))
            _put(found, part, {key: given})
        else:
            near = suggestion(key, (*known, *node.own, *run))
            _pass_over(found, node, key, given, near, section.endswith('*'), shared)
            continue
        if before is not None and before.number > given.number:
            found.notes.append(f'{before.place}: not used; {given.place} ranks higher')


def _pass_over(
    found: NodeParameters,
    node: NodeName,
    key: str,
    given: Given,
    near: str,
    wildcard: bool,
    shared: Files,
) -> None:
    """Skip a key that is not the node's; ScenarioError if it is not allowed there."""
    elsewhere = _elsewhere(node, key)
    if is_of_ros(key) or (wildcard and elsewhere):
        return
    if near or not wildcard or given.file not in shared:
        raise ScenarioError(f'{given.place}: unknown key{elsewhere or near or _LIST}')
    found.notes.append(f'{given.place}: no parameter of this package; passed over')


def _elsewhere(node: NodeName, key: str) -> str:
    """Return a hint to another role that has the key; empty if none has."""
    places = [(role, keys_of(role)) for role in SECTIONS]
    names = [f'{role}.{key}' for role, keys in (*places, *node.others.items()) if key in keys]
    return f"; did you mean '{names[0]}'?" if names else ''


def _put(found: NodeParameters, section: str, keys: Section) -> None:
    """Set keys of the scenario; keys without a value in a dump are removed."""
    for key, given in keys.items():
        default = keys_of(section)[key][2]
        found.scenario.pop((section, key), None)
        unset = isinstance(given.tree, Scalar) and given.tree.text == UNSET
        if not (default is None and unset):
            found.scenario[section, key] = given
