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

"""A RunConfig as data and as a parameter file for nodes."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, values_of
from flexarm_ros.core.run.parts import known_parts
from flexarm_ros.core.run.required_parts import ControllerPart
from flexarm_ros.core.sensing.parts import TipSensorPart
from flexarm_ros.scenario.yaml.rclyaml import write


def to_dict(config: RunConfig, external: Collection[str] = ()) -> dict[str, dict[str, Any]]:
    """
    Return ``{section: {key: value}}`` of every parameter, ``None`` if not set.

    The section of the run is ``/**``; arrays are lists.  ``from_dict`` undoes it (the rows of a
    torque file are separate, as ``config.torques``).  Parameters that only the ``external``
    nodes (roles) would read are left out: a section, or keys of it.
    """
    data: dict[str, dict[str, Any]] = {}
    for section in SECTIONS:
        data[section] = {
            key: list(value) if isinstance(value, tuple) else value
            for key, value in values_of(config, section).items()
        }
    for role, shared in _shared(config, external).items():
        data[role] = {key: value for key, value in data.get(role, {}).items() if key in shared}
    return {section: keys for section, keys in data.items() if keys}


def _shared(config: RunConfig, external: Collection[str]) -> dict[str, set[str]]:
    """Return the keys of each external role that other parts read."""
    if not external:
        return {}
    from flexarm_ros.core.control import LAWS

    shared = {part.NAME: {*part.SHARED} for part in known_parts()}
    if ControllerPart.NAME not in external and LAWS[config.controller.law].MODELS_LATENCY:
        shared[TipSensorPart.NAME].add('latency')
    return {role: shared.get(role, set()) for role in external}


def dump(config: RunConfig, torque_file: str | None = None) -> str:
    """
    Return the scenario as a ROS 2 parameter file, with every value that is set.

    Floats always have a decimal point, so that rcl and PyYAML read exactly the same double.
    ``torque_file`` replaces the path of the torque file (an existing one for nodes; in a bag
    it is only a name).
    """
    document: dict[str, Any] = {}
    for section, keys in to_dict(config).items():
        if section == 'controller' and torque_file is not None:
            keys['torque_file'] = torque_file
        held = {key: value for key, value in keys.items() if value is not None}
        document[section] = {'ros__parameters': held}
    return write(document)


def resolved(config: RunConfig) -> dict[str, dict[str, Any]]:
    """
    Return ``to_dict`` with the derived defaults filled in.

    These are integration steps per tick, limits of deflection, initial pose and rates, and the
    held point; what stays ``None`` has no meaning in this scenario.
    """
    from flexarm_ros.core.arm.plant import deflection_limits
    from flexarm_ros.core.run.make_plant import choose_integrator
    from flexarm_ros.core.trajectory import initial_angles, make_path

    data = to_dict(config)
    plant, trajectory = data['plant'], data['trajectory']
    _, plant['substeps'] = choose_integrator(config)
    plant['deflection_limit'] = list(deflection_limits(config.plant))
    plant['initial_position'] = [float(angle) for angle in initial_angles(config)]
    plant['initial_velocity'] = list(config.plant.initial_velocity or (0.0, 0.0))
    if trajectory['kind'] == 'hold':
        trajectory['hold_position'] = [float(value) for value in make_path(config).at(0)[:2]]
    return data
