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
Checks of what laws and parts of other packages declare.

Each error is one line that names the class and what it declares.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
import re
from typing import Any, get_args

from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.parameters.sections import (
    PaceParameters,
    RunConfig,
    RunParameters,
    Spec,
    specs,
)
from flexarm_ros.core.parameters.spec import KINDS
from flexarm_ros.core.run.part import Answer, Column, Part
from flexarm_ros.core.run.parts import outside_error, PLUGINS
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Content, Signal
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.yaml.convert import convert
from flexarm_ros.scenario.yaml.rclyaml import tree_of

OF_ROS = ('use_sim_time', 'start_type_description_service', 'qos_overrides')
"""Parameters of every ROS 2 node, which rclpy declares."""

_KEY = re.compile(r'[A-Za-z]\w*(\.[A-Za-z]\w*)*', re.ASCII)
_COLUMN = re.compile(r'[A-Za-z]\w*', re.ASCII)


def check_parameters(where: str, declared: Any) -> None:
    """Raise ScenarioError if the class of a law's or a part's parameters is not valid."""
    settings: Any = getattr(declared, '__dataclass_params__', None)
    if not isinstance(declared, type) or not is_dataclass(declared) or not settings.frozen:
        raise ScenarioError(f'{where}: Parameters is not a frozen dataclass')
    for field in fields(declared):
        spec, name = field.metadata.get('spec'), f'{where}: Parameters.{field.name}'
        if not isinstance(spec, Spec):
            raise ScenarioError(f'{name} is not made by parameter()')
        if spec.kind not in KINDS:
            raise ScenarioError(f'{name}: kind {spec.kind!r} is not one of {", ".join(KINDS)}')
        if spec.live and spec.kind != 'float':
            raise ScenarioError(f'{name}: only a float may be live')
    for key in specs(declared):
        if not _KEY.fullmatch(key):
            raise ScenarioError(f'{where}: {clip(key)!r} is not a key of letters, digits, _ and .')


def check_defaults(prefix: str, declared: type) -> None:
    """Raise ScenarioError if the default of a key is not one of its own values."""
    for key, (_, spec, default) in specs(declared).items():
        if default is not None:
            convert(f'{prefix}.{key}: default', spec, tree_of(default))


def check_part(where: str, name: str, part: Any) -> None:
    """Raise ScenarioError if ``part`` is no class that may be the part ``name``."""
    if not isinstance(part, type) or not issubclass(part, Answer):
        raise ScenarioError(f'{where}: not a subclass of flexarm_ros.core.run.part.Answer')
    if part.__dict__.get('NAME') != name or not name.isidentifier() or not name.isascii():
        raise ScenarioError(f'{where}: NAME is not {name!r}, a name of letters, digits and _')
    if part.FOR_THE_RECORD:
        raise ScenarioError(f'{where}: FOR_THE_RECORD is only for the recorder')
    declared = part.Parameters
    check_parameters(where, declared)
    assert declared is not None
    check_defaults(name, declared)
    own = specs(declared)
    if all(default is None for _, _, default in own.values()):
        # A scenario is written with the values that are set: this section would be lost.
        raise ScenarioError(f'{where}: Parameters has no key with a default')
    for taken in (*specs(RunParameters), *specs(PaceParameters), *OF_ROS):
        if taken in own:
            raise ScenarioError(f'{where}: the key {taken} is a parameter of every node')
    if issubclass(part, Sensor):
        for key, (_, spec, _) in specs(ChannelParameters).items():
            if own[key][1].kind != spec.kind:
                raise ScenarioError(f"{where}: the key {key} is the channel's, a {spec.kind}")


def check_plugins(config: RunConfig) -> None:
    """Raise ScenarioError if a part of another package declares what cannot be in a scenario."""
    for part in PLUGINS.values():
        if config.section(part.NAME) is None:
            continue
        try:
            reads, signals, own = part.reads(config), part.signals(config), part.columns(config)
            _check_topics(reads, signals, part.further_signals(config))
            _check_columns(part, config, own)
        except (Exception, SystemExit) as error:  # whatever the part does
            raise ScenarioError(clip(str(outside_error(part, error)), 400)) from None


def _check_topics(reads: Any, signals: Any, further: Any) -> None:
    """Raise ``ValueError`` for inputs or signals of the wrong kind."""
    if isinstance(reads, str) or not all(isinstance(name, str) for name in reads):
        raise ValueError(f'reads: {reads!r} is not a tuple of topic names')
    if not signals:
        raise ValueError('signals: none; a part publishes at least one')
    for signal in (*signals, *further):
        if not isinstance(signal, Signal) or not isinstance(signal.content, get_args(Content)):
            raise ValueError(f'signals: {signal!r} is not a Signal with a content')
        if signal.name.startswith('/'):
            raise ValueError(f'signals: {signal.name} is not a relative topic name')
        if not isinstance(signal.every, int) or signal.every < 1:
            raise ValueError(f'signals: {signal.name}: every is {signal.every!r}, not 1 or more')


def _check_columns(part: type[Part], config: RunConfig, own: Sequence[Column]) -> None:
    """Raise ``ValueError`` for a column of a name or place that the table cannot have."""
    signals = (*part.signals(config), *part.further_signals(config))
    widths = {signal.name: signal.content.width for signal in signals}
    for column in own:
        if not _COLUMN.fullmatch(column.name):
            raise ValueError(f'columns: {column.name!r} is not a name of letters, digits and _')
        if not 0 <= column.place < widths.get(column.topic, 0):
            raise ValueError(
                f'columns: {column.name}: its part publishes no value {column.place} on '
                f'{column.topic}'
            )
