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

"""Sensors: stamps, latency, counts, noise, rate and location."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.parameters.sections import (
    EncoderParameters,
    PlantParameters,
    RunConfig,
    RunParameters,
    TipSensorParameters,
)
from flexarm_ros.core.sensing.sensors import (
    check_location,
    Encoder,
    Noise,
    TipSensor,
)
from flexarm_ros.core.timeline import T0_NS, ticks_between
import numpy as np
import pytest
from scipy.stats import kstest

MS = 1_000_000


def states(count: int) -> list[tuple[np.ndarray, np.ndarray]]:
    rng = np.random.default_rng(11)
    return [(rng.normal(size=4), rng.normal(size=4)) for _ in range(count)]


def run(sensor, motion) -> list[tuple[int, float, float, float, float]]:
    return [sensor.measure(k, q, qd) for k, (q, qd) in enumerate(motion)]


def encoder(**keys) -> Encoder:
    seed = keys.pop('seed', 0)
    return Encoder(RunConfig(run=RunParameters(seed=seed), encoder=EncoderParameters(**keys)))


def tip(**keys) -> TipSensor:
    seed = keys.pop('seed', 0)
    return TipSensor(
        RunConfig(run=RunParameters(seed=seed), tip_sensor=TipSensorParameters(**keys))
    )


def test_ideal_encoder_is_the_state() -> None:
    motion = states(5)
    for k, (found, (q, qd)) in enumerate(zip(run(encoder(), motion), motion, strict=True)):
        assert found == (T0_NS + k * MS, q[0], q[1], qd[0], qd[1])


def test_stamp_is_the_time_of_measurement_even_before_the_start() -> None:
    motion = states(40)
    found = run(encoder(latency=0.0312), motion)
    assert [m[0] for m in found] == [T0_NS + k * MS - 31_200_000 for k in range(40)]
    # Before the start: the initial value.
    assert all(m[1:] == found[0][1:] for m in found[:32])
    expected = 0.8 * motion[3][0][0] + 0.2 * motion[2][0][0]
    assert found[34][1] == pytest.approx(expected, rel=1e-12)


def test_counts() -> None:
    step = 2 * math.pi / 4096
    motion = states(200)
    for found, (q, qd) in zip(run(encoder(resolution=step), motion), motion, strict=True):
        for i in (0, 1):
            assert found[1 + i] / step == pytest.approx(round(found[1 + i] / step), abs=1e-9)
            assert abs(found[1 + i] - q[i]) <= step / 2 * (1 + 1e-9)
            assert found[3 + i] == qd[i]


@pytest.mark.parametrize('resolution', [0.0, 2 * math.pi / 4096])
def test_offset_is_what_is_read_at_zero(resolution: float) -> None:
    motion = [(np.zeros(4), np.ones(4)), *states(20)]
    straight = run(encoder(resolution=resolution), motion)
    found = run(encoder(resolution=resolution, offset=(0.02, -0.3)), motion)
    assert found[0][1:] == (0.02, -0.3, 1.0, 1.0)
    for was, now in zip(straight, found, strict=True):
        assert now == (was[0], was[1] + 0.02, was[2] - 0.3, was[3], was[4])


def test_encoder_noise_has_the_given_deviation_and_is_white() -> None:
    still = [(np.zeros(4), np.zeros(4))] * 20_000
    found = np.array(run(encoder(noise_std=1e-3), still))[:, 1:]
    for i in (0, 1):
        # Standard error of a deviation from n samples: 1 / sqrt(2 n) = 0.5 %; 5 sigma.
        assert found[:, i].std() == pytest.approx(1e-3, rel=0.025)
        assert abs(found[:, i].mean()) < 5e-3 / math.sqrt(20_000)
        lag = np.corrcoef(found[1:, i], found[:-1, i])[0, 1]
        assert abs(lag) < 5 / math.sqrt(20_000)
    assert abs(np.corrcoef(found[:, 0], found[:, 1])[0, 1]) < 5 / math.sqrt(20_000)
    assert np.all(found[:, 2:] == 0.0)


def test_noise_is_not_averaged_by_a_fractional_latency() -> None:
    still = [(np.zeros(4), np.zeros(4))] * 20_000
    found = np.array(run(tip(noise_std=0.01, latency=0.0005), still))
    assert found[:, 1].std() == pytest.approx(0.01, rel=0.025)
    assert np.all(found[:, 3:] == 0.0)


def test_noise_is_seeded_by_seed_and_node() -> None:
    still = [(np.zeros(4), np.zeros(4))] * 50

    def unit(sensor) -> np.ndarray:
        return np.array(run(sensor, still))[:, 1:3] - [9.0 * isinstance(sensor, TipSensor), 0.0]

    first = unit(encoder(noise_std=1.0))
    assert np.array_equal(first, unit(encoder(noise_std=1.0)))
    assert not np.array_equal(first, unit(encoder(noise_std=1.0, seed=1)))
    assert not np.allclose(first, unit(tip(noise_std=1.0)))
    # The sequence is pinned: PCG64 of this seed and name, by Marsaglia's polar method.
    sequence = np.random.SeedSequence(0, spawn_key=tuple(b'encoder'))
    points = (np.random.PCG64(sequence).random_raw((90, 2)) >> 11) * 2.0**-52 - 1.0
    squares = (points * points).sum(axis=1)
    inside = squares < 1.0
    factors = np.sqrt(-2.0 * np.log(squares[inside]) / squares[inside])
    expected = (points[inside] * factors[:, None])[:50]
    assert np.allclose(first, expected, rtol=1e-14, atol=0.0)


def test_noise_is_normal_and_independent() -> None:
    noise = Noise(3, 'any')
    drawn = np.array([noise.pair() for _ in range(20_000)])
    assert kstest(drawn.ravel(), 'norm').pvalue > 0.01
    assert kstest((drawn[:, 0] + drawn[:, 1]) / math.sqrt(2.0), 'norm').pvalue > 0.01
    assert np.all(np.abs(np.corrcoef(drawn[1:].T, drawn[:-1].T) - np.eye(4)) < 0.03)


@pytest.mark.parametrize('measurand', ['rigid', 'elastic'])
def test_tip_sensor_measures_its_point(measurand: str) -> None:
    sensor = tip(location=6.75, measurand=measurand)
    point = make_point(PlantParameters(), 6.75, measurand == 'elastic')
    motion = states(10)
    for found, (q, qd) in zip(run(sensor, motion), motion, strict=True):
        assert found[1:] == point(q, qd)


def test_rate_below_the_control_rate_holds_the_sample_and_its_stamp() -> None:
    every, held = tip(latency=0.0015), tip(latency=0.0015, rate=250.0)
    motion = states(30)
    all_samples, found = run(every, motion), run(held, motion)
    for k in range(30):
        assert found[k] == all_samples[k - k % 4]
        assert found[k][0] == T0_NS + (k - k % 4) * MS - 1_500_000


@pytest.mark.parametrize('model', ['buffer', 'pade2'])
def test_latency_changed_while_running(model: str) -> None:
    sensor = tip(latency_model=model)
    still = states(1)[0]
    for k in range(30):
        if k == 10:
            sensor.retune(RunConfig(tip_sensor=TipSensorParameters(latency=0.00525)))
        found = sensor.measure(k, *still)
        assert found[0] == T0_NS + k * MS - (5_250_000 if k >= 10 else 0)
        assert found[1:] == pytest.approx(make_point(PlantParameters(), 9.0, False)(*still))
    with pytest.raises(ValueError, match='^tip_sensor.latency: -1 ns'):
        sensor.retune(RunConfig(tip_sensor=TipSensorParameters(latency=-1e-9)))


@pytest.mark.parametrize(
    ('rate', 'period_ns', 'ticks'),
    [(0.0, MS, 1), (1000.0, MS, 1), (250.0, MS, 4), (0.1, MS, 10_000), (1e5, 10_000, 1)],
)
def test_whole_ticks_a_sample(rate: float, period_ns: int, ticks: int) -> None:
    assert ticks_between('tip_sensor.rate', rate, period_ns) == ticks


@pytest.mark.parametrize('rate', [30.0, 2000.0, 999.9999999])
def test_a_rate_that_is_not_whole_ticks_is_refused(rate: float) -> None:
    with pytest.raises(ValueError, match='^tip_sensor.rate: .*allowed'):
        ticks_between('tip_sensor.rate', rate, MS)


def test_location_is_on_link_2_with_its_rigid_parts() -> None:
    plant = PlantParameters(hub_radius=(0.1, 0.2), end_offset=(0.7, 0.3))
    for location in (5.3, 10.3):  # 0.1 + 4.5 + 0.7 is below 5.3 in binary
        check_location(RunConfig(plant=plant, tip_sensor=TipSensorParameters(location=location)))
    with pytest.raises(ValueError, match=r'5\.3 \(elbow\) to 10\.3 m \(tip\)'):
        check_location(RunConfig(plant=plant, tip_sensor=TipSensorParameters(location=5.29)))


def test_location_must_be_on_link_2() -> None:
    for location in (4.4999, 9.0001):
        with pytest.raises(ValueError, match='^tip_sensor.location: .*allowed: 4.5'):
            tip(location=location)
    decimal = RunConfig(plant=PlantParameters(length=(0.7, 0.1)))
    check_location(replace(decimal, tip_sensor=TipSensorParameters(location=0.8)))
