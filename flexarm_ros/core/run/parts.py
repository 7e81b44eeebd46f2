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
The list of the parts of a run, and what follows from it.

`parts_of` a scenario determines the loop in one process, the recomputation that verifies a bag,
the table of topics, the roles of the launcher and of the command line, and the answering nodes.
"""

from __future__ import annotations

from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS
from flexarm_ros.core.run.part import Answer, Column, Part
from flexarm_ros.core.run.required_parts import (
    ControllerPart,
    PlantPart,
    RecorderPart,
    TrajectoryPart,
)
from flexarm_ros.core.run.rig_parts import ActuatorPart, DisturbancePart
from flexarm_ros.core.sensing.imu import ImuPart
from flexarm_ros.core.sensing.parts import EncoderPart, TipSensorPart
from flexarm_ros.core.sensing.strain_gauge import StrainGaugePart
from flexarm_ros.core.signals import Signal

PARTS: tuple[type[Part], ...] = (
    PlantPart, EncoderPart, TipSensorPart, StrainGaugePart, ImuPart, TrajectoryPart,
    ControllerPart, ActuatorPart, DisturbancePart, RecorderPart,
)  # fmt: skip
"""This package's parts, in the order in which a tick's data flow."""

PLUGINS: dict[str, type[Part]] = {}
"""Parts of other packages that have been registered, by role."""


def register_part(part: type[Part]) -> None:
    """
    Add this part to scenarios that have a section of its name.

    The class is not checked here, but where it is loaded
    (`flexarm_ros.scenario.plugins.registry`).
    """
    assert part.Parameters is not None
    PLUGINS[part.NAME] = part
    SECTIONS[part.NAME] = part.Parameters


for _part in PARTS:
    if _part.Parameters is not None:
        SECTIONS[_part.NAME] = _part.Parameters


def known_parts() -> tuple[type[Part], ...]:
    """Return every known part; those of other packages come before the recorder."""
    record = [part for part in PARTS if part.FOR_THE_RECORD]
    return (*(part for part in PARTS if part not in record), *PLUGINS.values(), *record)


def parts_of(config: RunConfig) -> tuple[type[Part], ...]:
    """
    Return the parts of a scenario, each after those that it reads; the plant closes the loop.

    Raises ``ValueError`` if no part publishes a topic that another one reads.
    """
    left = [p for p in known_parts() if p.Parameters is None or config.section(p.NAME) is not None]
    found: list[type[Part]] = []
    published: set[str] = set()
    while left:
        part = next((p for p in left if p is PlantPart or published >= {*p.reads(config)}), None)
        if part is None:
            missing = next(name for name in left[0].reads(config) if name not in published)
            raise ValueError(
                f'{left[0].NAME}: reads {missing}, which no part of this scenario publishes'
            )
        left.remove(part)
        found.append(part)
        published |= {s.name for s in (*part.signals(config), *part.further_signals(config))}
    return (*(p for p in found if not p.FOR_THE_RECORD), *(p for p in found if p.FOR_THE_RECORD))


def roles(config: RunConfig) -> tuple[str, ...]:
    """Return the roles of a scenario; the recorder is the last."""
    return tuple(part.NAME for part in parts_of(config))


def recorded_roles(config: RunConfig) -> tuple[str, ...]:
    """Return the roles whose messages are recorded."""
    return tuple(part.NAME for part in parts_of(config) if not part.FOR_THE_RECORD)


def replaceable(config: RunConfig) -> tuple[str, ...]:
    """Return the roles that an external node may fill."""
    return tuple(part.NAME for part in parts_of(config) if part.REPLACEABLE)


def answering(config: RunConfig) -> tuple[type[Answer], ...]:
    """Return the parts that answer, in the order of a tick."""
    return tuple(part for part in parts_of(config) if issubclass(part, Answer))


def part_of(role: str) -> type[Part]:
    """Return the part with this role; ``KeyError`` if there is none."""
    return {part.NAME: part for part in known_parts()}[role]


def signals(config: RunConfig) -> tuple[tuple[type[Part], Signal], ...]:
    """
    Return every signal of a run with its part, in the order of a tick in a bag.

    The signals of required parts come first, so that their positions are the same in every
    scenario; their further signals and those of optional parts follow.
    """
    parts = parts_of(config)
    required = [part for part in parts if part.Parameters is None]
    return (
        *((part, signal) for part in required for signal in part.signals(config)),
        *((part, signal) for part in required for signal in part.further_signals(config)),
        *(
            (part, signal)
            for part in parts
            if part.Parameters is not None
            for signal in (*part.signals(config), *part.further_signals(config))
        ),
    )


def place(topic: str) -> int:
    """Return the index in `signals` of a required part's topic, the same in every scenario."""
    return [signal.name for _, signal in signals(RunConfig())].index(topic)


def readers(topic: str, config: RunConfig) -> tuple[str, ...]:
    """Return the roles that read ``topic``; the recorder reads every topic."""
    return tuple(
        part.NAME
        for part in parts_of(config)
        if part.FOR_THE_RECORD or topic in part.reads(config)
    )


def columns(config: RunConfig) -> tuple[Column, ...]:
    """Return the columns of ``trajectory.csv`` that optional parts add."""
    return tuple(column for part in parts_of(config) for column in part.columns(config))


def check_parts(config: RunConfig) -> None:
    """Raise ``ValueError`` if the scenario is invalid for a part."""
    for part in parts_of(config):
        try:
            part.check(config)
        except (Exception, SystemExit) as error:
            if part.NAME not in PLUGINS:
                raise
            raise outside_error(part, error) from error


def outside_error(part: type[Part], error: BaseException) -> ValueError:
    """Return the error of a part of another package as one that names the part's class."""
    text = str(error)
    if not isinstance(error, ValueError):
        text = f'{type(error).__name__}: {text}'
    elif text.startswith(part.NAME):  # a key of its section
        return error
    return ValueError(f'{part.NAME} ({part.__module__}:{part.__qualname__}): {text}')
