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
The sections of a scenario, and the scenario that all layers use.

A class is a node's section, a field is a key: the single definition of its name, type, unit,
default, range and description.  The scenario reader checks files against it, the nodes declare
their ROS parameters from it, and docs/reference/parameters.md is generated from it.  ``key`` in a
field's metadata gives the name in the file if it differs from the field's (a law's gain,
``lqg.horizon``).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.controller import ControllerParameters, OWN_LAWS, OwnLaw
from flexarm_ros.core.parameters.plant import PlantParameters
from flexarm_ros.core.parameters.run import PaceParameters, RecorderParameters, RunParameters
from flexarm_ros.core.parameters.sensors import EncoderParameters, TipSensorParameters
from flexarm_ros.core.parameters.spec import Spec, specs
from flexarm_ros.core.parameters.trajectory import TrajectoryParameters

__all__ = [
    'OWN_LAWS',
    'SECTIONS',
    'ControllerParameters',
    'EncoderParameters',
    'OwnLaw',
    'PaceParameters',
    'PlantParameters',
    'RecorderParameters',
    'RunConfig',
    'RunParameters',
    'Spec',
    'TipSensorParameters',
    'TrajectoryParameters',
    'changed',
    'is_optional',
    'keys',
    'made',
    'specs',
    'values_of',
    'with_section',
]


SECTIONS: dict[str, type] = {
    '/**': RunParameters,
    'plant': PlantParameters,
    'encoder': EncoderParameters,
    'tip_sensor': TipSensorParameters,
    'trajectory': TrajectoryParameters,
    'controller': ControllerParameters,
    'recorder': RecorderParameters,
}
"""Section name in a scenario file -> class of its keys; those of optional parts are last."""


@dataclass(frozen=True)
class RunConfig:
    """
    A complete, checked scenario, used by all layers.

    ``torques`` holds the rows of the torque file, shape ``(rows, 3)`` as
    nested tuples ``(t, tau1, tau2)``, empty unless the law is ``open_loop``.
    ``further`` holds ``(section, parameters)`` of the optional parts that take part, in order of
    names; see `section`.  ``changes`` are the live parameters that were set during a recorded
    run; a scenario file has none.  ``pace`` does not affect the numbers of the run and is not
    recorded.
    """

    run: RunParameters = RunParameters()
    plant: PlantParameters = PlantParameters()
    encoder: EncoderParameters = EncoderParameters()
    tip_sensor: TipSensorParameters = TipSensorParameters()
    trajectory: TrajectoryParameters = TrajectoryParameters()
    controller: ControllerParameters = ControllerParameters()
    recorder: RecorderParameters = RecorderParameters()
    torques: tuple[tuple[float, float, float], ...] = ()
    changes: tuple[Change, ...] = ()
    pace: PaceParameters = PaceParameters()
    further: tuple[tuple[str, Any], ...] = ()

    def section(self, name: str) -> Any:
        """Return a section by its name in a file, None for an optional one that is absent."""
        if name in _FIELDS:
            return getattr(self, _FIELDS[name])
        return dict(self.further).get(name)


_FIELDS = {'/**': 'run'} | {f.name: f.name for f in fields(RunConfig) if f.name in SECTIONS}
"""Section of the required parts and of the run -> field of `RunConfig`."""


def is_optional(section: str) -> bool:
    """Return whether a section belongs to a part that a scenario may do without."""
    return section not in _FIELDS


def with_section(config: RunConfig, section: str, held: Any) -> RunConfig:
    """Return ``config`` with one section replaced, or with that of an optional part."""
    if section in _FIELDS:
        return replace(config, **{_FIELDS[section]: held})
    rest = {**dict(config.further), section: held}
    return replace(config, further=tuple(sorted(rest.items())))


def _own_laws() -> Iterator[tuple[str, OwnLaw]]:
    """Yield each prefix of the registered laws once, with a law that has it."""
    yield from {own.prefix: own for own in OWN_LAWS.values()}.items()


def keys(section: str) -> dict[str, tuple[str, Spec, Any]]:
    """
    Return ``{key: (field name, Spec, default)}`` of a section, as `specs` does.

    Those of registered laws are in it, and their names among the choices of ``controller.law``.
    """
    known = specs(SECTIONS[section])
    if section != 'controller' or not OWN_LAWS:
        return known
    name, law, default = known['law']
    known['law'] = name, replace(law, choices=(*law.choices, *OWN_LAWS)), default
    for prefix, own in _own_laws():
        known.update({f'{prefix}.{key}': entry for key, entry in specs(own.parameters).items()})
    return known


def values_of(config: RunConfig, section: str) -> dict[str, Any]:
    """
    Return ``{key: value}`` of a section.

    A registered law's keys are included if it is the law or one of them differs from its default;
    an absent optional section has none.
    """
    held = config.section(section)
    if held is None:
        return {}
    values = {key: getattr(held, name) for key, (name, _, _) in specs(SECTIONS[section]).items()}
    if section == 'controller':
        told = dict(held.laws)
        if held.law in OWN_LAWS:
            told.setdefault(OWN_LAWS[held.law].prefix, held.own())
        for prefix, own in told.items():
            own_keys = specs(type(own)).items()
            values.update(
                {f'{prefix}.{key}': getattr(own, name) for key, (name, _, _) in own_keys}
            )
    return values


def made(section: str, values: Mapping[str, Any]) -> Any:
    """Return a section from its ``{key: value}``; ``KeyError`` for an unknown key."""
    known, left = specs(SECTIONS[section]), dict(values)
    fields = {name: left.pop(key) for key, (name, _, _) in known.items() if key in left}
    laws = []
    for prefix, own in _own_laws() if section == 'controller' else ():
        entries = specs(own.parameters).items()
        given = {
            name: left.pop(f'{prefix}.{key}')
            for key, (name, _, _) in entries
            if f'{prefix}.{key}' in left
        }
        parameters = own.parameters(**given)
        if parameters != own.parameters():
            laws.append((prefix, parameters))
    if left:
        raise KeyError(f'{section}.{next(iter(left))}')
    if laws:
        fields['laws'] = tuple(laws)
    return SECTIONS[section](**fields)


def changed(config: RunConfig, change: Change) -> RunConfig:
    """Return ``config`` with a live parameter set; ``KeyError`` if there is none."""
    _, spec, _ = keys(change.node)[change.key]
    if not spec.live:
        raise KeyError(f'{change.node}.{change.key}')
    values = {**values_of(config, change.node), change.key: change.value}
    return with_section(config, change.node, made(change.node, values))
