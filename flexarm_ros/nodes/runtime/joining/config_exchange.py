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

"""How the nodes of a run agree on a scenario: each publishes its section and merges all."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
import json
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import (
    keys,
    made,
    RunConfig,
    RunParameters,
    SECTIONS,
    specs,
    values_of,
    with_section,
)
from flexarm_ros.scenario.errors import clip
from flexarm_ros.scenario.plugins.registry import find_laws


class Disagreement(ValueError):
    """Two nodes of a run differ in a shared parameter, or a node's parameters are invalid."""


def dump_sections(config: RunConfig, role: str) -> str:
    """
    Return the common section and that of ``role`` as JSON (floats read back exactly).

    ``optional`` lists the optional parts of the scenario, if any.
    """
    sections: dict[str, Any] = {'run': values_of(config, '/**')}
    if role in SECTIONS:
        sections[role] = values_of(config, role)
    if config.further:
        sections['optional'] = _optional(config)
    return json.dumps(sections)


def _optional(config: RunConfig) -> list[str]:
    return [name for name, _ in config.further]


def merge_sections(own: RunConfig, published: Mapping[str, tuple[str, str]]) -> RunConfig:
    """
    Return ``own`` with each peer's section as the peer published it.

    ``published`` maps a role to its node's name and its sections as JSON.  Raises
    Disagreement if a common parameter or the list of optional parts differs, or if a node's
    sections are not valid in a scenario: they come over the network and are checked like a file.
    """
    merged = own
    for role, (node, text) in published.items():
        if role not in SECTIONS:
            continue
        try:
            sections = json.loads(text)
            common = _section('/**', sections['run'])
            optional = [str(name) for name in sections.get('optional', [])]
            held = _section(role, sections[role])
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
            raise Disagreement(f'{node} publishes no parameters of a {role}') from None
        for item in fields(RunParameters):
            here, there = getattr(own.run, item.name), getattr(common, item.name)
            if here != there:
                raise Disagreement(f'/**.{item.name} is {here!r} here and {there!r} in {node}')
        if optional != _optional(own):
            parts = [', '.join(names) or 'none' for names in (_optional(own), optional)]
            raise Disagreement(
                f'optional parts of the scenario: {parts[0]} here and {clip(parts[1])} in {node}'
            )
        merged = with_section(merged, role, held)
    return _checked(merged)


def published_config(own: RunConfig, published: Mapping[str, tuple[str, str]]) -> RunConfig:
    """
    Return the scenario published by the nodes, for a viewer without one; ``own`` fills gaps.

    ``published`` as for `merge_sections`, with the plant's.  Torques of an open loop
    are not in a status, an external controller publishes none, and a law of another package may
    not be installed here: the law then counts as one without lambda.  Optional parts are left
    out until all of them have published; one that is not installed here leaves all out.
    """
    own = replace(own, further=())
    try:
        shared = json.loads(published['plant'][1])
        common = _section('/**', shared['run'])
        optional = [str(name) for name in shared.get('optional', [])]
        law = json.loads(published['controller'][1]) if 'controller' in published else {}
        known = all(name in published and name in SECTIONS for name in optional)
        if law and not known:
            law['controller']['deflection_source'] = 'plant'  # the gauges are left out
        if law and not _is_flyable(law['controller']):
            own_keys = specs(SECTIONS['controller'])
            kept = {key: value for key, value in law['controller'].items() if key in own_keys}
            law['controller'] = {**kept, 'law': 'pd', 'torque_file': None}
        if law:
            published = {**published, 'controller': (published['controller'][0], json.dumps(law))}
    except (ValueError, TypeError, LookupError, AttributeError, RecursionError):
        raise Disagreement('the published parameters are not a scenario') from None
    if not law:
        own = replace(own, controller=replace(own.controller, law='pd', torque_file=None))
    if known:
        for name in optional:
            own = with_section(own, name, SECTIONS[name]())
    else:
        published = {
            role: (node, _required(text))
            for role, (node, text) in published.items()
            if role not in optional
        }
    return merge_sections(replace(own, run=common), published)


def _required(text: str) -> str:
    """Return a node's published sections without the list of optional parts."""
    try:
        return json.dumps({k: v for k, v in json.loads(text).items() if k != 'optional'})
    except (ValueError, AttributeError, RecursionError):
        return text  # rejected by `merge_sections`


def _is_flyable(controller: Mapping[str, Any]) -> bool:
    """Whether a law can be created from the controller's published parameters."""
    law = controller['law']
    find_laws(law, controller, user=False)
    return law != 'open_loop' and law in keys('controller')['law'][1].choices


def _checked(config: RunConfig) -> RunConfig:
    """Return ``config`` read again: types, ranges and the checks of a whole scenario."""
    try:
        return scenario.from_dict(scenario.to_dict(config), config.torques)
    except (ValueError, TypeError) as error:
        raise Disagreement(str(error)) from None


def _section(name: str, values: Mapping[str, Any]) -> Any:
    """Return a section from its JSON, with lists as tuples."""
    if name == 'controller':  # a peer names no module to import
        find_laws(values['law'], values, user=False)
    return made(name, {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()})
