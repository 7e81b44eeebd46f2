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

"""Positions of the material points of a link in the full model, for the kinematics."""

from __future__ import annotations

from flexarm_ros.core.arm.full.model import link_bases
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
import numpy as np


def link_shapes(
    plant: PlantParameters, link: int, distance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return the shape functions at ``distance`` m from the joint of ``link`` (0 or 1).

    Three arrays: the shape functions (N,), their slopes (N,) in 1/m, and the
    matrix G (N, N) in 1/m of the axial foreshortening a^T G a / 2.  A rigid part of the link
    continues its flexible one along the tangent.
    """
    length = plant.length[link]
    basis = link_bases(plant)[link]
    bent, beyond = plant.flexible_part(link, distance)
    xi = bent / length
    slope = basis.shape(xi, 1)[:, 0] / length
    return (
        basis.shape(xi)[:, 0] + beyond * slope,
        slope,
        basis.shortening(xi) / length + beyond * np.multiply.outer(slope, slope),
    )
