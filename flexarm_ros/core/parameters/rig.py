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

"""Sections of optional parts: strain gauges, an IMU, the joints' drives, disturbances."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class StrainGaugeParameters(ChannelParameters):
    """Section ``strain_gauge``: the strain gauge on each link."""

    location: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'm', 'location on the flexible part of each link, from its root',
        low=0.0, high=1e4,
    )  # fmt: skip
    output: str = _key(
        'strain', 'str', '', 'strain: curvature of the link at the gauge, 1/m; deflection: end '
        'deflection, m, of a link that an end force bends to that curvature; angle: '
        'end deflection per length of the link, rad; each times gain',
        choices=('strain', 'deflection', 'angle'),
    )  # fmt: skip
    gain: tuple[float, float] = _key(
        (1.0, 1.0), 'float2', '', 'gain of each gauge; for a surface strain, the distance of the '
        'surface from the neutral axis, m', low=-1e6, high=1e6,
    )  # fmt: skip
    offset: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', '', 'reading of each gauge for a straight link, in the unit of '
        'output', low=-1e4, high=1e4,
    )  # fmt: skip
    offset_slope: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', '1/rad', 'change of the offset per angle of the joint of the link',
        low=-1e4, high=1e4,
    )  # fmt: skip
    filter_cutoff: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'Hz', 'natural frequency of the second-order low-pass; 0: none',
        low=0.0, high=1e6,
    )  # fmt: skip
    filter_damping: tuple[float, float] = _key(
        (0.7, 0.7), 'float2', '', 'damping ratio of the low-pass', low=0.0, low_open=True,
        high=100.0,
    )  # fmt: skip
    noise_std: float = _key(
        0.0, 'float', '', 'standard deviation of the noise of each gauge, after the low-pass, in '
        'the unit of output', low=0.0, high=1e6, live=True,
    )  # fmt: skip

    def unit(self, link: int) -> str:
        """
        Return the unit of a reading of ``link`` (0 or 1).

        With output ``strain`` a gain other than 1 is taken as a distance, m: see ``gain``.
        """
        curvature = '1/m' if self.gain[link] == 1.0 else 'm/m'
        return {'strain': curvature, 'deflection': 'm', 'angle': 'rad'}[self.output]

    def deflection_per_curvature(self, link: int, length: float) -> float:
        """
        Return the end deflection per curvature at the gauge, m^2, of a link bent by an end force.

        ``link`` (0 or 1) has the ``length``, m; the gauge is not at its end.
        """
        return length * length * length / (3.0 * (length - self.location[link]))

    def deflection_per_reading(self, link: int, length: float) -> float:
        """
        Return the end deflection that a reading of 1 stands for, m: see ``output``.

        A gain is taken as known where it is the distance of the surface from the neutral axis
        (``strain``), otherwise as 1: of a calibrated gauge it is the error of the calibration.
        """
        if self.output == 'strain':
            return self.deflection_per_curvature(link, length) / self.gain[link]
        return length if self.output == 'angle' else 1.0


@dataclass(frozen=True)
class ImuParameters(ChannelParameters):
    """Section ``imu``: an inertial measurement unit on the bent arm."""

    location: float | None = _key(
        None, 'float', 'm', 'location from the shoulder along the arm; default: the tip', low=0.0,
        high=2e4,
    )  # fmt: skip
    accel_noise_density: float = _key(
        0.0, 'float', 'm/s^2/sqrt(Hz)', 'white noise of the specific force, each axis; the '
        'standard deviation of a sample is the density / sqrt(sample interval)', low=0.0,
        high=1e6, live=True,
    )  # fmt: skip
    gyro_noise_density: float = _key(
        0.0, 'float', 'rad/s/sqrt(Hz)', 'white noise of the rate of turn', low=0.0, high=1e6,
        live=True,
    )  # fmt: skip
    accel_bias: float = _key(
        0.0, 'float', 'm/s^2', 'constant bias of the specific force, each axis', low=-1e6, high=1e6
    )
    gyro_bias: float = _key(
        0.0, 'float', 'rad/s', 'constant bias of the rate of turn', low=-1e6, high=1e6
    )
    accel_bias_walk: float = _key(
        0.0, 'float', 'm/s^3/sqrt(Hz)', 'random walk of the bias of the specific force, each '
        'axis, from 0: its standard deviation after t s is this value times sqrt(t)', low=0.0,
        high=1e6,
    )  # fmt: skip
    gyro_bias_walk: float = _key(
        0.0, 'float', 'rad/s^2/sqrt(Hz)', 'random walk of the bias of the rate of turn', low=0.0,
        high=1e6,
    )  # fmt: skip


@dataclass(frozen=True)
class ActuatorParameters(ChannelParameters):
    """Section ``actuator``: the drives of both joints and the channel of the command."""

    bandwidth: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'Hz', 'bandwidth of the torque loop of each drive, a first-order '
        'lag; 0: immediate', low=0.0, high=1e6,
    )  # fmt: skip
    torque_limit: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m', 'saturation of the torque of each drive, at the joint; '
        '0: none', low=0.0, high=1e9,
    )  # fmt: skip
    torque_constant: tuple[float, float] = _key(
        (1.0, 1.0), 'float2', 'N m/A', 'torque constant of each motor, before the gear; for '
        'measured currents, without effect on a run', low=0.0, low_open=True, high=1e6,
    )  # fmt: skip
    gear_ratio: tuple[float, float] = _key(
        (1.0, 1.0), 'float2', '', 'motor turns per joint turn of each drive; for measured '
        'currents, without effect on a run', low=0.0, low_open=True, high=1e6,
    )  # fmt: skip
    efficiency: tuple[float, float] = _key(
        (1.0, 1.0), 'float2', '', 'fraction of the commanded torque that arrives at each joint',
        low=0.0, low_open=True, high=1.0,
    )  # fmt: skip
    backlash: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'rad', 'play of each gear, end to end, at the joint', low=0.0,
        high=1.0,
    )  # fmt: skip
    rotor_share: tuple[float, float] = _key(
        (0.9, 0.9), 'float2', '', 'fraction of plant.hub_inertia on the motor side of a gear with '
        'backlash; the rest turns with the joint', low=0.01, high=0.99,
    )  # fmt: skip
    resolution: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m', 'step of the commanded torque of each drive; 0: none',
        low=0.0, high=1e9,
    )  # fmt: skip

    def rotors(self, hub_inertia: tuple[float, float]) -> tuple[float, float]:
        """Return the inertias, kg m^2, that backlash parts from their joints; 0 without any."""
        first, second = (
            hub * share if gap > 0.0 else 0.0
            for hub, share, gap in zip(hub_inertia, self.rotor_share, self.backlash, strict=True)
        )
        return first, second

    @property
    def torque_per_ampere(self) -> tuple[float, float]:
        """Return the torque at each joint per ampere of its motor, N m/A."""
        first, second = (
            constant * ratio * part
            for constant, ratio, part in zip(
                self.torque_constant, self.gear_ratio, self.efficiency, strict=True
            )
        )
        return first, second


@dataclass(frozen=True)
class DisturbanceParameters:
    """
    Section ``disturbance``: a force at the tip and changes of the payload.

    The payload is on a topic if it comes from a file or is ``payload_live``.  The files' rows
    become the arrays beside them when a user's scenario is read, so that they travel with it.
    """

    force_file: str | None = _key(
        None, 'str', '', 'CSV t,fx,fy of a force at the tip, s and N in base; linear between '
        'rows, taken at the middle of each tick; path relative to the scenario',
    )  # fmt: skip
    payload_file: str | None = _key(
        None, 'str', '', 'CSV t,payload_mass, s and kg: payload at the tip from the first tick '
        'at or after t on; path relative to the scenario',
    )  # fmt: skip
    payload_live: bool = _key(
        False, 'bool', '', 'true: disturbance/payload exists without payload_file too, for an '
        'external node that sets the payload at each tick; the integration steps of the plant '
        'are then chosen for any payload, otherwise for the lightest in payload_file',
    )  # fmt: skip
    force_times: tuple[float, ...] | None = _key(
        None, 'floats', 's', 'column t of force_file', low=-1e7, high=1e7
    )
    force_x: tuple[float, ...] | None = _key(
        None, 'floats', 'N', 'column fx of force_file', low=-1e9, high=1e9
    )
    force_y: tuple[float, ...] | None = _key(
        None, 'floats', 'N', 'column fy of force_file', low=-1e9, high=1e9
    )
    payload_times: tuple[float, ...] | None = _key(
        None, 'floats', 's', 'column t of payload_file', low=-1e7, high=1e7
    )
    payload_masses: tuple[float, ...] | None = _key(
        None, 'floats', 'kg', 'column payload_mass of payload_file', low=0.0, high=1e6
    )

    @property
    def varies_payload(self) -> bool:
        """Return whether the payload is on a topic."""
        return self.payload_live or bool(self.payload_masses)

    def payload_at(self, time: float, mass: float) -> float:
        """Return the payload, kg, at ``time``, s; before the first row ``mass``."""
        rows = zip(self.payload_times or (), self.payload_masses or (), strict=True)
        return next((m for t, m in reversed([*rows]) if t <= time), mass)

    def lightest(self, mass: float) -> float:
        """Return the lightest payload that is allowed, kg; ``mass``: ``plant.payload_mass``."""
        return 0.0 if self.payload_live else min(mass, *(self.payload_masses or (mass,)))
