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
Control laws and parts from outside this package: found, imported, checked and registered.

A part is named by an installed entry point of the group ``flexarm_ros.parts``; it is imported
where a scenario has the section of that name, and in no other way.

A law is named by an installed entry point of the group ``flexarm_ros.laws``, or as
``package.module:Class``.  The second is imported only if a scenario file, an override or a call
of the user names it, never because a bag or another node does.  For those an entry point of that
value is needed, or `trust`; the laws of this package need neither.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
import importlib
from importlib.metadata import entry_points, EntryPoint
from typing import Any

from flexarm_ros.core.parameters.sections import OWN_LAWS, RunConfig, SECTIONS, specs
from flexarm_ros.core.run.parts import known_parts, PARTS, register_part
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.plugins.declarations import check_defaults, check_parameters, check_part

LAW_GROUP = 'flexarm_ros.laws'
PART_GROUP = 'flexarm_ros.parts'
_RESERVED = ('run', 'compose', 'node', 'player', 'viewer')
"""Names that no part may have: of sections in Python, and of other executables."""
_trusted = {'flexarm_ros.core.control'}
"""Modules, or packages, whose laws a bag may name: those of this package have no side effects."""


@cache
def installed_laws() -> dict[str, EntryPoint]:
    """Return the entry points of laws by name, the `ignored` left out; nothing is imported."""
    return _installed(LAW_GROUP)


@cache
def installed_parts() -> dict[str, EntryPoint]:
    """Return the entry points of parts by name, the `ignored` left out; nothing is imported."""
    return _installed(PART_GROUP)


def _installed(group: str) -> dict[str, EntryPoint]:
    points, ours = entry_points(group=group), _names_of_ours(group)
    return {point.name: point for point in points if point.name not in ours}


def ignored(group: str) -> list[EntryPoint]:
    """Return the entry points whose name a law, a part or an executable of this package has."""
    ours = _names_of_ours(group)
    return [point for point in entry_points(group=group) if point.name in ours]


def _names_of_ours(group: str) -> set[str]:
    if group == LAW_GROUP:
        return {*specs(SECTIONS['controller'])['law'][1].choices}
    return {*(part.NAME for part in PARTS), *_RESERVED}


def _check_one(group: str, name: str) -> None:
    """Raise ScenarioError if two installed packages have this name with different values."""
    values = {point.value: package_of(point) for point in entry_points(group=group, name=name)}
    if len(values) > 1:
        found = ', '.join(f'{value} of {package}' for value, package in sorted(values.items()))
        raise ScenarioError(
            f'{clip(name)}: {len(values)} installed packages have this name in {group}: '
            f'{found}; remove one'
        )


def package_of(point: EntryPoint) -> str:
    """Return the name of the distribution that an entry point comes from."""
    return point.dist.metadata['Name'] if point.dist is not None else ''


def role_names() -> list[str]:
    """Return the role of every part that a scenario here may have; nothing is imported."""
    return list(dict.fromkeys([*(part.NAME for part in known_parts()), *installed_parts()]))


def section_names() -> list[str]:
    """Return the sections that a scenario here may have; nothing is imported."""
    return list(dict.fromkeys([*SECTIONS, *installed_parts()]))


def find_section(name: str) -> bool:
    """
    Return whether a scenario may have the section ``name``.

    An installed part of that name is imported and registered.  Raises ScenarioError where it
    cannot be imported or is no part.
    """
    if name in SECTIONS:
        return True
    point = installed_parts().get(name) if name.isidentifier() else None
    if point is None:
        return False
    _check_one(PART_GROUP, name)
    where = f'{clip(name)} ({point.value})'
    part = _imported(where, point.module, point.attr)
    check_part(where, name, part)
    register_part(part)
    return True


def trust(modules: Iterable[str]) -> None:
    """Let bags name laws of these modules, ``package.module`` or a package, in this process."""
    _trusted.update(modules)


def find_laws(law: object, names: Iterable[str], user: bool) -> None:
    """
    Import and register what a section ``controller`` needs.

    ``law`` is the value of its key ``law``, ``names`` are its keys, of which the first part may
    name an installed law.  ``user``: the name comes from the user, so that
    ``package.module:Class`` is imported.  What is not found is left to the check of keys and
    values.  Raises ScenarioError where a law cannot be imported or is none.
    """
    known = specs(SECTIONS['controller'])
    if isinstance(law, str) and law not in known['law'][1].choices:
        _find_law(law, user)
    prefixes = {name.partition('.')[0] for name in names} - {
        own.prefix for own in OWN_LAWS.values()
    }
    for prefix in prefixes - {key.partition('.')[0] for key in known}:
        if prefix in installed_laws():
            _find_law(prefix, user)


def find_plugins_of(config: RunConfig) -> None:
    """Register the laws and parts of a user's scenario that came from another process."""
    for section, _ in config.further:
        find_section(section)
    held = (f'{prefix}.' for prefix, _ in config.controller.laws)
    find_laws(config.controller.law, held, user=True)


def _find_law(law: str, user: bool) -> None:
    if law in OWN_LAWS:
        return
    if law in installed_laws():
        _check_one(LAW_GROUP, law)
        point = installed_laws()[law]
        register(_imported(_of_law(law), point.module, point.attr), law)
    elif ':' in law and (user or _is_trusted(law)):
        module, _, attribute = law.partition(':')
        register(_imported(_of_law(law), module, attribute), law)
    elif user and installed_laws():
        choices = (*specs(SECTIONS['controller'])['law'][1].choices, *installed_laws())
        raise ScenarioError(
            f'controller.law: {clip(law)!r} is not allowed; one of {", ".join(choices)}, or '
            'package.module:Class'
        )


def _is_trusted(law: str) -> bool:
    module = law.partition(':')[0]
    return any(f'{module}.'.startswith(f'{name}.') for name in _trusted) or any(
        point.value == law for point in installed_laws().values()
    )


def _of_law(law: str) -> str:
    return f'controller.law: {clip(law)}'


def _imported(where: str, module: str, attribute: str) -> Any:
    parts = [*module.split('.'), *attribute.split('.')]
    if not all(part.isidentifier() for part in parts):
        raise ScenarioError(f'{where}: give package.module:Class')
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split('.'):
            found = getattr(found, part)
    except (Exception, SystemExit) as error:  # whatever the module does when it is imported
        text = clip(' '.join(f'{type(error).__name__}: {error}'.split()), 200)
        hint = ''
        if isinstance(error, ModuleNotFoundError):
            hint = ' (is it installed, or its directory on PYTHONPATH?)'
        raise ScenarioError(f'{where}: cannot be imported: {text}{hint}') from None
    return found


def register(law: Any, name: str = '') -> str:
    """
    Check a law's class, let scenarios name it, and return its name.

    ``name`` is an entry point's, or ``package.module:Class``; left out, the class's own is taken.
    A class of the same name is replaced if it is of the same module, as in a notebook that
    defines it anew.  Raises ScenarioError.
    """
    from flexarm_ros.core.control import LAWS, register_law

    where = _of_law(name or repr(law))
    _check_class(where, law)
    own_name = law.NAME or law.__name__
    name = name or own_name
    prefix = own_name if ':' in name else name
    if not prefix.isidentifier() or not prefix.isascii():
        raise ScenarioError(f'{where}: {clip(prefix)!r} is not a name of letters, digits and _')
    if prefix in {key.partition('.')[0] for key in specs(SECTIONS['controller'])} | {
        *specs(SECTIONS['controller'])['law'][1].choices
    }:
        raise ScenarioError(f"{where}: {prefix} is a name of this package's; give it another NAME")
    for other, own in OWN_LAWS.items():
        before = LAWS[other]
        same = (before.__module__, before.__qualname__) == (law.__module__, law.__qualname__)
        if own.prefix == prefix and not same:
            raise ScenarioError(
                f'{where}: the name {prefix} is taken by {before.__module__}:{before.__qualname__}'
            )
    check_defaults(f'controller.{prefix}', law.Parameters)
    register_law(name, law, prefix)
    return name


def _check_class(where: str, law: Any) -> None:
    from flexarm_ros.core.control import Law

    if not isinstance(law, type) or not issubclass(law, Law):
        raise ScenarioError(f'{where}: not a subclass of flexarm_ros.core.control.Law')
    check_parameters(where, law.Parameters)
