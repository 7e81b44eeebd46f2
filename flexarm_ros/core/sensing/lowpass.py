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


"""Second-order low-pass, exact for an input that is linear between samples."""

from __future__ import annotations

from functools import lru_cache
import math

from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.numerics.elementary import exp, sincos
from flexarm_ros.core.sensing.delay import ramp_invariant
import numpy as np

_SERIES_BELOW = 0.01
"""Squared phase below which sin(x) / x is its series, whose error is then below 1e-17."""


@lru_cache(maxsize=64)
def lowpass_step(cutoff: float, damping: float, period: float) -> FloatArray:
    """
    Return the step of y'' = w^2 (u - y) - 2 damping w y' over ``period`` s, w = 2 pi cutoff.

    ``cutoff`` in Hz.  Shape (2, 4): y and y' after it from y, y', and the input u before and
    after it.
    """
    omega = 2.0 * math.pi * cutoff
    drag = damping * omega
    phase2 = (omega * period) * (omega * period) * (1.0 - damping * damping)
    if abs(phase2) < _SERIES_BELOW:
        fall = exp(-drag * period)
        half = phase2 * 0.25
        # The half angle: cos x = 1 - 2 sin^2 (x / 2), without cancellation.
        small = _sine_ratio(half)
        cosine = fall * (1.0 - 2.0 * half * small * small)
        sine = fall * period * _sine_ratio(phase2)
    elif phase2 > 0.0:
        fall, phase = exp(-drag * period), math.sqrt(phase2)
        sine, cosine = sincos(phase)
        cosine, sine = fall * cosine, fall * sine * period / phase
    else:
        phase = math.sqrt(-phase2)
        total = drag * period + phase
        # The slower of both decays, drag * period - phase, without cancellation.
        slow, fast = exp(-(omega * period) * (omega * period) / total), exp(-total)
        cosine, sine = 0.5 * (slow + fast), 0.5 * (slow - fast) * period / phase
    free = np.array(
        [
            [cosine + drag * sine, sine],
            [-(omega * omega) * sine, cosine - drag * sine],
        ]
    )
    # A ramp u = u0 + g t is followed by y = u - 2 damping g / w, y' = g.
    return ramp_invariant(free, np.array([-2.0 * damping / omega, 1.0]) / period)


def _sine_ratio(square: float) -> float:
    """Return sin(x) / x for a small x^2, of a negative one sinh(x) / x."""
    return 1.0 - square / 6.0 * (1.0 - square / 20.0 * (1.0 - square / 42.0))


@compiled
def follow(step: FloatArray, state: FloatArray, before: float, after: float) -> None:
    """Advance ``state`` (2,), y and y', by one sample; ``step``: see `lowpass_step`."""
    value, rate = state[0], state[1]
    for i in range(2):
        state[i] = step[i, 0] * value + step[i, 1] * rate + step[i, 2] * before
        state[i] += step[i, 3] * after
