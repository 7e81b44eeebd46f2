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
Decoding of valid messages in layouts other than that of this package.

An external controller may fill ``JointState.name`` in another order, add joints, or run on a
big-endian machine.  The ``rosbags`` type store reads any valid CDR image without ROS.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from operator import attrgetter
from typing import Any, TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:  # imported on use: it takes 0.2 s
    from rosbags.typesys.store import Typestore

_NS = 1_000_000_000
_SURPLUS = 16
_PLAIN = (
    'geometry_msgs/msg/WrenchStamped', 'geometry_msgs/msg/InertiaStamped', 'sensor_msgs/msg/Imu',
)  # fmt: skip
"""Types whose fields are named as in the message."""


@cache
def typestore() -> Typestore:
    """Return the definitions of ROS 2 Kilted's standard messages."""
    from rosbags.typesys import get_typestore, Stores

    return get_typestore(Stores.ROS2_KILTED)


def message(type_name: str, data: bytes) -> Any:
    """
    Return ``data`` as a message object of the type store; ValueError if invalid.

    Some serializers append a few bytes to the message; they are ignored.
    """
    from rosbags.serde import SerdeError

    for surplus in range(0, _SURPLUS + 1, 4):
        try:
            return typestore().deserialize_cdr(data[: len(data) - surplus], type_name)
        except SerdeError as error:
            if 'size mismatch' not in str(error):
                break
    raise ValueError(f'no {type_name} in {len(data)} bytes')


def values(type_name: str, data: bytes, fields: Sequence[str]) -> tuple[int, tuple[float, ...]]:
    """Return ``(stamp_ns, values)`` of the named ``fields``; ValueError if one is missing."""
    found = message(type_name, data)
    stamp = found.clock if type_name == 'rosgraph_msgs/msg/Clock' else found.header.stamp
    stamp_ns = int(stamp.sec) * _NS + int(stamp.nanosec)
    if type_name == 'sensor_msgs/msg/JointState':
        return stamp_ns, _joint_values(found, fields)
    if type_name == 'nav_msgs/msg/Odometry':
        getters = [
            f.replace('pose.', 'pose.pose.').replace('twist.', 'twist.twist.') for f in fields
        ]
        return stamp_ns, tuple(float(attrgetter(g)(found)) for g in getters)
    if type_name in _PLAIN:
        return stamp_ns, tuple(float(attrgetter(field)(found)) for field in fields)
    return stamp_ns, ()


def _joint_values(found: Any, fields: Sequence[str]) -> tuple[float, ...]:
    names = list(found.name)
    picked = []
    for field in fields:
        array, _, name = field.partition('.')
        column = np.asarray(getattr(found, array))
        if names.count(name) != 1:
            raise ValueError(f'JointState names {names}: {name!r} needed once')
        if len(column) != len(names):
            raise ValueError(f'JointState.{array}: {len(column)} values for {len(names)} names')
        picked.append(float(column[names.index(name)]))
    return tuple(picked)
