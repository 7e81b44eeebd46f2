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

"""Delay lines against closed forms."""

from __future__ import annotations

import math

from flexarm_ros.core.sensing.delay import BufferDelay, PadeDelay
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy import signal

PERIOD = 1_000_000


def run(line, values: np.ndarray) -> np.ndarray:
    return np.array([line.step(k, *row) for k, row in enumerate(values)])


@settings(max_examples=60)
@given(st.integers(1, 3_000_000), st.integers(0, 20_000_000), st.integers(0, 2**31))
def test_buffer_is_linear_interpolation_at_an_exact_age(period: int, latency: int, seed: int):
    latency = min(latency, 40 * period)
    values = np.random.default_rng(seed).normal(size=(60, 4))
    found = run(BufferDelay(period, latency), values)
    whole, rest = divmod(latency, period)
    for k in range(60):
        newer, older = max(k - whole, 0), max(k - whole - 1, 0)
        expected = values[newer] + rest / period * (values[older] - values[newer])
        assert found[k] == pytest.approx(expected, rel=1e-12, abs=1e-14)


@given(st.integers(0, 50 * PERIOD))
def test_a_ramp_comes_out_shifted_and_nothing_before_the_start(latency: int) -> None:
    times = np.arange(80) * PERIOD
    values = np.column_stack([7.0 + times * 1e-6, times * -2e-6, times * 0.0, times * 1e-7])
    found = run(BufferDelay(PERIOD, latency), values)
    late = np.maximum(times - latency, 0)
    expected = np.column_stack([7.0 + late * 1e-6, late * -2e-6, late * 0.0, late * 1e-7])
    assert found == pytest.approx(expected, rel=1e-12, abs=1e-9)


def test_whole_ticks_deliver_the_samples_themselves() -> None:
    values = np.random.default_rng(1).normal(size=(30, 4))
    found = run(BufferDelay(PERIOD, 3 * PERIOD), values)
    assert np.array_equal(found[3:], values[:-3])
    assert np.array_equal(run(BufferDelay(PERIOD, 0), values), values)


def test_latency_changed_while_running_reads_the_new_age_at_once() -> None:
    values = np.column_stack([np.arange(40.0)] * 4)
    line = BufferDelay(PERIOD, 2 * PERIOD)
    plan = {10: 7 * PERIOD + PERIOD // 2, 20: 0, 30: PERIOD // 4}
    latency = 2.0
    for k in range(40):
        if k in plan:
            line.set_latency_ns(plan[k])
            latency = plan[k] / PERIOD
        assert line.step(k, *values[k])[0] == pytest.approx(max(k - latency, 0.0))


def test_latency_beyond_the_history_is_refused() -> None:
    line = BufferDelay(PERIOD, 0)
    line.set_latency_ns(999_999_999)
    for bad in (2_000_000_000, -1):
        with pytest.raises(ValueError, match='allowed: 0 to'):
            line.set_latency_ns(bad)
    long = BufferDelay(1_000, 100_000_000)
    assert long.step(0, 1.0, 2.0, 3.0, 4.0) == (1.0, 2.0, 3.0, 4.0)


def transfer(tau: float) -> tuple[list[float], list[float]]:
    """Return the approximation as the books print it, highest power first."""
    return [tau**2 / 12, -tau / 2, 1.0], [tau**2 / 12, tau / 2, 1.0]


@pytest.mark.parametrize('latency', [200_000, 1_238_000, 31_200_000])
def test_pade_is_the_exact_response_to_a_linear_input(latency: int) -> None:
    tau = latency * 1e-9
    values = np.cumsum(np.random.default_rng(3).normal(size=(200, 4)), axis=0)
    found = run(PadeDelay(PERIOD, latency), values)
    # lsim solves the same system exactly for inputs linear between the samples.
    times = np.arange(200) * 1e-3
    for channel in range(4):
        change = values[:, channel] - values[0, channel]
        _, expected, _ = signal.lsim(transfer(tau), change, times)
        assert found[:, channel] - values[0, channel] == pytest.approx(expected, abs=1e-7)


def test_pade_step_response_in_closed_form() -> None:
    """A rise from 0 to 1 within one tick: the mean of the step response over that tick."""
    tau = 0.0312
    values = np.zeros((200, 4))
    values[1:] = 1.0
    found = run(PadeDelay(PERIOD, 31_200_000), values)[:, 0]

    def area(t: float) -> float:
        # integral of the step response 1 - 4 sqrt(3) e^(-3r) sin(sqrt(3) r), r = t / tau
        r, w = t / tau, math.sqrt(3.0)
        fall = math.exp(-3 * r) * (3 * math.sin(w * r) + w * math.cos(w * r)) / 12
        return t - tau * 4 * w * (w / 12 - fall)

    expected = [0.0] + [(area(k * 1e-3) - area((k - 1) * 1e-3)) / 1e-3 for k in range(1, 200)]
    assert found == pytest.approx(expected, abs=1e-10)
    # It leaps to where it should be, turns back to below zero, and settles; lowest where
    # tan(sqrt(3) r) = 1 / sqrt(3).
    lowest = 1.0 - 2.0 * math.sqrt(3.0) * math.exp(-math.pi / (2.0 * math.sqrt(3.0)))
    assert found[1] > 0.8
    assert found.min() == pytest.approx(lowest, abs=1e-3)
    assert found[-1] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize('omega', [2.0, 10.0, 30.0])
def test_frequency_responses(omega: float) -> None:
    """Gain and phase of both lines on a sine against exp(-jwT) and Pade's formula."""
    tau, period = 0.0312, 100_000
    times = np.arange(40_000) * 1e-4
    values = np.column_stack([np.sin(omega * times)] * 4)
    steady = times > 2.0
    base = np.column_stack([np.sin(omega * times), np.cos(omega * times)])[steady]
    num, den = transfer(tau)
    pade = complex(np.polyval(num, 1j * omega) / np.polyval(den, 1j * omega))
    pure = complex(np.exp(-1j * omega * tau))
    # Lines between samples cost at most (omega T)^2 / 8 of the amplitude.
    slack = (omega * 1e-4) ** 2 / 8 + 1e-9
    for line, expected in ((PadeDelay, pade), (BufferDelay, pure)):
        found = run(line(period, 31_200_000), values)[steady, 0]
        (real, imag), *_ = np.linalg.lstsq(base, found, rcond=None)
        assert abs(complex(real, imag) - expected) < slack
        assert abs(complex(real, imag)) == pytest.approx(1.0, abs=slack)
    # The approximation's error in phase is (w tau)^5 / 720 to first order.
    error = np.angle(pade / pure)
    assert error == pytest.approx((omega * tau) ** 5 / 720, rel=0.2)


def test_pade_at_rest_stays_at_rest_when_the_latency_changes() -> None:
    line = PadeDelay(PERIOD, 5_000_000)
    for k in range(50):
        if k in (10, 20, 30):
            line.set_latency_ns({10: 31_200_000, 20: 0, 30: 1_238_000}[k])
        assert line.step(k, 2.0, -3.0, 0.0, 1.0) == pytest.approx((2.0, -3.0, 0.0, 1.0), abs=1e-12)
