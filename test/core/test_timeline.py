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

"""Time: exact nanoseconds, ticks and stamps."""

from __future__ import annotations

from decimal import Decimal

from flexarm_ros.core.parameters.sections import RunParameters
from flexarm_ros.core.timeline import seconds_to_ns, T0_NS, Timeline
from hypothesis import given
from hypothesis import strategies as st
import pytest


@given(st.integers(min_value=0, max_value=10**15))
def test_decimal_text_of_whole_nanoseconds_is_exact(ns: int) -> None:
    seconds = float(Decimal(ns) / 10**9)
    # Up to 15 significant digits the shortest text of the float is the decimal itself.
    assert seconds_to_ns(seconds) == ns


@pytest.mark.parametrize('seconds', [1e-10, 0.0010000000001, 1 / 3, float('nan'), float('inf')])
def test_what_is_not_whole_is_refused(seconds: float) -> None:
    with pytest.raises(ValueError, match='not a whole number of nanoseconds'):
        seconds_to_ns(seconds)


def test_the_papers_run() -> None:
    timeline = Timeline.of(RunParameters())
    assert (timeline.period_ns, timeline.ticks) == (1_000_000, 16_000)
    assert timeline.stamp_ns(0) == T0_NS == 1_000_000_000
    assert timeline.stamp_ns(15_999) == 16_999_000_000


def test_a_day_of_one_second_ticks_passes_2_to_the_32_ns() -> None:
    timeline = Timeline.of(RunParameters(control_period=1.0, duration=86401.0))
    assert timeline.stamp_ns(86_400) == 86_401 * 10**9


@pytest.mark.parametrize(
    ('run', 'key'),
    [
        (RunParameters(control_period=1e-10), 'control_period'),
        (RunParameters(control_period=0.0), 'control_period'),
        (RunParameters(control_period=0.003, duration=1.0), 'duration'),
        (RunParameters(control_period=2.0, duration=1.0), 'duration'),
    ],
)
def test_errors_name_the_key(run: RunParameters, key: str) -> None:
    with pytest.raises(ValueError, match=f'^{key}'):
        Timeline.of(run)
