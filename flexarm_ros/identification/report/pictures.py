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

"""Pictures of predictions: measured and predicted, residuals and spectra."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from flexarm_ros.analysis.figures.style import BLACK, BLUE, drawing, GREY, new_figure, ORANGE, save
from flexarm_ros.identification.prediction.driven_arm import TIP
from flexarm_ros.identification.prediction.predict import Channel, Prediction
import numpy as np
from scipy.signal import welch

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_POINTS = 6000
DEGREES = 180.0 / np.pi


def write_pictures(predictions: list[tuple[str, Prediction]], out: Path) -> list[Path]:
    """Write a picture of each prediction, PNG and SVG, named by its first entry."""
    out.mkdir(parents=True, exist_ok=True)
    paths: list[Path] = []
    with drawing():
        for stem, prediction in predictions:
            paths += save(prediction_figure(prediction), out, stem)
    return paths


def prediction_figure(prediction: Prediction) -> Figure:
    """Return a row per channel: samples, residual, and the spectra of both."""
    count = len(prediction.channels)
    figure = new_figure(11.0, 1.0 + 2.0 * count)
    axes = figure.subplots(count, 2, squeeze=False, width_ratios=(3, 1))
    times, period = prediction.recording.times, prediction.recording.period
    thin = max(1, len(times) // MOST_POINTS)
    for (axis, spectra), (name, channel) in zip(axes, prediction.channels.items(), strict=True):
        scale, unit = _unit(prediction, name)
        shown = slice(int(np.argmax(channel.valid)), None, thin)
        t = times[shown]
        axis.plot(t, scale * channel.measured[shown], color=BLACK, lw=1.6, label='measured')
        axis.plot(t, scale * channel.predicted[shown], color=ORANGE, lw=1.0, label='predicted')
        residual = channel.measured - channel.predicted
        axis.plot(t, scale * residual[shown], color=GREY, lw=0.7, label='residual')
        axis.set_ylabel(f'{name}, {unit}')
        axis.set_title('' if channel.fit is None else f'fit {channel.fit:.1f} %', loc='right')
        _spectra(spectra, channel, period, scale)
        spectra.set_title(f'{unit}/$\\sqrt{{\\mathrm{{Hz}}}}$', loc='right')
    axes[0][0].legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=3)
    axes[-1][0].set_xlabel('t, s')
    axes[-1][1].set_xlabel('Hz')
    figure.suptitle(_title(prediction), fontsize=10.0)
    return figure


def _spectra(axis: object, channel: Channel, period: float, scale: float) -> None:
    from matplotlib.axes import Axes

    assert isinstance(axis, Axes)
    first = int(np.argmax(channel.valid))
    measured, predicted = channel.measured[first:], channel.predicted[first:]
    length = min(len(measured), round(8.0 / period))
    finite = bool(np.isfinite(predicted).all())  # False: the prediction diverges
    drawn = [
        (measured, BLACK, 1.6), (predicted, ORANGE, 1.0), (measured - predicted, GREY, 0.7),
    ]  # fmt: skip
    for values, color, width in drawn if finite else drawn[:1]:
        frequency, power = welch(values, 1.0 / period, nperseg=length, detrend='linear')
        shown = (frequency > 0.2) & (frequency < 15.0)
        density = scale * np.sqrt(power[shown]) + 1e-12
        axis.semilogy(frequency[shown], density, color=color, lw=width)
    axis.set_xlim(0.0, 15.0)
    axis.tick_params(labelcolor=BLUE if channel.fit is None else BLACK)


def _unit(prediction: Prediction, name: str) -> tuple[float, str]:
    """Return the factor from SI to what is drawn, and its unit."""
    kind = prediction.recording.strain_units.get(name, 'angle')
    if name in TIP:
        return 1.0, 'm'
    if name.startswith('strain') and kind != 'angle':
        return 1.0, '' if kind == 'strain' else 'm'
    return DEGREES, 'deg/s' if name.endswith('_rate') else 'deg'


def _title(prediction: Prediction) -> str:
    return f'{Path(prediction.recording.name).name}: {prediction.manner}'
