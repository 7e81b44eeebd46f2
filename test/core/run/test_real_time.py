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
"""What is counted of a free-running run's timing."""

from __future__ import annotations

from flexarm_ros.core.run.results.real_time import (
    flat,
    KEYS,
    LiveSpread,
    LiveTiming,
    RunTiming,
    shown,
)
import numpy as np
import pytest


def timing(*ticks: tuple[float, float, int], period: float = 1.0) -> RunTiming:
    """Return the timing of ticks given as begin, arrival of the held command, its tick."""
    begin, arrival, answers = np.array(ticks, float).T
    return RunTiming(begin, np.arange(len(ticks)) * period, arrival, answers, period)


def test_a_run_on_time_has_nothing_to_count() -> None:
    found = timing((0.0, 0.25, 0), (1.0, 1.25, 1), (2.0, 2.25, 2)).summary()
    assert tuple(found) == KEYS
    assert found['factor'] == pytest.approx(1.0)
    assert (found['late_ticks'], found['missed_commands'], found['held_commands']) == (0, 0, 0)
    assert found['command_latency_ms'] == {'p50': 250.0, 'p99': 250.0, 'max': 250.0}
    assert found['tick_jitter_ms']['max'] == 0.0


def test_each_fault_is_counted_as_what_it_is() -> None:
    found = timing(
        (0.0, -1.0, -1),  # no command yet: held and missed
        (1.0, 1.5, 0),  # the answer to the tick before: missed, but not held
        (2.0, 2.5, 2),
        (4.5, 2.5, 2),  # late by one and a half; the command of tick 2 is held
        (5.0, 5.5, 4),
    ).summary()
    assert (found['late_ticks'], found['missed_commands'], found['held_commands']) == (2, 3, 2)
    # Tick 0 waited 1.5 s, 1 and 2 for the command at 2.5, 3 and 4 for that at 5.5.
    assert found['command_latency_ms']['max'] == pytest.approx(1500.0)
    assert found['command_latency_ms']['p50'] == pytest.approx(1000.0)


def test_a_run_that_has_not_begun_has_no_numbers() -> None:
    nothing = RunTiming(*(np.empty(0) for _ in range(4)), 0.001).summary()
    assert nothing['factor'] is None
    assert nothing['tick_jitter_ms'] == {'p50': None, 'p99': None, 'max': None}


def test_the_live_counts_are_those_of_the_record() -> None:
    rng = np.random.default_rng(3)
    live, rows, held, arrived = LiveTiming(), [], -1, -1.0
    for tick in range(400):
        begin = tick + rng.exponential(0.4)
        live.begun(tick, begin, float(tick), 1.0)
        new = rng.random() < 0.8
        if new:
            held = int(rng.integers(max(held, tick - 3, 0), tick + 1))
            arrived = begin + rng.random()
            live.answered(held, arrived)
        live.ended(tick, held, new)
        rows.append((begin, arrived, held))
    found, exact = live.values(), timing(*rows).summary()
    for key in ('late_ticks', 'missed_commands', 'held_commands'):
        assert found[key] == exact[key] > 0
    assert found['tick_jitter_ms']['p50'] == pytest.approx(exact['tick_jitter_ms']['p50'], rel=0.2)
    for key in ('command_latency_ms', 'tick_jitter_ms'):
        assert found[key]['max'] == pytest.approx(exact[key]['max'])


def test_percentiles_of_the_live_histogram() -> None:
    spread = LiveSpread()
    assert spread.quantile(0.5) is None
    for milli in range(1, 101):
        spread.add(milli * 1e-3)
    assert spread.quantile(0.5) == pytest.approx(0.05, rel=0.13)
    assert spread.quantile(1.0) == spread.largest == 0.1
    spread.add(1e9)
    spread.add(-1.0)
    assert spread.quantile(1.0) is not None


def test_the_counts_for_people() -> None:
    live = LiveTiming()
    assert shown(live.values()) == '0 late ticks, 0 missed commands, 0 held commands'
    live.begun(0, 0.001, 0.0, 1.0)
    assert 'tick jitter 1/1/1 ms' in shown(live.values())
    assert flat(live.values())['tick jitter p99 (ms)'] == '1.000'
    assert flat(live.values())['command latency max (ms)'] == ''
