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

"""Keys of the arm: section ``plant``."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class PlantParameters:
    """Section ``plant``: the arm."""

    model: str = _key(
        'eq14', 'str', '',
        'eq14: equation (14) as printed, rigid Coriolis terms only; full: all inertia terms '
        'and the foreshortening of the links',
        choices=('eq14', 'full'), paper='eq14',
    )  # fmt: skip
    modes: int = _key(1, 'int', '', 'assumed modes per link', low=1, high=6, paper='1')
    basis: str = _key(
        'arm_modes', 'str', '',
        'shape functions of the full model: arm_modes: fitted to the modes of this arm; '
        'craig_bampton: static shapes and clamped modes; clamped_free: cantilever modes',
        choices=('arm_modes', 'craig_bampton', 'clamped_free'),
    )  # fmt: skip
    length: tuple[float, float] = _key(
        (4.5, 4.5), 'float2', 'm', 'length of the flexible part of each link', low=0.0,
        low_open=True, high=1e4, paper='4.5',
    )  # fmt: skip
    hub_radius: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'm', 'length of the rigid, massless part of each link between its '
        'joint and its flexible part', low=0.0, high=1e4,
    )  # fmt: skip
    end_offset: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'm', 'length of the rigid, massless part of each link between its '
        'flexible part and the next joint or the tip', low=0.0, high=1e4,
    )  # fmt: skip
    mass_density: tuple[float, float] = _key(
        (0.335, 0.335), 'float2', 'kg/m', 'mass per metre of each link', low=0.0, low_open=True,
        high=1e6, paper='0.335',
    )  # fmt: skip
    flexural_rigidity: tuple[float, float] = _key(
        (1676.0, 1676.0), 'float2', 'N m^2', 'EI of each link', low=0.0, low_open=True,
        high=1e12, paper='1676',
    )  # fmt: skip
    hub_inertia: tuple[float, float] = _key(
        (8.0, 8.0), 'float2', 'kg m^2',
        'reflected actuator inertia acting on the rates of theta1 and theta2', low=0.0, high=1e6,
    )  # fmt: skip
    payload_mass: float = _key(0.0, 'float', 'kg', 'point mass at the tip', low=0.0, high=1e6)
    payload_inertia: float = _key(
        0.0, 'float', 'kg m^2', 'rotary inertia at the tip', low=0.0, high=1e6
    )
    link_end_mass: float = _key(
        0.0, 'float', 'kg', 'point mass at the end of link 1', low=0.0, high=1e6
    )
    link_end_inertia: float = _key(
        0.0, 'float', 'kg m^2', 'rotary inertia at the end of link 1', low=0.0, high=1e6
    )
    damping_ratio: float = _key(0.0, 'float', '', 'modal damping ratio', low=0.0, high=1.0)
    link_damping: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m s/rad', 'material (Kelvin-Voigt) damping of each link: root '
        'moment per rate of deflection / length, in addition to damping_ratio', low=0.0,
        high=1e9,
    )  # fmt: skip
    viscous_friction: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m s/rad', 'viscous friction of each joint', low=0.0, high=1e9
    )
    coulomb_friction: tuple[float, float] = _key(
        (0.0, 0.0), 'float2', 'N m', 'Coulomb friction of each joint, also the breakaway torque',
        low=0.0, high=1e9,
    )  # fmt: skip
    coulomb_friction_negative: tuple[float, float] | None = _key(
        None, 'float2', 'N m', 'Coulomb friction of each joint at negative rates; default: '
        'coulomb_friction', low=0.0, high=1e9,
    )  # fmt: skip
    substeps: int | None = _key(
        None, 'int', '', 'integration steps per tick; default: from the highest frequency',
        low=1, high=100000,
    )  # fmt: skip
    deflection_limit: tuple[float, float] | None = _key(
        None, 'float2', 'm', 'end deflection of each link beyond which the run is unstable; '
        'default: 10/9 of the length of each link',
        low=0.0, low_open=True, high=1e5, paper='5',
    )  # fmt: skip
    initial_position: tuple[float, float] | None = _key(
        None, 'float2', 'rad', 'initial joint angles; default: on the reference',
        low=-1e4, high=1e4,
    )  # fmt: skip
    initial_velocity: tuple[float, float] | None = _key(
        None, 'float2', 'rad/s', 'initial joint rates; default: at rest', low=-1e4, high=1e4
    )
    command_hold: float = _key(
        0.5, 'float', 's', 'with `sync: free`, time for which the last torque is held if no new '
        'one arrives; then `plant.command_loss` applies', low=0.0, high=1e7,
    )  # fmt: skip
    command_loss: str = _key(
        'end', 'str', '', 'with `sync: free`, end: the run ends if no torque has arrived for '
        '`plant.command_hold`; zero: zero torque until the next one arrives',
        choices=('end', 'zero'),
    )  # fmt: skip

    @property
    def spans(self) -> tuple[float, float]:
        """Return the distances shoulder to elbow and elbow to tip, m, of straight links."""
        hubs, lengths, ends = self.hub_radius, self.length, self.end_offset
        return hubs[0] + lengths[0] + ends[0], hubs[1] + lengths[1] + ends[1]

    @property
    def reach(self) -> float:
        """Return the distance shoulder to tip, m, of a straight arm."""
        return self.spans[0] + self.spans[1]

    def flexible_part(self, link: int, distance: float) -> tuple[float, float]:
        """
        Split a distance, m, from the joint of ``link`` (0 or 1).

        Returns its part along the flexible length and that beyond the flexible length.
        """
        past_hub = distance - self.hub_radius[link]
        bent = min(max(past_hub, 0.0), self.length[link])
        return bent, max(past_hub - bent, 0.0)
