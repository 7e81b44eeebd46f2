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

"""Predictions of a recording by a scenario, and how well they fit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
import math

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.sensing.gauge import BIAS
from flexarm_ros.identification.model.tip import tip_path
from flexarm_ros.identification.prediction.driven_arm import (
    BoolArray,
    predict_driven,
    prepare_driven,
    TIP,
)
from flexarm_ros.identification.prediction.modes import MODES
from flexarm_ros.identification.prediction.ringing import Mode, quiet_spans, ringing
from flexarm_ros.identification.prediction.whole_arm import (
    ANGLE,
    centred_rates,
    past_rates,
    predict_torque,
    RATE,
    rate_half_width,
)
from flexarm_ros.identification.recording import Recording
from flexarm_ros.identification.setting import Setting
from flexarm_ros.scenario.errors import ScenarioError
import numpy as np

STARTS_MOVING = 0.2
"""A recording whose first rate in a channel is this part of the largest begins in motion."""


@dataclass(frozen=True, eq=False)
class Channel:
    """
    One channel, measured and predicted, (n,), SI units; ``valid`` marks what is compared.

    A number is None where nothing is compared, or the measured channel is constant.
    """

    measured: FloatArray
    predicted: FloatArray
    valid: BoolArray

    @property
    def residual(self) -> FloatArray:
        """Return measured less predicted where they are compared."""
        return np.asarray((self.measured - self.predicted)[self.valid])

    @property
    def _deviation(self) -> FloatArray:
        values = self.measured[self.valid]
        return np.asarray(values - values.mean())

    @property
    def fit(self) -> float | None:
        """Return 100 (1 - |y - yhat| / |y - mean y|), percent."""
        return self._percent(1)

    @property
    def vaf(self) -> float | None:
        """Return the variance accounted for, 100 (1 - var(y - yhat) / var(y)), percent."""
        if not self._compared:
            return None
        return float(100.0 * (1.0 - np.var(self.residual) / np.var(self.measured[self.valid])))

    @property
    def rms(self) -> float | None:
        """Return the root mean square of the residual."""
        return float(math.sqrt(np.mean(self.residual**2))) if self.valid.any() else None

    @property
    def _compared(self) -> bool:
        return bool(self.valid.any()) and bool(np.any(self._deviation))

    def _percent(self, power: int) -> float | None:
        if not self._compared:
            return None
        ratio = np.linalg.norm(self.residual) / np.linalg.norm(self._deviation)
        return float(100.0 * (1.0 - ratio**power))

    def numbers(self) -> dict[str, float | None]:
        """Return ``fit``, ``vaf`` and ``rms``."""
        return {'fit': self.fit, 'vaf': self.vaf, 'rms': self.rms}


@dataclass(frozen=True, eq=False)
class Prediction:
    """
    A recording as a scenario predicts it.

    ``window``: length of the windows that were predicted each from its start, s; None: the
    complete recording. ``offsets``: gauge offsets that were taken from the recording, in the unit
    of each channel.
    ``notes``: a line for each reason to doubt the start states or the offsets.
    """

    recording: Recording
    mode: str
    window: float | None
    channels: Mapping[str, Channel]
    offsets: Mapping[str, float]
    notes: tuple[str, ...] = ()

    @property
    def manner(self) -> str:
        """Return the mode and the length of the windows as text."""
        length = 'all data' if self.window is None else f'windows of {self.window:g} s'
        return f'{self.mode}, {length}'

    @property
    def numbers(self) -> dict[str, dict[str, float | None]]:
        """Return fit, vaf and rms of each channel."""
        return {name: channel.numbers() for name, channel in self.channels.items()}


def predict(
    recording: Recording,
    setting: Setting,
    mode: str = 'driven',
    window: float | None = None,
    zero: float | None = None,
) -> Prediction:
    """
    Predict a recording by a scenario.

    ``mode`` is one of `MODES`; ``window``: each window of this length, s, is predicted from the
    state at its start, which follows from the past alone; None: the complete recording from rest.
    ``zero``: the offsets of strain channels are taken from the first ``zero`` s.  Raises
    ScenarioError where the recording lacks a channel.
    """
    if window is not None and window < 2.0 * recording.period:
        raise ScenarioError(f'--window {window:g}: at least two samples, {2 * recording.period:g}')
    data = prepare_driven(recording, setting)
    if mode == 'driven':
        motion = predict_driven(data, setting, window, zero)
    else:
        motion = predict_torque(data, setting, window, zero, mode == 'closed_loop')
    outputs = motion.outputs
    channels = {
        name: Channel(data.measured[:, link], outputs[:, link], data.valid[:, link])
        for link, name in ((0, 'strain1'), (1, 'strain2'))
        if name in data.names
    }
    if mode != 'driven':
        length = len(outputs) if window is None else max(1, round(window / recording.period))
        channels.update(_joint_channels(recording, data.raw_angles, outputs, length))
    tip = [(axis, name) for axis, name in enumerate(TIP) if name in recording.channels]
    if tip:
        whole = np.ones(len(outputs), dtype=bool)
        path = tip_path(motion.model.plant, motion.angles, motion.elastic)
        channels.update(
            (name, Channel(recording.channels[name], path[:, axis], whole)) for axis, name in tip
        )
    offsets = {}
    if zero is not None:
        offsets = {
            name: float(motion.model.gauges[int(name[-1]) - 1, BIAS]) for name in data.names
        }
    notes = start_notes(recording) if window is None or zero is not None else ()
    return Prediction(data.recording, mode, window, channels, offsets, notes)


def start_notes(recording: Recording) -> tuple[str, ...]:
    """Return a line if a recording begins in motion."""
    moving = []
    for name in ('theta1', 'theta2', 'strain1', 'strain2'):
        values = recording.channels.get(name)
        if values is not None:
            rates = np.abs(past_rates(values[::-1, None], recording.period))[::-1]
            if rates[0] > STARTS_MOVING * rates.max():
                moving.append(name)
    if not moving:
        return ()
    return (
        f'the recording begins in motion ({", ".join(moving)}), but offsets by --zero and '
        'predictions of a whole recording take the arm to be at rest at the first sample',
    )


def ringing_of(
    recording: Recording, setting: Setting, zero: float | None = None
) -> tuple[list[Mode], list[Mode]]:
    """
    Return the modes that ring while the joints are at rest, measured and predicted.

    The complete recording is predicted, driven by the measured joint angles.  The modes are found
    from the strains, or from the tip where no strain was recorded.
    """
    found = predict(recording, setting, 'driven', None, zero)
    rates = centred_rates(recording.pair('theta{}'), recording.period)
    strains = [channel for name, channel in found.channels.items() if name not in TIP]
    channels = strains or list(found.channels.values())
    first = max(int(np.argmax(channel.valid)) for channel in channels)
    spans = quiet_spans(rates, recording.period, first)
    measured = [channel.measured for channel in channels]
    predicted = [channel.predicted for channel in channels]
    return (
        ringing(measured, spans, recording.period), ringing(predicted, spans, recording.period)
    )  # fmt: skip


def _joint_channels(
    recording: Recording, angles: FloatArray, outputs: FloatArray, length: int
) -> dict[str, Channel]:
    """
    Return the joint angles and rates; measured rates that were not recorded are derived.

    Derived rates are compared with rates that are derived alike from the predicted angles: else
    inertias would be found too large, as they slow the motion down.  ``length``: of a window, in
    samples, at whose ends no derived rates are compared.
    """
    rows = len(angles)
    whole = np.ones(rows, dtype=bool)
    predicted = outputs[:, ANGLE : ANGLE + 2]
    measured_rates = centred_rates(angles, recording.period)
    parts = [predicted[first : first + length] for first in range(0, rows, length)]
    rates = np.concatenate([centred_rates(part, recording.period) for part in parts])
    half = rate_half_width(recording.period)
    inside = np.concatenate([_inside(len(part), half) for part in parts])
    found = {}
    for i in (0, 1):
        found[f'theta{i + 1}'] = Channel(angles[:, i], predicted[:, i], whole)
    for i in (0, 1):
        name = f'theta{i + 1}_rate'
        measured = recording.channels.get(name)
        if measured is None:
            found[name] = Channel(measured_rates[:, i], rates[:, i], inside)
        else:
            found[name] = Channel(measured, outputs[:, RATE + i], whole)
    return found


def _inside(count: int, half: int) -> BoolArray:
    """Return which of ``count`` samples are at least ``half`` samples from both ends."""
    places = np.arange(count)
    return np.asarray(np.minimum(places, count - 1 - places) >= half)


__all__ = ['Channel', 'MODES', 'Prediction', 'predict', 'ringing_of']
