"""Where the material points of a link are in the full model, for the kinematics."""

from __future__ import annotations

from flexarm_ros.core.compiled import FloatArray
from flexarm_ros.core.parameters import PlantParameters
from flexarm_ros.core.plant_full_model import link_bases


def link_shapes(
    plant: PlantParameters, link: int, distance: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return what moves the point ``distance`` m from the start of ``link`` (0 or 1).

    Three arrays: the shape functions (N,), their slopes (N,) in 1/m, and the
    matrix G (N, N) in 1/m of the axial foreshortening a^T G a / 2.
    """
    length = plant.length[link]
    basis = link_bases(plant)[link]
    xi = distance / length
    return (
        basis.shape(xi)[:, 0],
        basis.shape(xi, 1)[:, 0] / length,
        basis.shortening(xi) / length,
    )
