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

"""The bent arm as a polyline, for drawing."""

from __future__ import annotations

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np


class ArmLine:
    """
    Evenly spaced points on both links, from the shoulder to the tip.

    ``per_link`` points per link besides its start; the elbow has index ``per_link``.
    """

    def __init__(self, plant: PlantParameters, per_link: int = 12) -> None:
        first, second = plant.spans
        steps = np.arange(1, per_link + 1) / per_link
        # The last point of each link is exactly the elbow or tip of `trajectory.csv`.
        along = [*(first * steps[:-1]), first, *(first + second * steps[:-1]), first + second]
        self.elbow = per_link
        self._points = [make_point(plant, float(at), elastic=True) for at in along]

    def at(self, q: FloatArray, qd: FloatArray) -> list[tuple[float, float]]:
        """Return x, y (m, ``base``) of each point, given the plant's coordinates ``(n,)``."""
        found = [(0.0, 0.0)]
        for point in self._points:
            x, y, _, _ = point(q, qd)
            found.append((x, y))
        return found
