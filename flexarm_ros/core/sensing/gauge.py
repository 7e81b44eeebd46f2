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
Strain gauges: from the curvature of a link to the signal, for both plants and for recordings.

A gauge of ``gain`` g at the place x of a link shows, before its low-pass,
g w''(x) scale + offset + offset_slope theta, theta the joint angle of the link.  The scale is 1
for ``strain``; a link of length L bent by an end force has w''(x) = 3 deflection (L - x) / L^3,
which gives ``deflection``, and ``angle`` = deflection / L.
"""

from __future__ import annotations

from flexarm_ros.core.arm.beam import ClampedFreeModes
from flexarm_ros.core.numerics.compiled import compiled, FloatArray, internal
from flexarm_ros.core.parameters.rig import StrainGaugeParameters
from flexarm_ros.core.parameters.sections import PlantParameters
from flexarm_ros.core.sensing.lowpass import follow, lowpass_step
import numpy as np

# Columns of ``gauges`` (2, 3): constant, per angle of the joint, 1 if it has a low-pass.
BIAS, SLOPE, FILTERED = range(3)


def gauge_shape(
    plant: PlantParameters, gauge: StrainGaugeParameters, link: int, output: str
) -> FloatArray:
    """Return the signal of a gauge per elastic coordinate of ``link``, (N,), for gain 1."""
    length = plant.length[link]
    curvature = _curvature(plant, link, gauge.location[link])
    if output == 'strain':
        return curvature
    deflection = curvature * gauge.deflection_per_curvature(link, length)
    return deflection / length if output == 'angle' else deflection


def _curvature(plant: PlantParameters, link: int, place: float) -> FloatArray:
    length = plant.length[link]
    if plant.model == 'full':
        from flexarm_ros.core.arm.full.model import link_bases

        shape = link_bases(plant)[link].shape(place / length, 2)[:, 0]
        return np.asarray(shape / (length * length))
    rho, rigidity = plant.mass_density[link], plant.flexural_rigidity[link]
    return ClampedFreeModes(length, rho, rigidity, plant.modes).curvature(place)


def gauge_tables(
    plant: PlantParameters, gauge: StrainGaugeParameters, period: float, outputs: tuple[str, str]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """
    Return ``shapes`` (2, N), ``gauges`` (2, 3) and ``lowpass`` (2, 2, 4) for compiled code.

    ``shapes``: signal per elastic coordinate, gain included; ``gauges``: columns `BIAS`, `SLOPE`,
    `FILTERED`; ``lowpass``: `lowpass_step` over ``period`` s.  ``outputs``: that of each gauge.
    """
    shapes = np.zeros((2, plant.modes))
    gauges, lowpass = np.zeros((2, 3)), np.zeros((2, 2, 4))
    for link in (0, 1):
        shapes[link] = gauge.gain[link] * gauge_shape(plant, gauge, link, outputs[link])
        gauges[link, BIAS] = gauge.offset[link]
        gauges[link, SLOPE] = gauge.offset_slope[link]
        if gauge.filter_cutoff[link] > 0.0:
            gauges[link, FILTERED] = 1.0
            lowpass[link] = lowpass_step(
                gauge.filter_cutoff[link], gauge.filter_damping[link], period
            )
    return shapes, gauges, lowpass


@internal
def gauge_input(
    link: int, shapes: FloatArray, gauges: FloatArray, angles: FloatArray, elastic: FloatArray
) -> float:
    """Return a gauge's signal before its low-pass: ``shapes`` (2, N) times the coordinates."""
    n = shapes.shape[1]
    value: float = gauges[link, BIAS] + gauges[link, SLOPE] * angles[link]
    for i in range(n):
        value += shapes[link, i] * elastic[link * n + i]
    return value


@compiled
def gauge_tick(
    shapes: FloatArray,
    gauges: FloatArray,
    lowpass: FloatArray,
    q: FloatArray,
    memory: FloatArray,
    first: bool,
) -> tuple[float, float]:
    """
    Return the signals of both gauges for the plant's coordinates ``q`` (2 + 2N,) of a tick.

    ``memory`` (2, 3): of each gauge value and rate of the low-pass, and its last input; at the
    ``first`` tick the low-pass is in equilibrium.
    """
    for link in range(2):
        signal = gauge_input(link, shapes, gauges, q, q[2:])
        if first or gauges[link, FILTERED] == 0.0:
            memory[link, 0], memory[link, 1] = signal, 0.0
        else:
            follow(lowpass[link], memory[link], memory[link, 2], signal)
        memory[link, 2] = signal
    return memory[0, 0], memory[1, 0]
