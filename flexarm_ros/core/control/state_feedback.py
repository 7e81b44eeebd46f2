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
Joint state feedback, as on rigs with motor encoders and strain gauges.

The command of each joint is a current, from the errors of its angle, the deflection of its link
as an angle, and the rates of both, which are filtered derivatives:

    i = k_angle (reference - theta) - k_deflection alpha - k_rate theta' - k_deflection_rate alpha'

It is ``controller.law: flexarm_ros.core.control.state_feedback:StateFeedback``.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from flexarm_ros.core.arm.kinematics import inverse_kinematics
from flexarm_ros.core.control.law import Law, law_period, Sample
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.parameters.spec import parameter


@dataclass(frozen=True)
class StateFeedbackParameters:
    """Keys ``controller.StateFeedback.KEY``; arrays have one value per joint."""

    angle: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'A/rad', 'gain on the error of each joint angle', low=-1e6, high=1e6
    )
    deflection: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'A/rad', 'gain on the deflection / length of each link', low=-1e6,
        high=1e6,
    )  # fmt: skip
    rate: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'A s/rad', 'gain on the rate of each joint', low=-1e6, high=1e6
    )
    deflection_rate: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'A s/rad', 'gain on the rate of deflection / length of each link',
        low=-1e6, high=1e6,
    )  # fmt: skip
    limit: tuple[float, float] = parameter(
        (0.0, 0.0), 'float2', 'A', 'limit of the current of each joint; 0: none', low=0.0, high=1e6
    )
    rate_cutoff: float = parameter(
        40.0, 'float', 'Hz', 'natural frequency of the low-pass of the joint rates', low=0.0,
        low_open=True, high=1e6,
    )  # fmt: skip
    deflection_cutoff: float = parameter(
        2.0, 'float', 'Hz', 'natural frequency of the low-pass of the deflections and rates '
        'of deflection; a closed-loop prediction uses that of the strain gauge instead',
        low=0.0, low_open=True, high=1e6,
    )  # fmt: skip
    filter_damping: float = parameter(
        0.9, 'float', '', 'damping ratio of both low-passes', low=0.0, low_open=True, high=100.0
    )
    torque_constant: tuple[float, float] = parameter(
        (1.0, 1.0), 'float2', 'N m/A', 'torque at each joint per current', low=0.0, low_open=True,
        high=1e6,
    )  # fmt: skip


class LowPass:
    """
    A second-order low-pass with its derivative, by the semi-implicit Euler method.

    It is stable below `highest_cutoff`.
    """

    def __init__(self, cutoff: float, damping: float, period: float) -> None:
        omega = 2.0 * math.pi * cutoff
        self._square, self._drag, self._period = omega * omega, 2.0 * damping * omega, period
        self.value, self.rate = 0.0, 0.0

    def step(self, signal: float) -> None:
        """Advance ``value`` and ``rate`` by one period with ``signal``."""
        pull = self._square * (signal - self.value) - self._drag * self.rate
        self.rate += self._period * pull / (1.0 + self._period * self._drag)
        self.value += self._period * self.rate


def highest_cutoff(damping: float, period: float) -> float:
    """
    Return the cut-off, Hz, from which on `LowPass` is unstable.

    With x the natural frequency times ``period``, s, the trace of its step is
    1 + (1 - x^2) / (1 + 2 damping x), its determinant 1 / (1 + 2 damping x): an eigenvalue is -1
    at x^2 = 4 damping x + 4.
    """
    return (damping + math.sqrt(damping * damping + 1.0)) / (math.pi * period)


class StateFeedback(Law):
    """The law of this module; the reference angles are those of the commanded point."""

    Parameters = StateFeedbackParameters
    SENSOR = 'encoder'

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for a low-pass that is unstable at the law's period."""
        keys, period = config.controller.own(), law_period(config)
        highest = highest_cutoff(keys.filter_damping, period)
        for key in ('rate_cutoff', 'deflection_cutoff'):
            cutoff = getattr(keys, key)
            if cutoff >= highest:
                raise ValueError(
                    f'controller.StateFeedback.{key}: {cutoff!r} Hz, allowed with a torque every '
                    f'{period:g} s and filter_damping {keys.filter_damping!r}: below {highest:.4g}'
                )

    def __init__(self, config: RunConfig) -> None:
        super().__init__(config)
        keys, period = self.parameters, self.period
        self._rates = [LowPass(keys.rate_cutoff, keys.filter_damping, period) for _ in range(2)]
        self._bends = [
            LowPass(keys.deflection_cutoff, keys.filter_damping, period) for _ in range(2)
        ]
        self._started = False

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m); see :class:`Law`."""
        keys, plant = self.parameters, self.config.plant
        goal = inverse_kinematics(plant.spans, sample.reference[0], sample.reference[1])
        torque = []
        for j in (0, 1):
            theta = sample.encoder[j]
            if not self._started:
                self._rates[j].value = theta
            self._rates[j].step(theta)
            self._bends[j].step(sample.deflection[j] / plant.length[j])
            current = (
                keys.angle[j] * _wrapped(goal[j] - theta)
                - keys.deflection[j] * self._bends[j].value
                - keys.rate[j] * self._rates[j].rate
                - keys.deflection_rate[j] * self._bends[j].rate
            )
            if keys.limit[j] > 0.0:
                current = min(max(current, -keys.limit[j]), keys.limit[j])
            torque.append(keys.torque_constant[j] * current)
        self._started = True
        return torque[0], torque[1]


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
