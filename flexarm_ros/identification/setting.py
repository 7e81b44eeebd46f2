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
from pathlib import Path
from typing import Any

from flexarm_ros.core.parameters.rig import ActuatorParameters
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, with_section
from flexarm_ros.core.parameters.spec import parameter, Spec, specs
from flexarm_ros.scenario import dump, find
from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError, suggestion
from flexarm_ros.scenario.files import read_text
from flexarm_ros.scenario.locate import config_directories
from flexarm_ros.scenario.reader import _read, build, MAX_BYTES, parse_override, PathLike
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import MappingTree as Tree
from flexarm_ros.scenario.yaml.rclyaml import parse, write


@dataclass(frozen=True)
class GaugeParameters:
    """Section ``strain_gauge``: the strain gauge on each link."""

    location: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'm', 'location on the flexible part of each link, from its root',
        low=0.0, high=1e4,
    )  # fmt: skip
    gain: tuple[float, float] = parameter(
        (1.0, 1.0), 'float2', '', 'gain of each gauge', low=-1e6, high=1e6
    )
    offset: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', '', 'reading of each gauge for a straight link, in the unit of '
        'output', low=-1e4, high=1e4,
    )  # fmt: skip
    offset_slope: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', '1/rad', 'change of the offset per angle of the joint of the link',
        low=-1e4, high=1e4,
    )  # fmt: skip
    filter_cutoff: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'Hz', 'natural frequency of the second-order low-pass; 0: none',
        low=0.0, high=1e6,
    )  # fmt: skip
    filter_damping: tuple[float, float] = parameter(
        (0.7, 0.7), 'float2', '', 'damping ratio of the low-pass', low=0.0, low_open=True,
        high=100.0,
    )  # fmt: skip
    latency: float = parameter(
        0.0, 'float', 's', 'age of a measurement at delivery', low=0.0, high=0.999999999
    )


GAUGE, ACTUATOR = 'strain_gauge', 'actuator'
PENDING: dict[str, type] = {GAUGE: GaugeParameters} if GAUGE not in SECTIONS else {}
"""Sections that no part of a run reads yet."""

_NUMBERS = ('float', 'float2')


@dataclass(frozen=True)
class Setting:
    """A checked scenario and its strain gauges."""

    config: RunConfig
    pending: tuple[tuple[str, Any], ...] = ()
    """Sections of `PENDING` that are given, with their parameters."""

    @property
    def gauge(self) -> GaugeParameters:
        """Return the section of the strain gauges, its defaults without one."""
        held: GaugeParameters = self.section(GAUGE)
        return held

    @property
    def actuator(self) -> ActuatorParameters:
        """Return the section of the drives, its defaults without one."""
        held: ActuatorParameters = self.section(ACTUATOR)
        return held

    def section(self, name: str) -> Any:
        """Return the parameters of a section, the defaults of an optional one that is absent."""
        held = dict(self.pending).get(name) if name in PENDING else self.config.section(name)
        return _classes()[name]() if held is None else held

    def with_section(self, name: str, values: Any) -> Setting:
        """Return this setting with other parameters in a section."""
        if name in PENDING:
            return replace(self, pending=tuple({**dict(self.pending), name: values}.items()))
        return replace(self, config=with_section(self.config, name, values))

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


def _classes() -> dict[str, type]:
    return {**SECTIONS, **PENDING}


def _split(key: str) -> tuple[str, str, int | None]:
    """Return section, field and place in an array, or None, of a key."""
    parts = key.split('.')
    place = int(parts[-1]) - 1 if parts[-1] in ('1', '2') else None
    if place is not None:
        parts = parts[:-1]
    section, name = parts[0], '.'.join(parts[1:])
    known = specs(_classes()[section])
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
    classes = _classes()
    known = specs(classes[section]) if section in classes else {}
    if name not in known:
        every = [f'{s}.{key}' for s, held in classes.items() for key in specs(held)]
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
    Read a scenario with its strain gauges; ``overrides`` are texts ``node.key=value``.

    Raises ScenarioError, one line.
    """
    path = _find(source)
    name = clip(str(path), PATH_WIDTH)
    text = read_text(path, MAX_BYTES)
    tree = parse(text)
    given: dict[str, dict[str, Any]] = {section: {} for section in PENDING}
    for section in PENDING:
        if isinstance(tree, Tree) and section in tree.entries:
            given[section] = _keys_of(name, section, tree.entries[section])
            text = _without_section(text, section)
    values = _read(text, name, user=True)
    for override in overrides:
        key, equals, value = override.partition('=')
        section, _, rest = key.strip().lstrip('/').partition('.')
        if section in PENDING and equals:
            given[section][rest] = parse(value)
        else:
            place, tree = parse_override(override)
            values[place] = tree
    config = build(values, torque_base=path.resolve().parent)
    return Setting(config, tuple((name, _made(name, trees)) for name, trees in given.items()))


def _find(source: PathLike) -> Path:
    """Return the file of a scenario, or of a shipped rig by its name."""
    for directory in config_directories()[:1]:
        rig = directory / 'rigs' / f'{source}.yaml'
        if rig.is_file() and not Path(source).exists():
            return rig
    return find(source)


def _keys_of(name: str, section: str, body: Any) -> dict[str, Any]:
    if not isinstance(body, Tree) or set(body.entries) != {'ros__parameters'}:
        raise ScenarioError(f'{name}: {section}: must hold one map, ros__parameters')
    held = body.entries['ros__parameters']
    return dict(held.entries) if isinstance(held, Tree) else {}


def _made(section: str, trees: Mapping[str, Any]) -> Any:
    values = {}
    for key, tree in trees.items():
        full = f'{section}.{key}'
        values[key] = convert(full, _spec(section, key, full), tree)
    return PENDING[section](**values)


def _without_section(text: str, section: str) -> str:
    lines, inside = [], False
    for line in text.splitlines():
        if line and not line[0].isspace() and not line.startswith('#'):
            inside = line.split(':')[0].strip().lstrip('/') == section
        if not inside:
            lines.append(line)
    return '\n'.join(lines) + '\n'


def text_of(setting: Setting) -> str:
    """Return a setting as a scenario file."""
    text = dump(setting.config, setting.config.controller.torque_file)
    for section, held in PENDING.items():
        values = setting.section(section)
        if values != held():
            keys = {
                key: list(value) if isinstance(value, tuple) else value
                for key, (name, _, _) in specs(held).items()
                for value in [getattr(values, name)]
            }
            text += write({section: {'ros__parameters': keys}})
    return text
