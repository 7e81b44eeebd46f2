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

"""The end deflections as a law reads them: exact, or by strain gauges with their low-pass."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.sensing.gauge import FILTERED, gauge_tables, SLOPE
from flexarm_ros.core.sensing.strain_gauge import deflection_scales, StrainGaugePart
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.stability.modes import LinearArm
import numpy as np


@dataclass(frozen=True)
class DeflectionSensor:
    """
    Before the channel: f+ = a f + b x, deflections = c f + direct x, small motions about rest.

    x ``(2 n,)``: the arm's coordinates and rates; f ``(s,)``: of each gauge with a low-pass its
    value and rate, and its last input; deflections ``(2,)``, m.  ``measured``: by gauges.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    direct: FloatArray
    measured: bool

    @classmethod
    def of(cls, config: RunConfig, arm: LinearArm, used: bool) -> DeflectionSensor:
        """Return that of a scenario; ``used``: whether the law reads deflections."""
        size, scales = 2 * len(arm.mass), deflection_scales(config)
        direct = np.zeros((2, size))
        direct[:, : len(arm.mass)] = arm.deflection
        none = np.zeros((0, 0)), np.zeros((0, size)), np.zeros((2, 0))
        if scales is None or not used:
            return cls(*none, direct, False)
        gauge = config.section(StrainGaugePart.NAME)
        period = Timeline.of(config.run).period
        tables = gauge_tables(config.plant, gauge, period, (gauge.output, gauge.output))
        shapes, gauges, lowpass = tables
        direct[:] = 0.0
        modes = shapes.shape[1]
        filtered = [link for link in (0, 1) if gauges[link, FILTERED]]
        a, c = np.zeros((3 * len(filtered),) * 2), np.zeros((2, 3 * len(filtered)))
        b = np.zeros((len(a), size))
        for link, scale in enumerate(scales):
            direct[link, 2 + link * modes :][:modes] = scale * shapes[link]
            direct[link, link] = scale * gauges[link, SLOPE]
        for row, link in enumerate(filtered):
            step, place = lowpass[link], slice(3 * row, 3 * row + 3)
            a[place, place] = np.vstack([step[:, :3], np.zeros(3)])
            b[place] = np.outer([*step[:, 3], 1.0], direct[link])
            c[link, place] = step[0, :3]
            direct[link] *= step[0, 3]
        return cls(a, b, c, direct, True)
