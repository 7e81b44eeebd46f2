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
A scenario whose numbers can be set one by one.

A key is ``section.key``; of an array also ``section.key.1`` and ``section.key.2``, the number of
joint or link 1 and 2.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from flexarm_ros.core.parameters.rig import ActuatorParameters, StrainGaugeParameters
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, with_section
from flexarm_ros.core.parameters.spec import Spec, specs
from flexarm_ros.scenario import dump, load
from flexarm_ros.scenario.errors import clip, ScenarioError, suggestion
from flexarm_ros.scenario.reader import PathLike

GAUGE, ACTUATOR = 'strain_gauge', 'actuator'

_NUMBERS = ('float', 'float2')


@dataclass(frozen=True)
class Setting:
    """A checked scenario."""

    config: RunConfig

    @property
    def gauge(self) -> StrainGaugeParameters:
        """Return the section of the strain gauges, its defaults without one."""
        held: StrainGaugeParameters = self.section(GAUGE)
        return held

    @property
    def actuator(self) -> ActuatorParameters:
        """Return the section of the drives, its defaults without one."""
        held: ActuatorParameters = self.section(ACTUATOR)
        return held

    def section(self, name: str) -> Any:
        """Return the parameters of a section, the defaults of an optional one that is absent."""
        held = self.config.section(name)
        return SECTIONS[name]() if held is None else held

    def with_section(self, name: str, values: Any) -> Setting:
        """Return this setting with other parameters in a section."""
        return Setting(with_section(self.config, name, values))

    def number(self, key: str) -> float:
        """Return the number of a key from `numbers_of`."""
        section, name, place = _split(key)
        value = getattr(self.section(section), name)
        if value is None:
            raise ScenarioError(f'{key}: not set; give it a value to start from, as with --set')
        return float(value if place is None else value[place])

    def with_numbers(self, numbers: Mapping[str, float]) -> Setting:
        """Return this setting with some numbers set, not checked against their ranges."""
        result = self
        for key, number in numbers.items():
            section, name, place = _split(key)
            held = result.section(section)
            value: Any = float(number)
            if place is not None:
                both = list(getattr(held, name))
                both[place] = value
                value = tuple(both)
            result = result.with_section(section, replace(held, **{name: value}))
        return result


def _split(key: str) -> tuple[str, str, int | None]:
    """Return section, field and place in an array, or None, of a key."""
    parts = key.split('.')
    place = int(parts[-1]) - 1 if parts[-1] in ('1', '2') else None
    if place is not None:
        parts = parts[:-1]
    section, name = parts[0], '.'.join(parts[1:])
    known = specs(SECTIONS[section])
    return section, known[name][0], place


def numbers_of(key: str) -> list[str]:
    """
    Return the keys of the single numbers of a key: itself, or with ``.1`` and ``.2``.

    Raises ScenarioError for an unknown key, and for one that is not one or two numbers.
    """
    parts = key.strip().split('.')
    place = parts[-1] if parts[-1] in ('1', '2') and len(parts) > 2 else ''
    section, name = parts[0].lstrip('/'), '.'.join(parts[1 : -1 if place else None])
    spec = _spec(section, name, key)
    if spec.kind not in _NUMBERS or (place and spec.kind != 'float2'):
        allowed = ', '.join(_free_keys())
        raise ScenarioError(f'{clip(key)}: cannot be estimated; allowed: numbers, as {allowed}')
    full = f'{section}.{name}'
    if spec.kind == 'float':
        return [full]
    return [f'{full}.{place}'] if place else [f'{full}.1', f'{full}.2']


def _free_keys() -> list[str]:
    return ['plant.flexural_rigidity.1', 'plant.link_damping', 'strain_gauge.gain']


def _spec(section: str, name: str, shown: str) -> Spec:
    known = specs(SECTIONS[section]) if section in SECTIONS else {}
    if name not in known:
        every = [f'{s}.{key}' for s, held in SECTIONS.items() for key in specs(held)]
        raise ScenarioError(f'{clip(shown)}: unknown key{suggestion(shown, every)}')
    found: Spec = known[name][1]
    return found


def spec_of(key: str) -> Spec:
    """Return unit and range of a key from `numbers_of`."""
    section, name, _ = key.split('.')[0], key.split('.')[1:], None
    if name[-1] in ('1', '2'):
        name = name[:-1]
    return _spec(section, '.'.join(name), key).item


def load_setting(source: PathLike, overrides: Iterable[str] = ()) -> Setting:
    """
    Read a scenario; ``overrides`` are texts ``node.key=value``.

    Raises ScenarioError, one line.
    """
    return Setting(load(source, overrides))


def text_of(setting: Setting) -> str:
    """Return a setting as a scenario file."""
    return dump(setting.config, setting.config.controller.torque_file)
