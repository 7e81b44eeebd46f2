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

"""Checks across the keys of a scenario, and of the names that its parts must not share."""

from __future__ import annotations

import re

from flexarm_ros.core.control import LAWS
from flexarm_ros.core.control.design.motion import horizon_ns
from flexarm_ros.core.control.open_loop import check_torques
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.make_plant import check_substeps
from flexarm_ros.core.run.parts import check_parts, parts_of, signals
from flexarm_ros.core.run.required_parts import PlantPart
from flexarm_ros.core.run.results.columns import COLUMNS
from flexarm_ros.core.sensing.sensors import check_location
from flexarm_ros.core.timeline import clock_ticks, named_ns, Timeline
from flexarm_ros.core.trajectory import check_reachable, initial_angles

_TOPIC = re.compile(r'/?[A-Za-z]\w*(/[A-Za-z]\w*)*', re.ASCII)
_RESERVED = re.compile(r'(plant|lockstep)/.*|diagnostics|parameter_events|rosout|tf')
"""Topics of the plant, of the lock-step protocol and of ROS."""


def check(config: RunConfig) -> None:
    """
    Raise ``ValueError``, which names the key, if parameters of ``config`` contradict each other.

    Each value must be within its own :class:`Spec` already.
    """
    check_names(config)
    check_parts(config)
    Timeline.of(config.run)
    named_ns('trajectory.delay', config.trajectory.delay)
    check_location(config)
    clock_ticks(config.run)
    check_reachable(config)
    initial_angles(config)
    if config.controller.law == 'open_loop':
        check_torques(config.torques)
    LAWS[config.controller.law].check(config)
    if LAWS[config.controller.law].PLANS:
        horizon_ns(config)
    check_substeps(config)


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
