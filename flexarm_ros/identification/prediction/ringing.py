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

"""Ringing of an arm whose joints hardly move: frequencies and damping from free decays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np

QUIET = 0.05
"""Joint rate, per its largest, below which a joint counts as at rest."""

LEAST_S = 0.8
"""Shortest quiet span that is used, s."""

SAMPLES = 100.0
"""Rate to which the channels are thinned out, Hz."""

PENCIL_S = 0.35
"""Length of the rows of the matrix of delayed samples, s."""


@dataclass(frozen=True)
class Mode:
    """A decaying oscillation: frequency, Hz, and damping ratio."""

    frequency: float
    damping: float


def quiet_spans(rates: FloatArray, period: float, from_sample: int = 0) -> list[slice]:
    """Return the spans in which both joints, rates (n, 2), are at rest, from a sample on."""
    smooth = max(1, round(0.05 / period))
    kernel = np.ones(smooth) / smooth
    level = np.stack([np.convolve(np.abs(column), kernel, 'same') for column in rates.T], axis=1)
    still = (level < QUIET * level.max(axis=0)).all(axis=1)
    still[:from_sample] = False
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still.astype(np.int8), [0]])))
    return [
        slice(int(first), int(last))
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if (last - first) * period >= LEAST_S
    ]


def ringing(
    channels: Sequence[FloatArray], spans: Sequence[slice], period: float, count: int = 2
) -> list[Mode]:
    """
    Return the ``count`` least damped modes in the spans of some channels, slowest first.

    ESPRIT (Roy and Kailath 1989): the poles of all spans and channels together, of least squares
    in the space of the strongest delayed samples; one more pair accounts for the remaining forced
    motion, a real pole for offsets and drifts.  None for channels that are not finite.
    """
    step = max(1, round(1.0 / (SAMPLES * period)))
    rows = max(2 * count + 6, round(PENCIL_S / (step * period)))
    blocks = []
    for span in spans:
        for channel in channels:
            values = channel[span][::step]
            if len(values) > rows + 2:
                windows = np.lib.stride_tricks.sliding_window_view(values - values.mean(), rows)
                scale = float(np.std(channel)) or 1.0
                blocks.append(windows.T / scale)
    if not blocks or not all(np.isfinite(block).all() for block in blocks):
        return []
    basis, _, _ = np.linalg.svd(np.concatenate(blocks, axis=1), full_matrices=False)
    order = 2 * count + 3
    kept = basis[:, :order]
    poles = np.linalg.eigvals(np.linalg.lstsq(kept[:-1], kept[1:], rcond=None)[0])
    rates = np.log(poles[poles.imag > 1e-6]) / (step * period)
    modes = [
        Mode(float(abs(rate)) / (2.0 * math.pi), float(-rate.real / abs(rate))) for rate in rates
    ]
    kept_modes = sorted(modes, key=lambda mode: mode.damping)[:count]
    return sorted(kept_modes, key=lambda mode: mode.frequency)
