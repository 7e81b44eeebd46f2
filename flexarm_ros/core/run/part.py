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
What a part of a run declares: role, section of the scenario, inputs, topics, columns, answer.

A package of a user's derives its own part from `Answer` or from
`flexarm_ros.core.sensing.sensor.Sensor` and names it by an entry point of the group
``flexarm_ros.parts`` (`flexarm_ros.scenario.plugins`).
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import Signal

CLOCK, STATE = '/clock', 'plant/state'
JOINT_STATES, TIP = 'joint_states', 'tip_sensor/odometry'
REFERENCE, COMMAND = 'reference', 'joint_command'


class Column(NamedTuple):
    """A column of ``trajectory.csv``: value ``place`` of the message on ``topic``."""

    name: str
    topic: str
    place: int


class Part:
    """
    One role of a run.

    ``NAME`` is the role, the section of a scenario and the executable.  ``Parameters`` makes the
    part optional: a frozen dataclass of `flexarm_ros.core.parameters.spec.parameter` fields, the
    keys of its section; without that section in the scenario the part has no process, no topic
    and no column.  ``READS`` are the topics that it needs of a tick, in the order of `answer`'s
    arguments, the one that arrives last first.  ``FOR_THE_RECORD`` reads every topic.
    ``REPLACEABLE``: an external node may fill the role.  ``LATE``: what it publishes is as old as
    it says, a sensor's sample; otherwise the stamp is the tick's.  ``AHEAD``: it publishes before
    its time.
    """

    NAME: ClassVar[str]
    Parameters: ClassVar[type | None] = None
    READS: ClassVar[tuple[str, ...]] = ()
    FOR_THE_RECORD: ClassVar[bool] = False
    REPLACEABLE: ClassVar[bool] = True
    LATE: ClassVar[bool] = False
    AHEAD: ClassVar[bool] = False

    @classmethod
    def reads(cls, config: RunConfig) -> tuple[str, ...]:
        """Return the topics that it needs in this scenario: ``READS`` unless overridden."""
        return cls.READS

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return what this part publishes at each tick."""
        return ()

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return what it publishes beside that, behind the signals of all parts in a bag."""
        return ()

    @classmethod
    def holds(cls, config: RunConfig) -> bool:
        """Return whether it publishes a sample again until the next one, its stamp too."""
        return False

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return its columns of ``trajectory.csv``, those of the required parts left out."""
        return ()

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError``, naming the key, where ``config`` does not fit this part."""


class Answer(Part):
    """A part that answers each tick's inputs, and does nothing else."""

    def __init__(self, config: RunConfig) -> None:
        raise NotImplementedError

    def answer(self, k: int, *inputs: Any) -> Any:
        """
        Return the values of tick ``k``, called once a tick, in order.

        ``inputs`` are the values of `reads`, of ``plant/state`` a
        `flexarm_ros.core.run.state.State`.  The values are a tuple, ``LATE`` with the stamp, ns,
        in front; a tuple of such where several signals are published.
        """
        raise NotImplementedError

    @property
    def title(self) -> str:
        """Return what it is called where it is at fault."""
        return self.NAME

    def fault(self, k: int, message: Any) -> str | None:
        """Return what is wrong with the answer of tick ``k``, so that the run cannot go on."""
        return None

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` where a live parameter of ``config`` cannot be taken."""

    def retune(self, config: RunConfig) -> None:
        """Take the live parameters of ``config`` from the next tick on."""
