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

"""A probe on each link: a sensor with parameters, noise and latency of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.parameters.spec import parameter
from flexarm_ros.core.run.part import Column
from flexarm_ros.core.run.state import State
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Joints, LINKS, Signal

TOPIC = 'strain_probe/strain'


@dataclass(frozen=True)
class Probe:
    """Section ``strain_probe``."""

    gain: float = parameter(
        0.01, 'float', '1/m', 'strain per end deflection', low=0.0, high=10.0, live=True
    )
    noise_std: float = parameter(
        0.0, 'float', '', 'standard deviation of the strain noise', low=0.0, high=1.0, live=True
    )
    latency: float = parameter(
        0.0, 'float', 's', 'age of a measurement at delivery', low=0.0, high=0.5, whole_ns=True,
        live=True,
    )  # fmt: skip


class StrainProbe(Sensor):
    """Strain of each link, in proportion to its end deflection."""

    NAME = 'strain_probe'
    Parameters = Probe

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the strain of both links."""
        return (Signal(TOPIC, Joints(LINKS, ('position',))),)

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the strain as delivered."""
        return Column('strain1', TOPIC, 0, 'm/m'), Column('strain2', TOPIC, 1, 'm/m')

    def sample(self, k: int, state: State) -> Sequence[float]:
        """Return the end deflections, m."""
        return state.ends[:2]

    def read(self, values: Sequence[float]) -> Sequence[float]:
        """Return strain with noise."""
        gain, std = self.parameters.gain, self.parameters.noise_std
        noise = self.noise.pair() if std > 0.0 else (0.0, 0.0)
        return [gain * value + std * error for value, error in zip(values, noise, strict=True)]
