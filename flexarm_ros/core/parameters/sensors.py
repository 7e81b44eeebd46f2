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

"""Keys of the required sensors: sections ``encoder`` and ``tip_sensor``."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.channel import ChannelParameters, LONGEST_S
from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class EncoderParameters(ChannelParameters):
    """Section ``encoder``: the joint encoders."""

    resolution: float = _key(
        0.0, 'float', 'rad', 'angle of one count; 0: ideal', low=0.0, high=1.0, live=True
    )
    noise_std: float = _key(
        0.0, 'float', 'rad', 'standard deviation of the angle noise', low=0.0, high=1.0, live=True
    )
    offset: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'rad', 'reading of each encoder at angle zero', low=-1e4, high=1e4
    )


@dataclass(frozen=True)
class TipSensorParameters(ChannelParameters):
    """Section ``tip_sensor``: the position sensor on link 2."""

    location: float = _key(
        9.0, 'float', 'm', 'location from the shoulder along the arm, between elbow and tip',
        low=0.0, high=2e4, paper='9.0 or 6.75',
    )  # fmt: skip
    more_locations: tuple[float, ...] | None = _key(
        None, 'floats', 'm', 'locations of further sensors, between elbow and tip, recorded only: '
        'like the first, with their own noise, on `tip_sensor/odometry_1` and so on',
        low=0.0, high=2e4,
    )  # fmt: skip
    measurand: str = _key(
        'rigid', 'str', '', 'rigid: kinematics of the joint angles (Figure 4); elastic: point of '
        'the bent arm',
        choices=('rigid', 'elastic'),
    )  # fmt: skip
    latency: float = _key(
        0.0, 'float', 's', 'age of a measurement at delivery', low=0.0, high=LONGEST_S,
        whole_ns=True, live=True, paper='(18): 0.001238',
    )  # fmt: skip
    latency_model: str = _key(
        'buffer', 'str', '', 'buffer: exact; pade2: second-order Pade approximation',
        choices=('buffer', 'pade2'),
    )  # fmt: skip
    noise_std: float = _key(
        0.0, 'float', 'm', 'standard deviation of the position noise', low=0.0, high=100.0,
        live=True,
    )  # fmt: skip
