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

"""The compiled model of a scenario's arm and sensor chain, and its observer."""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

from flexarm_ros.core.arm.driven.terms import FullTerms, make_terms
from flexarm_ros.core.arm.full.model import link_bases
from flexarm_ros.core.arm.full.plant import ACCURATE_PHASE, mass_matrix
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
from flexarm_ros.core.sensing.gauge import BIAS, gauge_tables
from flexarm_ros.identification.setting import Setting
from flexarm_ros.scenario.errors import ScenarioError
import numpy as np
from scipy.linalg import eigh, expm, solve_discrete_are

MODEL_ERROR = 0.03
"""
Error of the model that the observer assumes, 1/sqrt(Hz).

It is the noise of the moment at the root of each link, as a signal of its gauge, over the standard
deviation of that signal.  On the recordings of a real arm, predictions differ by less than
0.5 points of fit between a third and three times this value.
"""

LEAST_NOISE = 3e-4
"""Least noise of a gauge that the observer assumes, per standard deviation of its signal."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """
    Constants of one arm and its gauges for recordings with one sample period.

    ``shapes`` (2, N): each gauge's signal per elastic coordinate of its link, gain included.
    ``gauges`` (2, 3) and ``lowpass`` (2, 2, 4): see `flexarm_ros.core.sensing.gauge`.
    """

    plant: PlantParameters
    terms: FullTerms
    shapes: FloatArray
    gauges: FloatArray
    lowpass: FloatArray
    cutoff: tuple[float, float]
    damping: tuple[float, float]
    period: float
    substeps: int

    @property
    def coordinates(self) -> int:
        """Return the number of elastic coordinates of both links."""
        return 2 * int(self.shapes.shape[1])

    @property
    def size(self) -> int:
        """Return the length of a state."""
        return 2 * self.coordinates + 4

    def with_bias(self, bias: FloatArray) -> ArmModel:
        """Return the model with other constants of the gauges, (2,)."""
        gauges = self.gauges.copy()
        gauges[:, BIAS] = bias
        return replace(self, gauges=gauges)


def check_model(setting: Setting) -> None:
    """Raise ScenarioError where the arm of a scenario cannot be compared with recordings."""
    if setting.config.plant.model != 'full':
        raise ScenarioError(f'plant.model: {setting.config.plant.model} is not allowed here: full')


def make_model(setting: Setting, period: float, kinds: tuple[str, str]) -> ArmModel:
    """
    Return the model of a scenario for samples every ``period`` s.

    ``kinds``: what the gauge of each link gives: ``angle``, ``deflection``, ``strain`` or ``end``
    (the true end deflection of the link, m, without gain, offset and low-pass).
    """
    plant, gauge = setting.config.plant, setting.gauge
    terms = make_terms(plant, plant.payload_mass)
    assert isinstance(terms, FullTerms)
    first, second = ('strain' if kind == 'end' else kind for kind in kinds)
    shapes, gauges, lowpass = gauge_tables(plant, gauge, period, (first, second))
    cutoff = list(gauge.filter_cutoff)
    for link in (0, 1):
        if kinds[link] == 'end':
            shapes[link] = link_bases(plant)[link].shape(1.0)[:, 0]
            gauges[link] = lowpass[link] = cutoff[link] = 0.0
    return ArmModel(
        plant, terms, shapes, gauges, lowpass, (cutoff[0], cutoff[1]), gauge.filter_damping,
        period, _substeps(plant, terms, period),
    )  # fmt: skip


def _elastic(plant: PlantParameters, elbow: float) -> FloatArray:
    q = np.zeros(2 + 2 * plant.modes)
    q[1] = elbow
    return mass_matrix(plant, q)[2:, 2:]


def _substeps(plant: PlantParameters, terms: FullTerms, period: float) -> int:
    """Return the integration steps a sample, from the highest frequency with held joints."""
    stiffness = np.diag(terms.diagonals[0, 2:])
    highest = 0.0
    for elbow in (0.0, 0.5 * math.pi, math.pi):
        squares = eigh(stiffness, _elastic(plant, elbow), eigvals_only=True)
        highest = max(highest, math.sqrt(max(float(squares[-1]), 0.0)))
    return max(1, math.ceil(highest * period / ACCURATE_PHASE))


def gauge_noise(signal: FloatArray) -> float:
    """Return the std of white noise on a smooth signal, (n,), from its third differences."""
    return float(np.std(np.diff(signal, 3)) / math.sqrt(20.0)) if len(signal) > 3 else 0.0


def observer_gain(
    model: ArmModel, elbow: float, levels: tuple[float, float], noises: tuple[float, float]
) -> FloatArray:
    """
    Return the gain of the steady Kalman filter about rest at an elbow angle, (4N + 4, 2).

    It corrects a state by the gauges' errors, sample by sample, from the past alone.  ``levels``
    are the standard deviations of the gauges' signals, ``noises`` those of their noise; a gauge
    with level 0 gets no weight.
    """
    size, total = model.coordinates, model.size
    inverse = np.linalg.inv(_elastic(model.plant, elbow))
    stiffness, damping = model.terms.diagonals[:, 2:]
    system = np.zeros((total, total))
    system[:size, size : 2 * size] = np.eye(size)
    system[size : 2 * size, :size] = -inverse * stiffness
    system[size : 2 * size, size : 2 * size] = -inverse * damping
    output = np.zeros((2, total))
    force = np.zeros((total, 2))
    for link in (0, 1):
        part = slice(link * size // 2, (link + 1) * size // 2)
        signal = model.shapes[link]
        row = 2 * size + 2 * link
        if model.cutoff[link] > 0.0:
            omega = 2.0 * math.pi * model.cutoff[link]
            system[row, row + 1] = 1.0
            system[row + 1, row] = -omega * omega
            system[row + 1, row + 1] = -2.0 * model.damping[link] * omega
            system[row + 1, part] = omega * omega * signal
            output[link, row] = 1.0
        else:
            # The state of the low-pass is not used: any stable one keeps the filter solvable.
            system[row, row] = system[row + 1, row + 1] = -1.0 / model.period
            output[link, part] = signal
        # A moment that bends the link by one unit of its gauge.
        scale = float(signal @ (signal / stiffness[part])) or 1.0
        force[size : 2 * size, link] = inverse[:, part] @ (signal / scale)
    step = expm(system * model.period)
    push = MODEL_ERROR * np.array(levels)
    noise = model.period * (force * push**2) @ force.T + 1e-12 * max(push) ** 2 * np.eye(total)
    used = [link for link in (0, 1) if levels[link] > 0.0]
    gain = np.zeros((total, 2))
    if not used:
        return gain
    seen = output[used]
    least = [max(noises[link], LEAST_NOISE * levels[link]) for link in used]
    scatter = np.diag(np.square(least))
    covariance = solve_discrete_are(step.T, seen.T, noise, scatter)
    innovation = seen @ covariance @ seen.T + scatter
    gain[:, used] = np.linalg.solve(innovation, seen @ covariance).T
    return gain
