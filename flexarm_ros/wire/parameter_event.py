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
Live parameters in a bag: one ``rcl_interfaces/ParameterEvent`` for each change.

A bag has the topic only if a parameter was set during the run, so that the bytes of other runs
do not depend on it.  Log time and stamp are those of the first tick with the new value.
"""

from __future__ import annotations

from typing import Any

from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import keys, SECTIONS
from flexarm_ros.core.parameters.spec import check
from flexarm_ros.core.timeline import NS_PER_S, T0_NS
from flexarm_ros.wire.generic_decode import message, typestore
from flexarm_ros.wire.topics import Qos
import numpy as np

TOPIC = 'lockstep/changes'
"""Relative name, as published by the nodes."""

PATH = '/' + TOPIC
TYPE = 'rcl_interfaces/msg/ParameterEvent'
QOS = Qos(durability='transient_local')
_DOUBLE = 3
"""rcl_interfaces/msg/ParameterType.PARAMETER_DOUBLE"""


def encode(change: Change, period_ns: int) -> bytes:
    """Return a change as a serialized ParameterEvent."""
    types = typestore().types
    none: Any = np.array([], np.uint8)
    value = types['rcl_interfaces/msg/ParameterValue'](
        type=_DOUBLE, bool_value=False, integer_value=0, double_value=change.value,
        string_value='', byte_array_value=none, bool_array_value=none.astype(bool),
        integer_array_value=none.astype(np.int64), double_array_value=none.astype(np.float64),
        string_array_value=[],
    )  # fmt: skip
    parameter = types['rcl_interfaces/msg/Parameter'](name=change.key, value=value)
    stamp_ns = T0_NS + change.tick * period_ns
    event = types[TYPE](
        stamp=types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, NS_PER_S)),
        node=change.node, new_parameters=[], changed_parameters=[parameter],
        deleted_parameters=[],
    )  # fmt: skip
    return bytes(typestore().serialize_cdr(event, TYPE))


def decode(data: bytes, period_ns: int) -> Change:
    """Undo `encode`; ValueError if the message is not such a change."""
    event = message(TYPE, data)
    stamp_ns = event.stamp.sec * NS_PER_S + event.stamp.nanosec
    tick, rest = divmod(stamp_ns - T0_NS, period_ns)
    if rest or tick < 0 or len(event.changed_parameters) != 1:
        raise ValueError('a change of one parameter at a tick is expected')
    parameter = event.changed_parameters[0]
    return checked(Change(int(tick), event.node, parameter.name, parameter.value.double_value))


def checked(change: Change) -> Change:
    """
    Return ``change``; ValueError if the parameter is not live or the value not allowed.

    Values from the network or from a file are checked like those of a scenario.
    """
    known = change.node in SECTIONS and change.node != '/**'
    entry = keys(change.node).get(change.key) if known else None
    if entry is None or not entry[1].live:
        raise ValueError(f'{change.node}.{change.key}: no parameter that may change in a run')
    check(f'{change.node}.{change.key}', entry[1].item, change.value)
    return change
