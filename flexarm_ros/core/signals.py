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
Content of the messages of a part: names of the values, frames, variance.

The wire layer turns these into ROS messages (`flexarm_ros.wire.topics`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

BASE_FRAME, TOOL_FRAME = 'base', 'tool'
JOINTS = ('shoulder', 'elbow')
LINKS = ('link1', 'link2')


@dataclass(frozen=True)
class Clock:
    """Only a stamp."""

    width: ClassVar[int] = 0


@dataclass(frozen=True)
class Joints:
    """The arrays ``fields`` (of position, velocity, effort), one value each of ``names``."""

    names: tuple[str, ...] = JOINTS
    fields: tuple[str, ...] = ('position', 'velocity')

    @property
    def width(self) -> int:
        """Return the number of values: those of the first field, then of the next."""
        return len(self.names) * len(self.fields)


@dataclass(frozen=True)
class PlanarPoint:
    """x, y, vx, vy (m, m/s) of the frame ``child`` in ``base``; ``variance`` of x and y, m^2."""

    child: str
    variance: float = 0.0
    width: ClassVar[int] = 4


@dataclass(frozen=True)
class PlanarForce:
    """fx, fy (N) in ``base``."""

    width: ClassVar[int] = 2


@dataclass(frozen=True)
class PointMass:
    """A mass (kg) at the tip; ``start``: before the first message."""

    start: float
    width: ClassVar[int] = 1


@dataclass(frozen=True)
class Inertial:
    """Rate of turn about z (rad/s) and specific force along x and y (m/s^2) of ``frame``."""

    frame: str
    gyro_variance: float = 0.0
    accel_variance: float = 0.0
    width: ClassVar[int] = 3


Content = Clock | Joints | PlanarPoint | PlanarForce | PointMass | Inertial


@dataclass(frozen=True)
class Signal:
    """
    The output of a part at each tick: the name of a topic and its content.

    ``name`` is relative, except ``/clock``.  ``every``: ticks between messages, from tick 0.
    """

    name: str
    content: Content
    every: int = 1


def coordinate_names(modes: int) -> tuple[str, ...]:
    """Return the names of the plant's coordinates: joints, then modes of link 1 and link 2."""
    modal = [f'{link}_mode{i}' for link in LINKS for i in range(1, modes + 1)]
    return (*JOINTS, *modal)
