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

"""The tip of the bent arm along a motion."""

from __future__ import annotations

from flexarm_ros.core.arm.kinematics import elastic_point, make_point
from flexarm_ros.core.numerics.compiled import allocating, FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np


def tip_path(plant: PlantParameters, angles: FloatArray, elastic: FloatArray) -> FloatArray:
    """
    Return x and y of the tip in ``base``, (n, 2), m.

    ``angles`` (n, 2): joint angles, rad; ``elastic`` (n, 2N): elastic coordinates of both links.
    """
    point = make_point(plant, plant.spans[0] + plant.spans[1], elastic=True)
    path = np.empty((len(angles), 2))
    _fill(point.shapes, point.shortening, np.hstack([angles, elastic]), path)
    return path


@allocating
def _fill(
    shapes: FloatArray, shortening: FloatArray, positions: FloatArray, path: FloatArray
) -> None:
    rest = np.zeros(positions.shape[1])
    for k in range(len(positions)):
        path[k, 0], path[k, 1], _, _ = elastic_point(positions[k], rest, shapes, shortening)
