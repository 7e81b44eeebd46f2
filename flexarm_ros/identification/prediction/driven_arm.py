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

"""Predictions of the strains and the tip of an arm whose joints move as measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.sensing.gauge import BIAS, SLOPE
from flexarm_ros.identification.model.arm_model import (
    ArmModel,
    check_model,
    gauge_noise,
    make_model,
    observer_gain,
)
from flexarm_ros.identification.model.driven_motion import driven
from flexarm_ros.identification.recording import moved, Recording
from flexarm_ros.identification.setting import Setting
from flexarm_ros.scenario.errors import ScenarioError
import numpy as np
from numpy.typing import NDArray

BoolArray = NDArray[np.bool_]
NOISE_TIME = 1.0
"""Time from which the noise of a gauge is estimated, s."""

TIP = ('tip_x', 'tip_y')
"""Channels of the elastic tip in ``base``, m, without delay."""

_NO_ROWS = np.zeros((0, 0))


class Motion(NamedTuple):
    """
    A predicted motion of n samples, and the model, with the offsets that were used.

    ``outputs``: strains (n, 2), or more columns; ``angles`` (n, 2): joint angles without the
    encoders' offsets, rad; ``elastic`` (n, 2N): elastic coordinates of both links.
    """

    outputs: FloatArray
    angles: FloatArray
    elastic: FloatArray
    model: ArmModel


@dataclass(frozen=True, eq=False)
class DrivenData:
    """
    The data of a recording for a driven prediction; see `prepare_driven`.

    ``has``: whether each gauge was recorded; ``noises``: the standard deviation of its noise,
    from its first `NOISE_TIME` s.
    """

    recording: Recording
    names: tuple[str, ...]
    kinds: tuple[str, str]
    raw_angles: FloatArray
    measured: FloatArray
    valid: BoolArray
    on: NDArray[np.int64]

    has: tuple[bool, bool]
    noises: tuple[float, float]


def prepare_driven(recording: Recording, setting: Setting) -> DrivenData:
    """
    Return the joint angles and strains of a recording; strains moved by the gauges' latency.

    Raises ScenarioError if joint angles are missing, or strains and tip.
    """
    check_model(setting)
    names = tuple(name for name in ('strain1', 'strain2') if name in recording.channels)
    if not names and not any(name in recording.channels for name in TIP):
        raise ScenarioError(
            f'{recording.name}: no channel strain1, strain2, {" or ".join(TIP)} to predict'
        )
    angles = recording.pair('theta{}')
    raw = recording
    recording = moved(raw, dict.fromkeys(names, setting.gauge.latency))
    measured = np.zeros_like(angles)
    valid = np.zeros(angles.shape, dtype=bool)
    on = np.zeros(2, dtype=np.int64)
    kinds = ['angle', 'angle']
    noises = [0.0, 0.0]
    first_second = round(NOISE_TIME / recording.period)
    for link, name in ((0, 'strain1'), (1, 'strain2')):
        if name in names:
            measured[:, link] = recording.channels[name]
            on[link] = max(recording.held_until(name) - 1, 0)
            first = raw.held_until(name)  # whatever the latency: a fit compares the same samples
            valid[first:, link] = True
            kinds[link] = recording.strain_units[name]
            noises[link] = gauge_noise(measured[first : first + first_second, link])
    return DrivenData(
        recording, names, (kinds[0], kinds[1]), angles, measured, valid, on,
        ('strain1' in names, 'strain2' in names), (noises[0], noises[1]),
    )  # fmt: skip


def true_angles(data: DrivenData, setting: Setting) -> FloatArray:
    """Return the joint angles without the encoders' offsets, (n, 2), rad."""
    return np.ascontiguousarray(data.raw_angles - np.array(setting.config.encoder.offset))


def rest_state(data: DrivenData, model: ArmModel, angles: FloatArray) -> FloatArray:
    """
    Return the state of an arm at rest at the first sample, (4N + 4,).

    Each low-pass is in equilibrium with its gauge's signal, as in a simulation, or with the
    constant that the program gave at first (see `Recording.held_until`).
    """
    state = np.zeros(model.size)
    for link in (0, 1):
        signal = model.gauges[link, BIAS] + model.gauges[link, SLOPE] * angles[0, link]
        held = data.on[link] > 0
        state[2 * model.coordinates + 2 * link] = data.measured[0, link] if held else signal
    return state


def driven_states(
    data: DrivenData, model: ArmModel, angles: FloatArray, gain: FloatArray | None = None
) -> FloatArray:
    """
    Return the state at each sample, (n, 4N + 4), by the observer: from the past alone.

    ``gain``: that of the observer, if it is known.
    """
    outputs = np.zeros((len(angles), 2))
    rest = rest_state(data, model, angles)
    if gain is None:
        # The level of the signals is the model's, so that no later sample of a gauge matters.
        none = np.zeros((model.size, 0))
        _drive(data, model, angles, 0, len(angles), rest, none, outputs, _NO_ROWS)
        levels = np.std(outputs, axis=0) * data.has
        elbow = float(np.median(angles[:, 1]))
        gain = observer_gain(model, elbow, (levels[0], levels[1]), data.noises)
    states = np.zeros((len(angles), model.size))
    _drive(data, model, angles, 0, len(angles), rest, gain, outputs, states)
    return states


def _drive(
    data: DrivenData, model: ArmModel, angles: FloatArray, first: int, last: int,
    start: FloatArray, gain: FloatArray, outputs: FloatArray, states: FloatArray,
) -> None:  # fmt: skip
    driven(
        model.terms, model.shapes, model.gauges, model.lowpass, angles, model.period,
        model.substeps, data.on, first, last, start, gain, data.measured, outputs, states,
    )  # fmt: skip


def zeroed(data: DrivenData, model: ArmModel, angles: FloatArray, zero: float) -> ArmModel:
    """
    Return the model with the gauges' constants taken from the first ``zero`` s.

    A gauge whose program gave a constant at first (see `Recording.held_until`) had its mean over
    that time, or ``zero`` s of it, subtracted: the model's mean, unfiltered, becomes that value.
    Otherwise the mean of measured less predicted becomes 0.
    """
    count = max(1, min(round(zero / model.period), len(angles)))
    plain = model.with_bias(np.zeros(2))
    outputs, states = np.zeros((len(angles), 2)), np.zeros((len(angles), model.size))
    none = np.zeros((model.size, 0))
    rest = rest_state(data, plain, angles)
    _drive(data, plain, angles, 0, count, rest, none, outputs, states)
    bias = np.zeros(2)
    for link in (0, 1):
        held = int(min(data.on[link] + 1, count)) if data.on[link] > 0 else 0
        if held:
            part = slice(link * model.coordinates // 2, (link + 1) * model.coordinates // 2)
            signal = states[:held, part] @ plain.shapes[link]
            signal = signal + plain.gauges[link, SLOPE] * angles[:held, link]
            bias[link] = data.measured[0, link] - float(np.mean(signal))
        else:
            bias[link] = float(np.mean(data.measured[:count, link] - outputs[:count, link]))
    return model.with_bias(bias)


def predict_driven(
    data: DrivenData,
    setting: Setting,
    window: float | None,
    zero: float | None,
    gain: FloatArray | None = None,
) -> Motion:
    """Return the predicted motion; its outputs are the strains."""
    model = make_model(setting, data.recording.period, data.kinds)
    angles = true_angles(data, setting)
    if zero is not None:
        model = zeroed(data, model, angles, zero)
    outputs, states = np.zeros((len(angles), 2)), np.zeros((len(angles), model.size))
    none = np.zeros((model.size, 0))
    if window is None:
        starts, length = rest_state(data, model, angles)[None], len(angles)
    else:
        length = max(1, round(window / model.period))
        starts = driven_states(data, model, angles, gain)[::length]
    for number, start in enumerate(starts):
        first = number * length
        last = min(first + length, len(angles))
        _drive(data, model, angles, first, last, start, none, outputs, states)
    return Motion(outputs, angles, states[:, : model.coordinates], model)
