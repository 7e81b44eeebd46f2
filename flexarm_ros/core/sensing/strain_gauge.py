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


"""The strain gauges of both links, as a part of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from flexarm_ros.core.parameters.rig import StrainGaugeParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import Column
from flexarm_ros.core.sensing.sensor import Sensor
from flexarm_ros.core.signals import Joints, LINKS, Signal
from flexarm_ros.core.timeline import Timeline

STRAIN = 'strain_gauge/strain'


def closes_the_loop(config: RunConfig) -> bool:
    """Return whether the controller's deflections are those of the strain gauges."""
    gauge = StrainGaugePart.NAME
    return config.controller.deflection_source == gauge and config.section(gauge) is not None


def deflection_scales(config: RunConfig) -> tuple[float, float] | None:
    """
    Return the end deflections, m, that readings of 1 stand for in the controller.

    None if its deflections are the plant's.
    """
    if not closes_the_loop(config):
        return None
    gauge: StrainGaugeParameters = config.section(StrainGaugePart.NAME)
    first, second = (
        gauge.deflection_per_reading(link, length)
        for link, length in enumerate(config.plant.length)
    )
    return first, second


class StrainGaugePart(Sensor):
    """A strain gauge on each link: curvature, gain, offset, low-pass, noise."""

    NAME = 'strain_gauge'
    Parameters = StrainGaugeParameters
    SHARED = ('location', 'output', 'gain')

    @classmethod
    def signals(cls, config: RunConfig) -> tuple[Signal, ...]:
        """Return the readings of both gauges, in the unit of ``strain_gauge.output``."""
        return (Signal(STRAIN, Joints(LINKS, ('position',))),)

    @classmethod
    def columns(cls, config: RunConfig) -> tuple[Column, ...]:
        """Return the readings as delivered."""
        held = config.section(cls.NAME) or StrainGaugeParameters()
        return tuple(Column(f'strain{i + 1}', STRAIN, i, held.unit(i)) for i in (0, 1))

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for a gauge that is not on its link, or at its end."""
        super().check(config)
        gauge: StrainGaugeParameters = config.section(cls.NAME)
        # At the end of a link an end force leaves no curvature.
        end_allowed = gauge.output == 'strain' and not closes_the_loop(config)
        for link, place in enumerate(gauge.location):
            length = config.plant.length[link]
            if place > length or (place == length and not end_allowed):
                below = 'at most' if end_allowed else 'below'
                raise ValueError(
                    f'strain_gauge.location: {place!r} m on {LINKS[link]}, allowed with output '
                    f'{gauge.output}: from 0, {below} {length!r} m (plant.length)'
                )
            if gauge.gain[link] == 0.0 and closes_the_loop(config):
                raise ValueError(
                    f'strain_gauge.gain: 0.0 of {LINKS[link]}, allowed with '
                    'controller.deflection_source strain_gauge: other than 0'
                )

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.gauge import gauge_tables, gauge_tick
        import numpy as np

        super().__init__(config)
        held: StrainGaugeParameters = self.parameters
        self._tick, self._memory = gauge_tick, np.zeros((2, 3))
        period = Timeline.of(config.run).period
        self._tables = gauge_tables(config.plant, held, period, (held.output, held.output))

    def sample(self, k: int, *inputs: Any) -> Sequence[float]:
        """Return the signals of tick ``k`` behind the low-pass."""
        (state,) = inputs
        found: tuple[float, float] = self._tick(*self._tables, state.q, self._memory, k == 0)
        return found

    def read(self, values: Sequence[float]) -> Sequence[float]:
        """Return the signals with noise."""
        std = self.parameters.noise_std
        if std == 0.0:
            return values
        return [v + std * n for v, n in zip(values, self.noise.pair(), strict=True)]
