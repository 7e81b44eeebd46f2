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
Timing of a free-running run (``sync: free``): what is counted, and how.

All times are wall times, in seconds of a monotonic clock.  Terms, for tick k of period T at the
speed X (`/**.real_time_factor`):

- *jitter*: time from the deadline of tick k, absolute, to its begin;
- *late tick*: a jitter of T / X or more: the next tick was due already;
- *missed command*: the command that answers tick k had not arrived when tick k ended;
- *held command*: no new command at all arrived for tick k, and the last one is held;
- *command latency*: time from the begin of tick k to the arrival of the first command that
  answers it or a later tick.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
import math
from typing import Any

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
import numpy as np
from numpy.typing import NDArray

COUNTS = ('late_ticks', 'missed_commands', 'held_commands')
SPREADS = ('command_latency_ms', 'tick_jitter_ms')
KEYS = ('factor', *COUNTS, *SPREADS)
"""Keys of ``real_time`` in ``summary.json``."""

NO_COMMAND = -1.0
"""Arrival of the command of a tick that has none."""


def outlives_controller(config: RunConfig) -> bool:
    """Whether the run continues, with zero torque, after the controller has ended."""
    return config.run.sync == 'free' and config.plant.command_loss == 'zero'


class RunTiming:
    """
    The timing of a run's first ``n`` ticks.

    ``begin``, ``due``, ``arrival``: shape ``(n,)``, s: when each tick began and when it was due,
    and when the command that was held over it arrived (`NO_COMMAND`: there was none).
    ``answers``, shape ``(n,)``: the tick that this command answers, below 0 for none.
    ``control_period``: simulated time per tick, s.
    """

    def __init__(
        self, begin: FloatArray, due: FloatArray, arrival: FloatArray, answers: FloatArray,
        control_period: float,
    ) -> None:  # fmt: skip
        self.begin, self.due, self.arrival, self.answers = begin, due, arrival, answers
        self._simulated = control_period
        self.period = float(np.median(np.diff(due))) if len(due) > 1 else control_period
        """Wall time per tick, s, at the requested speed."""

    @property
    def jitter(self) -> FloatArray:
        """Return the jitter of each tick, s."""
        return self.begin - self.due

    @property
    def latency(self) -> FloatArray:
        """Return the command latency of each tick that was answered, s."""
        ticks = np.arange(len(self.begin))
        # `answers` never falls, but for ticks without a command.
        known = np.maximum.accumulate(self.answers) if len(ticks) else self.answers
        first = np.searchsorted(known, ticks)
        answered = first < len(ticks)
        return self.arrival[first[answered]] - self.begin[ticks[answered]]

    @property
    def held(self) -> NDArray[np.bool_]:
        """Return whether each tick had no new command."""
        without = self.answers < 0
        same = np.zeros(len(without), bool)
        same[1:] = (np.diff(self.answers) == 0) & (np.diff(self.arrival) == 0.0)
        return without | same

    def summary(self) -> dict[str, Any]:
        """Return ``real_time`` of ``summary.json``; None for what is not known."""
        count = len(self.begin)
        wall = float(self.begin[-1] - self.begin[0]) if count > 1 else 0.0
        return {
            'factor': (count - 1) * self._simulated / wall if wall > 0.0 else None,
            'late_ticks': int(np.sum(self.jitter >= self.period)),
            'missed_commands': int(np.sum(self.answers < np.arange(count))),
            'held_commands': int(np.sum(self.held)),
            'command_latency_ms': spread(self.latency),
            'tick_jitter_ms': spread(self.jitter),
        }


def spread(seconds: FloatArray) -> dict[str, float | None]:
    """Return median, 99th percentile and largest value in ms; None without a value."""
    if not len(seconds):
        return {'p50': None, 'p99': None, 'max': None}
    milli = 1e3 * seconds
    p50, p99 = np.percentile(milli, (50, 99)).tolist()
    return {'p50': p50, 'p99': p99, 'max': float(milli.max())}


_LEAST_S, _PER_DECADE, _DECADES = 1e-6, 20, 8


def bin_edges() -> FloatArray:
    """Return the edges of a histogram's bins, s: 20 per decade from 1 us to 100 s."""
    steps = np.arange(_PER_DECADE * _DECADES + 1)
    return _LEAST_S * 10.0 ** (steps / _PER_DECADE)


class LiveSpread:
    """Percentiles of a growing number of times, from a logarithmic histogram; for progress."""

    def __init__(self) -> None:
        self._counts = [0] * (_PER_DECADE * _DECADES)
        self._count, self.largest = 0, 0.0

    def add(self, seconds: float) -> None:
        """Count one time, s."""
        place = int(_PER_DECADE * math.log10(max(seconds, _LEAST_S) / _LEAST_S))
        self._counts[min(place, len(self._counts) - 1)] += 1
        self._count += 1
        self.largest = max(self.largest, seconds)

    def quantile(self, share: float) -> float | None:
        """Return the upper end of the bin (12 % wide) that holds this quantile, s; or None."""
        left = share * self._count
        for place, count in enumerate(self._counts):
            left -= count
            if count and left <= 0.0:
                upper = _LEAST_S * math.pow(10.0, (place + 1) / _PER_DECADE)
                return min(upper, self.largest)
        return None


_MOST_OPEN = 10_000
"""Largest number of unanswered ticks that are kept, in case the controller has ended."""


class LiveTiming:
    """Counts during a run; the exact ones are computed from its recording."""

    def __init__(self) -> None:
        self.late = self.missed = self.held = 0
        self.latency, self.jitter = LiveSpread(), LiveSpread()
        self._open: deque[tuple[int, float]] = deque(maxlen=_MOST_OPEN)
        """Ticks that no command has answered, with their begin, oldest first."""

    def begun(self, tick: int, begin: float, due: float, period: float) -> None:
        """Count the begin of a tick, s; ``period``: wall time per tick, s."""
        self.jitter.add(begin - due)
        self.late += begin - due >= period
        self._open.append((tick, begin))

    def answered(self, tick: int, arrival: float) -> None:
        """Count a command that answers ``tick``."""
        while self._open and self._open[0][0] <= tick:
            self.latency.add(arrival - self._open.popleft()[1])

    def ended(self, tick: int, answers: int, new: bool) -> None:
        """Count the end of a tick over which a command that ``answers`` that tick was held."""
        self.missed += answers < tick
        self.held += not new

    def values(self) -> dict[str, Any]:
        """Return the keys of ``real_time`` in ``summary.json`` without the factor."""
        return {
            **dict(zip(COUNTS, (self.late, self.missed, self.held), strict=True)),
            **dict(zip(SPREADS, map(_live, (self.latency, self.jitter)), strict=True)),
        }


def _live(times: LiveSpread) -> dict[str, float | None]:
    p50, p99 = (times.quantile(share) for share in (0.5, 0.99))
    milli = [None if t is None else 1e3 * t for t in (p50, p99)]
    return {'p50': milli[0], 'p99': milli[1], 'max': 1e3 * times.largest if p50 else None}


def shown(values: dict[str, Any], keys: Sequence[str] = KEYS) -> str:
    """Return the counts as one line of text."""
    parts = []
    for key in keys:
        value = values.get(key)
        name = key.removesuffix('_ms').replace('_', ' ')
        if isinstance(value, dict):
            if value.get('p99') is not None:
                numbers = '/'.join(f'{value[name]:.3g}' for name in ('p50', 'p99', 'max'))
                parts.append(f'{name} {numbers} ms')
        elif value is not None and key != 'factor':
            parts.append(f'{value} {name}')
    return ', '.join(parts)


def flat(values: dict[str, Any]) -> dict[str, str]:
    """Return each count as text, for diagnostics."""
    found = {}
    for key, value in values.items():
        name = key.removesuffix('_ms').replace('_', ' ')
        if isinstance(value, dict):
            for part, number in value.items():
                found[f'{name} {part} (ms)'] = '' if number is None else f'{number:.3f}'
        else:
            found[name] = str(value)
    return found
