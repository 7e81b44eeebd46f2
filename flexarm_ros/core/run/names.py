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

"""Names that the parts of a scenario must not share: topics, columns of ``trajectory.csv``."""

from __future__ import annotations

import re

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import parts_of, signals
from flexarm_ros.core.run.required_parts import PlantPart
from flexarm_ros.core.run.results.columns import COLUMNS

_TOPIC = re.compile(r'/?[A-Za-z]\w*(/[A-Za-z]\w*)*', re.ASCII)
_RESERVED = re.compile(r'(plant|lockstep)/.*|diagnostics|parameter_events|rosout|tf')
"""Topics of the plant, of the lock-step protocol and of ROS."""


def check_names(config: RunConfig) -> None:
    """Raise ``ValueError``, which names both parts, if two parts have one topic or column."""
    owners: dict[str, str] = {}
    for part, signal in signals(config):
        name = signal.name.removeprefix('/')
        if not _TOPIC.fullmatch(signal.name):
            raise ValueError(f'{part.NAME}: {signal.name!r} is not a valid topic name')
        if part is not PlantPart and _RESERVED.fullmatch(name):
            raise ValueError(f'{part.NAME}: topic {signal.name} is reserved; choose another')
        if name in owners:
            raise ValueError(
                f'{part.NAME}: topic {signal.name} is that of {owners[name]}; choose another'
            )
        owners[name] = part.NAME
    holders = dict.fromkeys(COLUMNS, 'every run')
    for part in parts_of(config):
        for column in part.columns(config):
            if column.name in holders:
                raise ValueError(
                    f'{part.NAME}: column {column.name} of trajectory.csv is that of '
                    f'{holders[column.name]}; choose another'
                )
            holders[column.name] = part.NAME
