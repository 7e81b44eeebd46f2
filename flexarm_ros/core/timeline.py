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

"""Time as integer nanoseconds: ticks, stamps and exact conversion of seconds."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from fractions import Fraction

from flexarm_ros.core.parameters.sections import RunParameters

T0_NS = 1_000_000_000
"""Stamp of tick 0: one second, since a stamp of zero means "no time" in ROS."""

NS_PER_S = 1_000_000_000


def seconds_to_ns(seconds: float) -> int:
    """
    Return ``seconds`` as integer nanoseconds, exactly as in its decimal text.

    Raises ``ValueError`` if the text times 1e9 is not an integer, or if
    ``seconds`` is not finite: nothing is rounded.
    """
    scaled = Fraction(Decimal(repr(float(seconds)))) if _finite(seconds) else None
    if scaled is None or (scaled * NS_PER_S).denominator != 1:
        raise ValueError(f'{seconds!r} s is not a whole number of nanoseconds')
    return int(scaled * NS_PER_S)


def _finite(value: float) -> bool:
    return value - value == 0.0


@dataclass(frozen=True)
class Timeline:
    """The ticks of a run: tick k is at ``k * period_ns``, stamped ``T0_NS`` later."""

    period_ns: int
    ticks: int

    @classmethod
    def of(cls, run: RunParameters) -> Timeline:
        """
        Return the timeline of a run.

        Raises ``ValueError``, naming the key, if a time is not an integer number of
        nanoseconds or the duration not an integer number of ticks.
        """
        period = named_ns('control_period', run.control_period)
        duration = named_ns('duration', run.duration)
        if period < 1:
            raise ValueError(f'control_period: {run.control_period!r} s, must be 1 ns or more')
        if duration < period or duration % period:
            raise ValueError(
                f'duration: {run.duration!r} s is not a whole number of ticks of '
                f'{run.control_period!r} s (control_period)'
            )
        return cls(period, duration // period)

    @property
    def period(self) -> float:
        """Return the control period in seconds, for formulas only."""
        return self.period_ns / NS_PER_S

    @property
    def duration_ns(self) -> int:
        """Return the duration of the run in nanoseconds."""
        return self.period_ns * self.ticks

    def stamp_ns(self, k: int) -> int:
        """Return the stamp of tick ``k``."""
        return T0_NS + k * self.period_ns


def ticks_between(key: str, rate: float, period_ns: int) -> int:
    """
    Return the integer number of ticks between messages at ``rate`` Hz; 1 for 0.

    Raises ``ValueError``, naming ``key``, if it is not an integer, in exact arithmetic.
    """
    if rate == 0.0:
        return 1
    ticks = NS_PER_S / (Fraction(Decimal(repr(rate))) * period_ns)
    if ticks.denominator != 1:
        control = float(Fraction(NS_PER_S, period_ns))
        raise ValueError(
            f'{key}: {rate!r} Hz, allowed: 0 or the control rate of {control:g} Hz '
            'divided by a whole number'
        )
    return ticks.numerator


def clock_ticks(run: RunParameters) -> int:
    """Return the ticks between messages on ``/clock``; ``ValueError`` as `ticks_between`."""
    period_ns = named_ns('control_period', run.control_period)
    return ticks_between('clock_rate', run.clock_rate or 0.0, period_ns)


def named_ns(key: str, seconds: float) -> int:
    """Return ``seconds`` in nanoseconds; the ``ValueError`` names ``key``."""
    try:
        return seconds_to_ns(seconds)
    except ValueError as error:
        raise ValueError(f'{key}: {error}') from None
