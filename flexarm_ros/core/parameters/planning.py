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

"""Parameters of the motion-planning laws: ``inverse``, ``passive``, ``lqg``, ``adaptive``."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class PlanningParameters:
    """
    Keys of these laws in section ``controller``, in groups.

    ``model``: the controller's model of the arm; ``plan``: the planned motion; ``joint``: joint
    loops; ``passive``; ``lqg``: regulator and filter, also of ``adaptive``; ``adaptive``.
    """

    model_modes: int | None = _key(
        None, 'int', '', 'planning laws, model of the arm: assumed modes per link; default (for '
        'every model key): that of the plant',
        key='model.modes', low=1, high=6,
    )  # fmt: skip
    model_flexural_rigidity: tuple[float, float] | None = _key(
        None, 'float2', 'N m^2',
        'model of the arm: EI of each link', key='model.flexural_rigidity', low=0.0,
        low_open=True, high=1e12,
    )  # fmt: skip
    model_mass_density: tuple[float, float] | None = _key(
        None, 'float2', 'kg/m',
        'model of the arm: mass per metre of each link', key='model.mass_density',
        low=0.0, low_open=True, high=1e6,
    )  # fmt: skip
    model_tip_latency: float | None = _key(
        None, 'float', 's', 'model of the arm: latency of the tip sensor',
        key='model.tip_latency', low=0.0, high=0.2, whole_ns=True,
    )  # fmt: skip
    plan_tip_weight: float = _key(
        1e4, 'float', '1/(m^2 s)', "planned motion: weight of the tip's error",
        key='plan.tip_weight', low=1e-6, high=1e12,
    )  # fmt: skip
    plan_torque_weight: float = _key(
        1e-4, 'float', '1/(N m)^2/s', 'planned motion: weight of the torque',
        key='plan.torque_weight', low=0.0, high=1e6,
    )  # fmt: skip
    plan_rate_weight: float = _key(
        1e-5, 'float', 's/(N m)^2', "planned motion: weight of the torque's rate",
        key='plan.rate_weight', low=1e-12, high=1e6,
    )  # fmt: skip
    plan_torque_share: float = _key(
        0.93, 'float', '', 'fraction of torque_limit for the planned motion; the rest is reserved '
        'for feedback',
        key='plan.torque_share', low=0.05, high=1.0,
    )  # fmt: skip
    joint_kp: float = _key(
        1000.0, 'float', 'N m/rad', 'laws inverse and passive: stiffness of the joint loops',
        key='joint.kp', low=0.0, high=1e9, live=True,
    )  # fmt: skip
    joint_kd: float = _key(
        1000.0, 'float', 'N m s/rad', 'damping of the joint loops', key='joint.kd', low=0.0,
        high=1e9, live=True,
    )  # fmt: skip
    passive_share: float = _key(
        0.4, 'float', '', 'law passive: fraction of the unplanned deflection that is compensated',
        key='passive.share', low=0.0, high=1.0, live=True,
    )  # fmt: skip
    passive_bandwidth: float = _key(
        5.0, 'float', '1/s', 'law passive: bandwidth of the tip-correction low-pass',
        key='passive.bandwidth', low=0.0, high=100.0,
    )  # fmt: skip
    lqg_tip_weight: float = _key(
        1e3, 'float', '1/(m^2 s)', "laws lqg and adaptive, regulator: weight of the tip's "
        'deviation from the plan',
        key='lqg.tip_weight', low=1e-6, high=1e12,
    )  # fmt: skip
    lqg_integral_weight: float = _key(
        1e5, 'float', '1/(m^2 s^3)', "regulator: weight of the integral of the tip's deviation",
        key='lqg.integral_weight', low=0.0, high=1e12,
    )  # fmt: skip
    lqg_torque_weight: float = _key(
        1e-4, 'float', '1/(N m)^2/s', 'regulator: weight of the added torque',
        key='lqg.torque_weight', low=0.0, high=1e6,
    )  # fmt: skip
    lqg_rate_weight: float = _key(
        1e-4, 'float', 's/(N m)^2', 'regulator: weight of the rate of the added torque',
        key='lqg.rate_weight', low=1e-12, high=1e6,
    )  # fmt: skip
    lqg_angle_std: float = _key(
        1e-5, 'float', 'rad', 'filter: standard deviation of the joint angle noise',
        key='lqg.angle_std', low=1e-9, high=1.0,
    )  # fmt: skip
    lqg_rate_std: float = _key(
        1e-4, 'float', 'rad/s', 'filter: standard deviation of the joint rate noise',
        key='lqg.rate_std', low=1e-9, high=10.0,
    )  # fmt: skip
    lqg_tip_std: float = _key(
        0.002, 'float', 'm', 'filter: standard deviation of the tip position noise',
        key='lqg.tip_std', low=1e-6, high=10.0,
    )  # fmt: skip
    lqg_torque_noise: float = _key(
        1e-2, 'float', 'N m s^0.5', 'filter: random torque, root of its spectral density',
        key='lqg.torque_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_joint_noise: float = _key(
        1e-3, 'float', 'rad/s^1.5',
        'filter: random joint acceleration, root of its spectral density',
        key='lqg.joint_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_elastic_noise: float = _key(
        1e-3, 'float', 'm/s^1.5',
        'filter: random elastic acceleration, root of its spectral density',
        key='lqg.elastic_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_model_std: float = _key(
        0.06, 'float', '', 'filter: standard deviation of the logarithms of EI and mass density',
        key='lqg.model_std', low=0.0, high=0.5,
    )  # fmt: skip
    lqg_latency_std: float = _key(
        0.002, 'float', 's', 'filter: standard deviation of the tip sensor latency',
        key='lqg.latency_std', low=0.0, high=0.05,
    )  # fmt: skip
    adaptive_wander: float = _key(
        0.02, 'float', '1/s^0.5', 'law adaptive: drift of EI, density and latency, relative to '
        'their standard deviations',
        key='adaptive.wander', low=0.0, high=10.0,
    )  # fmt: skip
