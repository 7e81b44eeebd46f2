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

"""Keys of the commanded motion: section ``trajectory``."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class TrajectoryParameters:
    """Section ``trajectory``: the commanded motion of the end effector."""

    kind: str = _key(
        'square', 'str', '', 'square: clockwise from lower left, centred on the base',
        choices=('square', 'hold', 'waypoints'), paper='square',
    )  # fmt: skip
    time_law: str = _key(
        'constant', 'str', '', 'constant: speed along a side; smooth: rest to rest on each side',
        choices=('constant', 'smooth'), paper='constant',
    )  # fmt: skip
    side: float = _key(
        12.6, 'float', 'm', 'side of the square', low=0.0, low_open=True, high=1e5, paper='12.6'
    )
    side_time: float = _key(
        4.0, 'float', 's', 'duration of one side', low=0.0, low_open=True, high=1e7, whole_ns=True,
        paper='4.0',
    )  # fmt: skip
    delay: float = _key(
        0.0, 'float', 's', 'delay of the reference (the forward-loop correction)', low=0.0,
        high=1e4, whole_ns=True, live=True, paper='0',
    )  # fmt: skip
    hold_position: tuple[float, float] | None = _key(
        None, 'float2', 'm', 'x, y to hold; default: the end effector of the initial pose, or the '
        "square's lower left corner",
        low=-1e5, high=1e5,
    )  # fmt: skip
    waypoint_times: tuple[float, ...] | None = _key(
        None, 'floats', 's', 'ascending times of the way points, the first 0', low=0.0, high=1e7,
        whole_ns=True,
    )  # fmt: skip
    waypoint_x: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'x of each way point', low=-1e5, high=1e5
    )
    waypoint_y: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'y of each way point', low=-1e5, high=1e5
    )
