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
Arrival of samples: statistics against closed forms, and the channel against a plain model.

Tolerances are 4 standard errors of the estimate, from 100 000 samples.
"""

from __future__ import annotations

from itertools import groupby
import math

from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.sensing.channel import LatencyChannel
from flexarm_ros.core.sensing.schedule import Latencies, Losses, Schedule
from flexarm_ros.core.timeline import T0_NS, Timeline
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

COUNT, SIGMAS = 100_000, 4.0
PERIOD_NS = 1_000_000
TIMELINE = Timeline(PERIOD_NS, 1000)


def latencies(latency: float, jitter: float, distribution: str, seed: int = 3) -> np.ndarray:
    of = ChannelParameters(latency, jitter, distribution)
    drawn = Latencies(seed, 'encoder', of)
    return np.array([drawn.next_ns(round(latency * 1e9), jitter) for _ in range(COUNT)]) * 1e-9


def assert_moments(found: np.ndarray, mean: float, variance: float, fourth: float) -> None:
    """Compare mean and variance with their exact values; ``fourth``: the central moment."""
    assert abs(found.mean() - mean) < SIGMAS * math.sqrt(variance / COUNT)
    error = math.sqrt((fourth - variance**2) / COUNT)
    assert abs(found.var() - variance) < SIGMAS * error


@pytest.mark.parametrize('seed', [0, 3])
def test_uniform_jitter(seed: int) -> None:
    found, jitter = latencies(0.01, 0.003, 'uniform', seed), 0.003
    assert found.min() >= 0.01 and found.max() < 0.013
    assert_moments(found, 0.0115, jitter**2 / 12.0, jitter**4 / 80.0)


def test_exponential_jitter() -> None:
    found, jitter = latencies(0.01, 0.003, 'exponential'), 0.003
    assert found.min() >= 0.01
    assert_moments(found, 0.013, jitter**2, 9.0 * jitter**4)


def test_normal_jitter() -> None:
    found, jitter = latencies(0.1, 0.003, 'normal'), 0.003
    assert_moments(found, 0.1, jitter**2, 3.0 * jitter**4)


def test_normal_jitter_is_cut_at_no_latency() -> None:
    """With mean 0 half of the latencies are 0: the moments are those of a rectified normal."""
    found, s = latencies(0.0, 0.003, 'normal'), 0.003
    mean = s / math.sqrt(2.0 * math.pi)
    variance = s**2 / 2.0 - mean**2
    raw = [1.0, mean, s**2 / 2.0, s**3 * math.sqrt(2.0 / math.pi), 1.5 * s**4]
    fourth = raw[4] - 4.0 * mean * raw[3] + 6.0 * mean**2 * raw[2] - 3.0 * mean**4
    assert_moments(found, mean, variance, fourth)
    assert abs(np.mean(found == 0.0) - 0.5) < SIGMAS * 0.5 / math.sqrt(COUNT)


def test_measured_latencies_are_used_in_order_and_repeated() -> None:
    of = ChannelParameters(0.5, 0.5, latencies=(0.001, 0.0072, 0.0))
    drawn = Latencies(0, 'encoder', of)
    found = [drawn.next_ns(500_000_000, 0.5) for _ in range(7)]
    assert found == [1_000_000, 7_200_000, 0, 1_000_000, 7_200_000, 0, 1_000_000]


def lost(dropout: float, burst: float) -> np.ndarray:
    losses = Losses(5, 'tip_sensor')
    return np.array([losses.lost(dropout, burst) for _ in range(COUNT)])


def runs_of_losses(found: np.ndarray) -> np.ndarray:
    return np.array([len(list(run)) for bad, run in groupby(found.tolist()) if bad])


@pytest.mark.parametrize('p', [0.02, 0.3])
def test_independent_losses(p: float) -> None:
    found = lost(p, 1.0)
    assert abs(found.mean() - p) < SIGMAS * math.sqrt(p * (1.0 - p) / COUNT)
    # Independent: a run of losses goes on with probability p.
    runs = runs_of_losses(found)
    error = math.sqrt(p) / (1.0 - p) / math.sqrt(len(runs))
    assert abs(runs.mean() - 1.0 / (1.0 - p)) < SIGMAS * error


@pytest.mark.parametrize(('p', 'burst'), [(0.02, 5.0), (0.1, 20.0), (0.5, 1.5)])
def test_losses_in_bursts(p: float, burst: float) -> None:
    found = lost(p, burst)
    leave, enter = 1.0 / burst, p / (burst * (1.0 - p))
    # The samples of a chain are correlated by 1 - leave - enter per step.
    memory = 1.0 - leave - enter
    inflation = (1.0 + memory) / (1.0 - memory)
    assert abs(found.mean() - p) < SIGMAS * math.sqrt(p * (1.0 - p) * inflation / COUNT)
    runs = runs_of_losses(found)  # geometric
    error = math.sqrt(1.0 - leave) / leave / math.sqrt(len(runs))
    assert abs(runs.mean() - burst) < SIGMAS * error


def test_loss_and_jitter_do_not_change_each_other() -> None:
    def arrivals(dropout: float, jitter: float) -> list[int | None]:
        of = ChannelParameters(0.004, jitter, dropout=dropout)
        schedule = Schedule(1, 'encoder', of, PERIOD_NS)
        return [schedule.send(k) for k in range(2000)]

    lossless, lossy, steady = arrivals(0.0, 0.01), arrivals(0.2, 0.01), arrivals(0.2, 0.0)
    assert None in lossy
    assert all(b in (None, a) for a, b in zip(lossless, lossy, strict=True))
    assert [a is None for a in lossy] == [a is None for a in steady]


def test_names_and_seeds_give_other_numbers() -> None:
    def first(seed: int, name: str) -> list[int | None]:
        of = ChannelParameters(0.0, 0.05, dropout=0.3)
        schedule = Schedule(seed, name, of, PERIOD_NS)
        return [schedule.send(k) for k in range(20)]

    assert first(1, 'encoder') == first(1, 'encoder')
    assert first(1, 'encoder') != first(2, 'encoder')
    assert first(1, 'encoder') != first(1, 'tip_sensor')


PARAMETERS = st.builds(
    ChannelParameters,
    latency=st.integers(0, 12_000_000).map(lambda ns: ns / 1e9),
    jitter=st.sampled_from([0.0, 0.0004, 0.003, 0.02]),
    jitter_distribution=st.sampled_from(['uniform', 'exponential', 'normal']),
    dropout=st.sampled_from([0.0, 0.1, 0.5]),
    dropout_burst=st.sampled_from([1.0, 4.0]),
    arrival=st.sampled_from(['newest', 'in_order']),
    rate=st.sampled_from([0.0, 250.0, 1000.0]),
)


def received(of: ChannelParameters, ticks: int = 60) -> list[tuple[int, list[float]]]:
    """Return stamp and values that the receiver has at each tick, of the signal k, k + 0.5."""
    channel, found = LatencyChannel('encoder', of, TIMELINE, 4, 7), []
    for k in range(ticks):
        arrived = channel.step(k, (float(k), k + 0.5, -float(k), 0.0))
        if arrived is not None:
            found.append((arrived[0], list(arrived[1])))
        else:
            found.append(found[-1])
    return found


@settings(max_examples=60, deadline=None, derandomize=True)
@given(PARAMETERS)
def test_the_receiver_has_the_newest_delivered_sample(of: ChannelParameters) -> None:
    """The channel against a list of all samples with their times of arrival, tick by tick."""
    if not of.scheduled:
        return
    every = 4 if of.rate == 250.0 else 1
    whole, part_ns = divmod(round(of.latency * 1e9), PERIOD_NS)
    schedule = Schedule(7, 'encoder', of, PERIOD_NS)
    sent = [(s, schedule.send(s, part_ns)) for s in range(60) if (s + whole) % every == 0]
    for k, (stamp, values) in enumerate(received(of)):
        newest = max((s for s, at in sent if at is not None and at <= k), default=0)
        assert stamp == T0_NS + newest * PERIOD_NS - part_ns
        age = part_ns / PERIOD_NS
        assert values[0] == pytest.approx(max(newest - age, 0.0) if newest else 0.0, abs=1e-12)


def test_in_order_no_sample_overtakes_another() -> None:
    of = ChannelParameters(0.0, 0.01, arrival='in_order')
    schedule = Schedule(0, 'encoder', of, PERIOD_NS)
    arrivals = [at for k in range(1000) if (at := schedule.send(k)) is not None]
    assert arrivals == sorted(arrivals)
    free = Schedule(0, 'encoder', ChannelParameters(0.0, 0.01), PERIOD_NS)
    overtaking = [free.send(k) or 0 for k in range(1000)]
    assert overtaking != sorted(overtaking)
    assert [max(overtaking[: k + 1]) for k in range(1000)] == arrivals


@settings(max_examples=40, deadline=None, derandomize=True)
@given(PARAMETERS, st.integers(1, 30))
def test_a_vanishing_jitter_is_a_constant_latency(of: ChannelParameters, change: int) -> None:
    """With next to no jitter, switched on live, the schedule delivers what the line does."""
    plain = ChannelParameters(of.latency, rate=of.rate)
    late = ChannelParameters(of.latency, 1e-12, rate=of.rate)
    line, channel = (LatencyChannel('encoder', plain, TIMELINE, 4, 7) for _ in range(2))
    for k in range(60):
        if k == change:
            channel.retune(late)
        sample = (float(k * k), 1.0, -float(k), 0.0)
        found, wanted = channel.step(k, sample), line.step(k, sample)
        assert (found is None) == (wanted is None)
        if found is not None and wanted is not None:
            assert found[0] == wanted[0]
            assert [*found[1]] == [*wanted[1]]
    assert channel.scheduled


def test_changes_of_one_tick_are_one_change() -> None:
    """A node takes them one by one, the recomputation all at once."""
    start, late = ChannelParameters(), ChannelParameters(latency=0.002)
    both = ChannelParameters(latency=0.002, jitter=0.001)
    single, joint = (LatencyChannel('encoder', start, TIMELINE, 4, 7) for _ in range(2))
    for k in range(40):
        if k == 20:
            single.retune(late)
            single.retune(both)
            joint.retune(both)
        sample = (float(k), 0.0, 0.0, 0.0)
        found, wanted = single.step(k, sample), joint.step(k, sample)
        assert found == wanted, k


def test_nothing_arrives_where_everything_is_lost() -> None:
    found = received(ChannelParameters(0.0025, dropout=1.0))
    assert set(map(str, found)) == {str((T0_NS - 500_000, [0.0, 0.5, -0.0, 0.0]))}


def test_the_start_may_be_given() -> None:
    of = ChannelParameters(0.002, 0.001)
    channel = LatencyChannel('actuator', of, TIMELINE, 2, 0, start=(0.0, 0.0))
    found = [channel.step(k, (5.0 + k, -5.0)) for k in range(4)]
    assert found[0] == (T0_NS, (0.0, 0.0))
    assert found[1] is found[2] is None
    assert found[3] == (T0_NS, [5.0, -5.0])


def test_before_the_start_a_constant_latency_gives_the_start() -> None:
    channel = LatencyChannel(
        'actuator', ChannelParameters(0.0015), TIMELINE, 2, 0, start=(0.0, 0.0)
    )
    found = [list(channel.step(k, (4.0, 8.0))[1]) for k in range(4)]
    assert found == [[0.0, 0.0], [2.0, 4.0], [4.0, 8.0], [4.0, 8.0]]


@pytest.mark.parametrize(
    ('of', 'fault'),
    [
        (ChannelParameters(dropout=0.9, dropout_burst=2.0), 'dropout_burst'),
        (ChannelParameters(dropout=1.0, dropout_burst=2.0), 'dropout_burst'),
        (ChannelParameters(rate=300.0), 'rate'),
        (ChannelParameters(latency=2e-10), 'latency'),
    ],
)
def test_impossible_channels_are_refused(of: ChannelParameters, fault: str) -> None:
    with pytest.raises(ValueError, match=f'encoder.{fault}: '):
        LatencyChannel('encoder', of, TIMELINE, 4)
