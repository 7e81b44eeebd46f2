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

"""Interface of the control laws."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import Any, ClassVar, NamedTuple

from flexarm_ros.core.parameters.sections import RunConfig


class Sample(NamedTuple):
    """
    All inputs of the controller at one tick.

    ``q``, ``qd``: plant coordinates and rates of this tick, theta1, theta2 first
    (rad, rad/s), undelayed.  ``deflection``: delta1, delta2 (m) of this tick.
    ``encoder``: theta1, theta2, dtheta1, dtheta2 as delivered.  ``tip``: x, y,
    vx, vy of the sensed point as delivered.  ``reference``: x, y, vx, vy of the
    command as delivered (m, m/s, frame ``base``).
    """

    q: Sequence[float]
    qd: Sequence[float]
    deflection: tuple[float, float]
    encoder: tuple[float, float, float, float]
    tip: tuple[float, float, float, float]
    reference: tuple[float, float, float, float]


def torque_fault(k: int, torque: tuple[float, float]) -> str | None:
    """Return a description of the non-finite torque of tick ``k``, ``None`` without one."""
    if math.isfinite(torque[0]) and math.isfinite(torque[1]):
        return None
    joint = 0 if not math.isfinite(torque[0]) else 1
    return f'tick {k}: torque at the {("shoulder", "elbow")[joint]} is {torque[joint]} N m'


@dataclass(frozen=True)
class NoParameters:
    """The parameters of a law that has none of its own."""


def law_period(config: RunConfig) -> float:
    """Return the time between the torques of the law of ``config``, s."""
    rate = config.controller.rate
    return 1.0 / rate if rate else config.run.control_period


class Law:
    """
    A control law: a function of the tick's sample, with internal state if needed.

    A law from outside this package may have a ``NAME``, left out that of its class, and
    ``Parameters``, a frozen dataclass whose fields are made by
    `flexarm_ros.core.parameters.spec.parameter`: they are the keys ``controller.NAME.KEY``, and
    ``self.parameters`` is the instance of the scenario.  Between ticks `retune` may give it
    other live gains.
    """

    NAME: ClassVar[str] = ''
    Parameters: ClassVar[type] = NoParameters
    PLANS: ClassVar[bool] = False
    """Whether it computes the whole motion before the first tick."""
    SENSOR: ClassVar[str] = ''
    """Role of the sensor that closes the loop; empty: ``controller.feedback``."""
    TIME_VARYING: ClassVar[bool] = False
    """Whether its gains change with time."""
    MODELS_LATENCY: ClassVar[bool] = False
    """Whether its model includes ``tip_sensor.latency``."""
    EVERY_TICK: ClassVar[bool] = False
    """Whether it must compute a torque at every tick, so that ``controller.rate`` is refused."""

    parameters: Any
    """Its own parameters, an instance of ``Parameters``; None for a law of this package."""
    gain: float = math.nan
    """The factor lambda of the last tick; nan for a law without it."""

    def __init__(self, config: RunConfig) -> None:
        self.config = config
        self.parameters = config.controller.own()

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError``, which names the key, if ``config`` is invalid for this law."""

    @property
    def period(self) -> float:
        """Time between its torques, s."""
        return law_period(self.config)

    def retune(self, config: RunConfig) -> None:
        """Use the live gains of ``config`` from the next tick on; the state is kept."""
        self.config = config
        self.parameters = config.controller.own()

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m) for tick ``k``; called once per tick, in order."""
        raise NotImplementedError
