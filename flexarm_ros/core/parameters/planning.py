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

"""Parameters of the laws that plan the motion: ``inverse``, ``passive``, ``lqg``, ``adaptive``."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.parameters.spec import parameter as _key


@dataclass(frozen=True)
class PlanningParameters:
    """
    What these laws take in section ``controller``, each under a name of its own.

    ``model``: the arm that they believe in; ``plan``: the planned motion; ``joint``: loops about
    the joints; ``passive``; ``lqg``: regulator and filter, ``adaptive`` too; ``adaptive``.
    """

    model_modes: int | None = _key(
        None, 'int', '', 'modes a link of the arm that the planning laws believe in; left out, '
        "here and in the other model keys: the plant's",
        key='model.modes', low=1, high=6,
    )  # fmt: skip
    model_flexural_rigidity: tuple[float, float] | None = _key(
        None, 'float2', 'N m^2', 'its EI of each link', key='model.flexural_rigidity', low=0.0,
        low_open=True, high=1e12,
    )  # fmt: skip
    model_mass_density: tuple[float, float] | None = _key(
        None, 'float2', 'kg/m', 'its mass a metre of each link', key='model.mass_density',
        low=0.0, low_open=True, high=1e6,
    )  # fmt: skip
    model_tip_latency: float | None = _key(
        None, 'float', 's', "the tip sensor's latency that they believe in",
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
        0.93, 'float', '', 'part of torque_limit that the planned motion may use, the rest is '
        'left to feedback',
        key='plan.torque_share', low=0.05, high=1.0,
    )  # fmt: skip
    joint_kp: float = _key(
        1000.0, 'float', 'N m/rad', 'laws inverse and passive: stiffness of the joint loops',
        key='joint.kp', low=0.0, high=1e9, live=True,
    )  # fmt: skip
    joint_kd: float = _key(
        1000.0, 'float', 'N m s/rad', 'their damping', key='joint.kd', low=0.0, high=1e9, live=True
    )
    passive_share: float = _key(
        0.4, 'float', '', 'law passive: part of the unplanned deflection that it leads against',
        key='passive.share', low=0.0, high=1.0, live=True,
    )  # fmt: skip
    passive_bandwidth: float = _key(
        5.0, 'float', '1/s', 'bandwidth of that', key='passive.bandwidth', low=0.0, high=100.0
    )
    lqg_tip_weight: float = _key(
        1e3, 'float', '1/(m^2 s)', "laws lqg and adaptive: regulator's weight of the "
        "tip's deviation from the plan",
        key='lqg.tip_weight', low=1e-6, high=1e12,
    )  # fmt: skip
    lqg_integral_weight: float = _key(
        1e5, 'float', '1/(m^2 s^3)', "regulator's weight of its integral",
        key='lqg.integral_weight', low=0.0, high=1e12,
    )  # fmt: skip
    lqg_torque_weight: float = _key(
        1e-4, 'float', '1/(N m)^2/s', "regulator's weight of the added torque",
        key='lqg.torque_weight', low=0.0, high=1e6,
    )  # fmt: skip
    lqg_rate_weight: float = _key(
        1e-4, 'float', 's/(N m)^2', "regulator's weight of that torque's rate",
        key='lqg.rate_weight', low=1e-12, high=1e6,
    )  # fmt: skip
    lqg_angle_std: float = _key(
        1e-5, 'float', 'rad', "filter's noise of the joint angles",
        key='lqg.angle_std', low=1e-9, high=1.0,
    )  # fmt: skip
    lqg_rate_std: float = _key(
        1e-4, 'float', 'rad/s', "filter's noise of the joint rates",
        key='lqg.rate_std', low=1e-9, high=10.0,
    )  # fmt: skip
    lqg_tip_std: float = _key(
        0.002, 'float', 'm', "filter's noise of the tip position",
        key='lqg.tip_std', low=1e-6, high=10.0,
    )  # fmt: skip
    lqg_torque_noise: float = _key(
        1e-2, 'float', 'N m s^0.5', "filter's random torque, root of its density",
        key='lqg.torque_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_joint_noise: float = _key(
        1e-3, 'float', 'rad/s^1.5', "filter's random joint acceleration, root of its density",
        key='lqg.joint_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_elastic_noise: float = _key(
        1e-3, 'float', 'm/s^1.5', "filter's random elastic acceleration, root of its density",
        key='lqg.elastic_noise', low=0.0, high=1e3,
    )  # fmt: skip
    lqg_model_std: float = _key(
        0.06, 'float', '', 'standard deviation of the logarithms of EI and mass density',
        key='lqg.model_std', low=0.0, high=0.5,
    )  # fmt: skip
    lqg_latency_std: float = _key(
        0.002, 'float', 's', 'standard deviation of the tip latency',
        key='lqg.latency_std', low=0.0, high=0.05,
    )  # fmt: skip
    adaptive_wander: float = _key(
        0.02, 'float', '1/s^0.5', 'law adaptive: drift of EI, density and latency that it '
        'allows for, in their standard deviations',
        key='adaptive.wander', low=0.0, high=10.0,
    )  # fmt: skip
