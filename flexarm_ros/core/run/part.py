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
Interface of the parts of a run: role, section of the scenario, inputs, topics, columns, answer.

Another package derives its own part from `Answer` or from
`flexarm_ros.core.sensing.sensor.Sensor` and names it in an entry point of the group
``flexarm_ros.parts`` (`flexarm_ros.scenario.plugins.registry`).
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import Signal

CLOCK, STATE = '/clock', 'plant/state'
DRIVES, ACCELERATION = 'plant/drives', 'plant/acceleration'
JOINT_STATES, TIP = 'joint_states', 'tip_sensor/odometry'
REFERENCE, COMMAND = 'reference', 'joint_command'


class Column(NamedTuple):
    """
    A column of ``trajectory.csv``: value ``place`` of the message on ``topic``.

    ``unit``, as ``m/s^2``, is for the labels of figures; empty: none.
    """

    name: str
    topic: str
    place: int
    unit: str = ''


class Part:
    """
    One role of a run.

    ``NAME`` is the role, the section of a scenario and the executable.  ``Parameters`` makes the
    part optional: a frozen dataclass of `flexarm_ros.core.parameters.spec.parameter` fields, the
    keys of its section; without that section in the scenario the part has no process, no topic
    and no column.  ``READS`` are the topics of a tick that it needs, in the order of `answer`'s
    arguments; the topic that arrives last comes first.  ``FOR_THE_RECORD``: it reads every topic.
    ``REPLACEABLE``: an external node may fill the role.  ``LATE``: its messages have the stamp of
    the measurement, as a sensor's; otherwise that of the tick.  ``AHEAD``: it publishes messages
    before their tick.  ``SHARED`` are the keys of its section that other parts read too: a summary
    keeps them where an external node fills the role.
    """

    NAME: ClassVar[str]
    Parameters: ClassVar[type | None] = None
    READS: ClassVar[tuple[str, ...]] = ()
    FOR_THE_RECORD: ClassVar[bool] = False
    REPLACEABLE: ClassVar[bool] = True
    LATE: ClassVar[bool] = False
    AHEAD: ClassVar[bool] = False
    SHARED: ClassVar[tuple[str, ...]] = ()

    @classmethod
    def reads(cls, config: RunConfig) -> tuple[str, ...]:
        """Return the topics that this part reads in a scenario: by default ``READS``."""
        return cls.READS

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the signals that this part publishes at each tick."""
        return ()

    @classmethod
    def further_signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return further signals, which follow the `signals` of all parts in a bag."""
        return ()

    @classmethod
    def holds(cls, config: RunConfig) -> bool:
        """Return whether this part repeats a sample, with its stamp, until the next one."""
        return False

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the columns that this optional part adds to ``trajectory.csv``."""
        return ()

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError``, which names the key, if ``config`` is invalid for this part."""


class Answer(Part):
    """A part that computes its messages of a tick from its inputs of that tick."""

    def __init__(self, config: RunConfig) -> None:
        raise NotImplementedError

    def answer(self, k: int, *inputs: Any) -> Any:
        """
        Return the values of tick ``k``; called once per tick, in order.

        ``inputs`` are the values of `reads`, of ``plant/state`` a
        `flexarm_ros.core.run.state.State`.  The result is a tuple of values, preceded by the stamp
        (ns) if ``LATE``; a tuple of such tuples if the part has several signals.
        """
        raise NotImplementedError

    @property
    def title(self) -> str:
        """Return the name of this part in error messages."""
        return self.NAME

    def fault(self, k: int, message: Any) -> str | None:
        """Return why the run must end with this answer of tick ``k``, None if it need not."""
        return None

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` if a live parameter of ``config`` is invalid for this part."""

    def retune(self, config: RunConfig) -> None:
        """Apply the live parameters of ``config`` from the next tick on."""
