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

"""The motions that are compared with Exudyn: two links of design.md, no hub inertia."""

from __future__ import annotations

import math

from validation.motion import Case, Torque


def _sine(amplitude: float, hertz: float, begin: float = 0.0, end: float = math.inf) -> Torque:
    def torque(time: float) -> tuple[float, float]:
        if not begin <= time < end:
            return 0.0, 0.0
        return amplitude * math.sin(2.0 * math.pi * hertz * (time - begin)), 0.0

    return torque


def _joints(shoulder: Torque, elbow: Torque) -> Torque:
    return lambda time: (shoulder(time)[0], elbow(time)[0])


CASES: dict[str, Case] = {
    'shoulder_pulse': Case((0.0, 1.0), 3.0, torque=_sine(50.0, 1.0, end=1.0)),
    'pulses_both': Case(
        (0.0, 1.0), 5.0, torque=_joints(_sine(20.0, 1.0, end=1.0), _sine(-20.0, 1.0, 0.5, 1.5))
    ),
    'torques_both': Case(
        (0.0, 0.5 * math.pi), 5.0, torque=_joints(_sine(20.0, 1.0), _sine(20.0, 1.0))
    ),
    'torques_opposed': Case((0.0, 0.5), 5.0, torque=_joints(_sine(20.0, 0.5), _sine(-20.0, 1.0))),
    'free_bent': Case((0.0, 0.5 * math.pi), 5.0, rates=(1.5, 0.0)),
    'free_both': Case((0.0, 0.3), 5.0, rates=(1.5, 1.5)),
    'payload_pulse': Case((0.0, 1.0), 3.0, torque=_sine(20.0, 1.0, end=1.0), payload=0.5),
}
"""Name -> motion; torques smooth from 0, since steps on a hub without inertia ring."""

BEYOND: dict[str, Case] = {
    'pulse_100': Case((0.0, 1.0), 3.0, torque=_sine(100.0, 1.0, end=1.0)),
    'pulse_200': Case((0.0, 1.0), 3.0, torque=_sine(200.0, 1.0, end=1.0)),
}
"""Motions that bend the links further than the model is made for."""
