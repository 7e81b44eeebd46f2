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
Control laws, by their names in ``controller.law`` of a scenario.

Imports the arm, the sensors, the numerics, the parameters, the timeline and the trajectory.
"""

from __future__ import annotations

import math

from flexarm_ros.core.control.law import Law, Sample, torque_fault
from flexarm_ros.core.control.lqg import AdaptiveLaw, LqgLaw
from flexarm_ros.core.control.open_loop import OpenLoopLaw
from flexarm_ros.core.control.pd import FlsLaw, fuzzy_gain, PdLaw
from flexarm_ros.core.control.planned import InverseLaw, PassiveLaw
from flexarm_ros.core.parameters.sections import OWN_LAWS, OwnLaw, RunConfig

LAWS: dict[str, type[Law]] = {
    'pd': PdLaw,
    'fls': FlsLaw,
    'open_loop': OpenLoopLaw,
    'inverse': InverseLaw,
    'passive': PassiveLaw,
    'lqg': LqgLaw,
    'adaptive': AdaptiveLaw,
}
"""Name of a law -> its class."""

PLANNING = tuple(name for name, law in LAWS.items() if law.PLANS)
"""Laws that compute the whole motion before the first tick."""

BUILT_IN = tuple(LAWS)

__all__ = [
    'BUILT_IN',
    'LAWS',
    'PLANNING',
    'Law',
    'Sample',
    'gain_of',
    'make_law',
    'register_law',
    'torque_fault',
]


def register_law(name: str, law: type[Law], prefix: str = '') -> None:
    """
    Register ``law`` as ``controller.law: name``, with the keys ``controller.PREFIX.KEY``.

    ``prefix`` left out is ``name``.  The class is not checked here, but by the
    caller (`flexarm_ros.scenario.plugins.registry`).
    """
    LAWS[name] = law
    OWN_LAWS[name] = OwnLaw(prefix or name, law.Parameters)


def make_law(config: RunConfig) -> Law:
    """Return the law of ``config``; ``ValueError`` names a key that it cannot take."""
    return LAWS[config.controller.law](config)


def gain_of(config: RunConfig, delta1: float, delta2: float) -> float:
    """Return the law's lambda for recorded end deflections, m; nan if it has none."""
    return fuzzy_gain(config, delta1, delta2) if config.controller.law == 'fls' else math.nan
