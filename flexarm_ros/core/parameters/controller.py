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

"""Keys of the control law: section ``controller``, and registered laws."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from flexarm_ros.core.parameters.channel import LONGEST_S
from flexarm_ros.core.parameters.planning import PlanningParameters
from flexarm_ros.core.parameters.spec import parameter as _key


class OwnLaw(NamedTuple):
    """A law from outside this package: its keys are ``controller.PREFIX.KEY``."""

    prefix: str
    parameters: type
    """A frozen dataclass of `flexarm_ros.core.parameters.spec.parameter` fields."""


OWN_LAWS: dict[str, OwnLaw] = {}
"""``controller.law`` -> a law from outside this package that has been registered."""


@dataclass(frozen=True)
class FeedbackParameters:
    """Choice of the control law, and parameters of the paper's laws."""

    law: str = _key(
        'fls', 'str', '', 'control law: pd is (20), fls is (21); inverse, passive, lqg, '
        'adaptive: see docs/controllers.md; or the name of an installed law, or '
        'package.module:Class',
        choices=('pd', 'fls', 'open_loop', 'inverse', 'passive', 'lqg', 'adaptive'),
    )  # fmt: skip
    feedback: str = _key(
        'tip_sensor', 'str', '', 'sensor that closes the loop', choices=('encoder', 'tip_sensor')
    )
    velocity_source: str = _key(
        'feedback', 'str', '', 'feedback: rates as measured with the position; encoder: '
        'undelayed joint rates',
        choices=('feedback', 'encoder'),
    )  # fmt: skip
    deflection_source: str = _key(
        'plant', 'str', '', 'end deflections that the law uses; plant: exact, undelayed; '
        'strain_gauge: from the readings of the strain gauges',
        choices=('plant', 'strain_gauge'), paper='plant',
    )  # fmt: skip
    kp: float = _key(
        150.79, 'float', 'N/m', 'proportional gain of (10)', low=0.0, high=1e9, live=True,
        paper='150.79',
    )  # fmt: skip
    kd: float = _key(
        17.364, 'float', 'N s/m', 'derivative gain of (11)', low=0.0, high=1e9, live=True,
        paper='17.364',
    )  # fmt: skip
    ks: float = _key(
        15.0, 'float', '', 'scaling gain K_s of (21)', low=0.0, high=1e6, live=True, paper='15'
    )
    kn: float = _key(
        5.0, 'float', 'm', 'normalising gain K_n of the deflections', low=0.0, low_open=True,
        high=1e6, live=True, paper='5',
    )  # fmt: skip
    torque_file: str | None = _key(
        None, 'str', '', 'CSV t,tau1,tau2 for law open_loop; path relative to the scenario'
    )
    torque_limit: float = _key(
        0.0, 'float', 'N m', 'torque limit of each joint; 0: none', low=0.0, high=1e9, live=True
    )
    rate: float = _key(
        0.0, 'float', 'Hz', 'rate at which the law is computed, an integer number of ticks per '
        'torque, which is held in between; 0: every tick', low=0.0, high=1e9,
    )  # fmt: skip
    compute_delay: float = _key(
        0.0, 'float', 's', 'computing time of the law: the torque of a sample takes effect '
        'at the first tick this long after the sample or later', low=0.0, high=LONGEST_S,
        whole_ns=True,
    )  # fmt: skip


@dataclass(frozen=True)
class ControllerParameters(PlanningParameters, FeedbackParameters):
    """
    Section ``controller``: the control law and its gains.

    ``laws``: ``(prefix, parameters)`` of laws from outside this package that are not at their
    defaults.
    """

    laws: tuple[tuple[str, Any], ...] = ()

    def own(self, law: str = '') -> Any:
        """Return the parameters of the registered ``law``, by default of this law, or None."""
        found = OWN_LAWS.get(law or self.law)
        if found is None:
            return None
        held = dict(self.laws)
        return held[found.prefix] if found.prefix in held else found.parameters()
