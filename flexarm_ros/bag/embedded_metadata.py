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

"""The records before the messages of a bag: scenario, parameters, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
import hashlib
import json

from flexarm_ros import scenario
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.core.parameters.sections import RunConfig

FORMAT = '1'
"""Version of the records that this package adds to a bag."""

SCENARIO_FILE = 'scenario.yaml'
TORQUES_FILE = 'torques.csv'
PROVENANCE_FILE = 'provenance.json'
MEDIA_TYPES = {
    SCENARIO_FILE: 'application/yaml',
    PROVENANCE_FILE: 'application/json',
    TORQUES_FILE: 'text/csv',
}
RUN_RECORD = 'flexarm_ros'
PARAMETERS_RECORD = 'flexarm_ros.parameters'
VERSIONS_RECORD = 'flexarm_ros.versions'


def bag_config(config: RunConfig) -> RunConfig:
    """Return the scenario as stored in a bag, without paths of this machine."""
    law_file = config.controller.torque_file
    return replace(
        config,
        controller=replace(config.controller, torque_file=law_file and TORQUES_FILE),
    )


def scenario_text(config: RunConfig) -> str:
    """Return the scenario as stored in a bag, as text."""
    return scenario.dump(bag_config(config))


def front_matter(
    config: RunConfig, text: str, provenance: Provenance
) -> dict[str, Mapping[str, str]]:
    """
    Return the metadata records: the run, every resolved parameter (JSON), versions.

    ``text``: `scenario_text` of ``config``.
    """
    parameters = {
        f'{section}.{key}': json.dumps(value)
        for section, keys in scenario.to_dict(bag_config(config)).items()
        for key, value in keys.items()
    }
    text += scenario.write_torques(config.torques)
    run = {
        'format': FORMAT,
        'sha256': hashlib.sha256(text.encode()).hexdigest(),
        'scenario': provenance.name,
        'commit': provenance.commit,
        'digest': provenance.digest,
    }
    return {
        RUN_RECORD: run,
        PARAMETERS_RECORD: parameters,
        VERSIONS_RECORD: dict(provenance.versions),
    }


def attachments(
    config: RunConfig, text: str, provenance: Provenance
) -> list[tuple[str, str, str]]:
    """
    Return ``(name, media type, text)`` of scenario, provenance and, if any, torque rows.

    Attachments have their own checksums; a bag is read from them.  ``text``: `scenario_text`.
    """
    found = [
        (SCENARIO_FILE, text),
        (PROVENANCE_FILE, json.dumps(provenance.to_dict(), indent=1)),
    ]
    if config.torques:
        found.append((TORQUES_FILE, scenario.write_torques(config.torques)))
    return [(name, MEDIA_TYPES[name], content) for name, content in found]
