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

"""The two delay lines, ``buffer`` and ``pade2``, against their closed forms."""

from __future__ import annotations

import math

from flexarm_ros.core.sensing.delay import BufferDelay, PadeDelay
import numpy as np
from validation.motion import Array
from validation.pictures import BLUE, GREY, new_figure, ORANGE
from validation.report import Section

LATENCY = 0.0312
PERIOD = 1e-3
LIMIT = 1e-9
RESPONSE_LIMIT = 1e-4
"""Of the amplitude, at 10 kHz: signals are straight lines between ticks."""

Line = type[BufferDelay] | type[PadeDelay]


def through(line: Line, values: Array, period: float = PERIOD) -> Array:
    """Return what a delay line of 31.2 ms makes of a signal sampled once a tick."""
    delay = line(round(period * 1e9), round(LATENCY * 1e9))
    return np.array([delay.step(k, v, 0.0, 0.0, 0.0)[0] for k, v in enumerate(values.tolist())])


def pade_ramp(times: Array) -> Array:
    """
    Return the approximation's response to a ramp of slope 1 that starts at 0, closed form.

    The integral of its step response 1 - 4 sqrt(3) exp(-3 r) sin(sqrt(3) r), r = t / latency.
    """
    r, w = np.maximum(times, 0.0) / LATENCY, math.sqrt(3.0)
    fall = np.exp(-3.0 * r) * (3.0 * np.sin(w * r) + w * np.cos(w * r)) / 12.0
    return np.asarray(LATENCY * (r - 4.0 * w * (w / 12.0 - fall)))


def step_errors() -> dict[str, float]:
    """
    Return the largest error for a rise from 0 to 1 between two ticks.

    Between ticks a signal is linear, so that the step is a ramp that starts at
    0 minus one that starts a tick later.
    """
    times = PERIOD * np.arange(200)
    step = (times > 0.0).astype(float)
    pade = (pade_ramp(times) - pade_ramp(times - PERIOD)) / PERIOD
    pure = np.clip((times - LATENCY) / PERIOD, 0.0, 1.0)
    lines: dict[str, tuple[Line, Array]] = {
        'buffer': (BufferDelay, pure), 'pade2': (PadeDelay, pade)
    }  # fmt: skip
    return {
        name: float(np.abs(through(line, step) - exact).max())
        for name, (line, exact) in lines.items()
    }


def pade_transfer(omega: float) -> complex:
    """Return the approximation's closed form at j omega."""
    x = 1j * omega * LATENCY
    return complex((1.0 - x / 2.0 + x * x / 12.0) / (1.0 + x / 2.0 + x * x / 12.0))


def response(line: Line, omega: float, period: float = 1e-4) -> complex:
    """Return the measured answer to a sine after it has settled, as gain and phase."""
    times = period * np.arange(round(2.5 / period))
    steady = times > 1.0
    base = np.column_stack([np.sin(omega * times), np.cos(omega * times)])[steady]
    found = through(line, np.sin(omega * times), period)[steady]
    (real, imaginary), *_ = np.linalg.lstsq(base, found, rcond=None)
    return complex(real, imaginary)


def run() -> Section:
    """Compute the tables and the picture."""
    section = Section('Delay lines')
    errors = step_errors()
    worst = max(errors.values())
    section.goal(
        'Step response of `buffer` and `pade2` against the closed forms', f'{worst:.1e}',
        f'{LIMIT:g}', worst < LIMIT,
    )  # fmt: skip
    section.say(
        f'A sine through a delay of {1e3 * LATENCY:g} ms at 10 kHz: gain and phase (rad) as '
        "measured, error against each line's closed form, and how far `pade2` is from a true "
        'delay:'
    )
    rows, worst = [], 0.0
    for omega in (2.0, 10.0, 30.0, 60.0, 100.0, 150.0):
        pure, pade = response(BufferDelay, omega), response(PadeDelay, omega)
        exact = complex(np.exp(-1j * omega * LATENCY))
        apart = max(abs(pure - exact), abs(pade - pade_transfer(omega)))
        worst = max(worst, apart)
        away = float(np.angle(pade_transfer(omega) / exact))
        cells = (f'{abs(z):.6f}, {np.angle(z):.4f}' for z in (pure, pade))
        rows.append([f'{omega:g}', *cells, f'{apart:.1e}', f'{away:.4f}'])
    section.table(
        ['rad/s', '`buffer`', '`pade2`', 'largest error', 'phase of `pade2` ahead, rad'], rows
    )
    section.goal(
        'Frequency response of both against the closed forms, 2 to 150 rad/s', f'{worst:.1e}',
        f'{RESPONSE_LIMIT:g}', worst < RESPONSE_LIMIT,
    )  # fmt: skip
    times = PERIOD * np.arange(120)
    step = (times > 0.0).astype(float)
    figure, axis = new_figure('A step through both', (6.0, 3.0))
    for line, color, name in ((BufferDelay, BLUE, 'buffer'), (PadeDelay, ORANGE, 'pade2')):
        axis.plot(1e3 * times, through(line, step), color=color, label=name)
    axis.axvline(1e3 * LATENCY, color=GREY, linewidth=0.8, linestyle=':')
    axis.set_xlabel('time after the step, ms')
    axis.set_ylabel('output')
    axis.legend()
    section.picture('delays', figure, 'Step response of the two delay lines for 31.2 ms')
    return section
