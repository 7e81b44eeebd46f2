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

"""The Gymnasium environment: its checker's judgement, and the same arm as everywhere."""

from __future__ import annotations

import inspect
from pathlib import Path
import re

import flexarm_ros as fa
import numpy as np
import pytest

checker = pytest.importorskip(
    'gymnasium.utils.env_checker', reason="pip install 'flexarm_ros[gymnasium]'"
)

NOISY = {'encoder': {'noise_std': 1e-3}, 'tip_sensor': {'noise_std': 1e-2, 'latency': 0.0035}}


@pytest.mark.filterwarnings('ignore:.*(imum value|render modes):UserWarning')
def test_gymnasium_s_own_checker_is_content() -> None:
    checker.check_env(fa.FlexArmEnv('fls_tip', duration=0.2, **NOISY))


def test_the_wrapper_is_short() -> None:
    assert len(Path(inspect.getfile(fa.FlexArmEnv)).read_text('utf-8').splitlines()) < 150


def test_an_agent_that_plays_a_run_s_torques_flies_that_run() -> None:
    run = fa.simulate('fls_tip', duration=0.2, controller={'kn': 5.0}).trajectory
    env = fa.FlexArmEnv('fls_tip', duration=0.2, hold=1, torque=1024.0)
    observed, _ = env.reset(seed=0)
    for k in range(len(run)):
        row = run[k]
        assert observed[[0, 1, 2, 3]].tolist() == [
            row['theta1'], row['theta2'], row['dtheta1'], row['dtheta2']
        ]  # fmt: skip
        assert observed[[4, 5]].tolist() == [row['meas_x'], row['meas_y']]
        assert observed[[8, 9]].tolist() == [row['ref_x'], row['ref_y']]
        assert observed[[12, 13]].tolist() == [row['delta1'], row['delta2']]
        action = np.array([row['tau1'], row['tau2']]) / 1024.0
        observed, reward, terminated, truncated, info = env.step(action)
        if k + 1 < len(run):
            after = run[k + 1]
            error = np.hypot(after['rigid_x'] - after['ref_x'], after['rigid_y'] - after['ref_y'])
            assert reward == pytest.approx(-error, abs=1e-15)
            assert not terminated and not truncated
    assert truncated and not terminated and info['tick'] == len(run)


def test_an_episode_lasts_the_scenario_s_duration() -> None:
    env = fa.FlexArmEnv('pd_tip', duration=0.025, hold=10)
    env.reset(seed=1)
    ends = [env.step(np.zeros(2))[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_an_unstable_arm_ends_the_episode_and_costs_what_is_left() -> None:
    env = fa.FlexArmEnv('pd_tip', duration=4.0, torque=1e6)
    env.reset(seed=1)
    rewards, terminated = [], False
    while not terminated:
        observed, reward, terminated, truncated, info = env.step(np.ones(2))
        rewards.append(reward)
        assert not truncated
    left = 1 + (4000 - info['tick']) // 10
    assert rewards[-1] == -5.0 * left and 'unstable' in info
    assert np.isfinite(observed).all() and observed.shape == (14,)


def test_the_seed_draws_the_noise_and_options_change_the_arm() -> None:
    env = fa.FlexArmEnv('fls_tip', duration=1.0, **NOISY)

    def start(seed: int | None, **options: object) -> list[float]:
        return list(map(float, env.reset(seed=seed, options=options or None)[0]))

    first = start(7)
    assert start(7) == first and start(8) != first
    assert start(None) != start(None)
    shorter = start(7, plant={'length': [4.5, 4.6]}, tip_sensor={'location': 9.1})
    assert shorter[0] != first[0] and start(7) == first
    with pytest.raises(fa.ScenarioError, match='plant.payload_mass'):
        start(7, plant={'payload_mass': -1.0})
    with pytest.raises(ValueError, match='hold: 0, allowed'):
        fa.FlexArmEnv(hold=0)


def test_an_arm_past_its_limit_of_deflection_ends_the_episode() -> None:
    """It pays the limit for every step that is left."""
    env = fa.FlexArmEnv('fls_tip', duration=0.2, plant={'deflection_limit': [0.01, 0.02]})
    env.reset(seed=0)
    terminated = False
    while not terminated:
        _, reward, terminated, truncated, info = env.step(np.array([0.5, 0.0]))
        assert not truncated
    assert reward == -0.02 * (1 + (200 - info['tick']) // 10)
    assert info['unstable'].startswith('deflection of link')
    assert info['unstable'].endswith('m, limit 0.01 m') or 'limit 0.02 m' in info['unstable']


@pytest.mark.parametrize(
    ('argument', 'value', 'allowed'),
    [
        ('hold', 0, 'a whole number, at least 1 ticks'),
        ('hold', 1.5, 'a whole number, at least 1 ticks'),
        ('hold', float('nan'), 'a whole number, at least 1 ticks'),
        ('torque', float('nan'), 'a number, above 0 and at most 1000000000 N m'),
        ('torque', float('inf'), 'a number, above 0 and at most 1000000000 N m'),
        ('torque', 0, 'a number, above 0 and at most 1000000000 N m'),
        ('torque', '5', 'a number, above 0 and at most 1000000000 N m'),
    ],
)
def test_numbers_are_checked(argument: str, value: object, allowed: str) -> None:
    with pytest.raises(ValueError, match=f'^{argument}: {re.escape(repr(value))}, allowed: '):
        fa.FlexArmEnv('fls_tip', **{argument: value})
    with pytest.raises(ValueError, match=f'{allowed}$'):
        fa.FlexArmEnv('fls_tip', **{argument: value})


@pytest.mark.parametrize('action', [[np.nan, 0.0], [0.0, np.inf], [1.0], [[0.0, 0.0]], 'ab'])
def test_an_action_is_two_finite_numbers(action: object) -> None:
    """It ended the episode as an unstable arm, "shoulder: nan"."""
    env = fa.FlexArmEnv('fls_tip', duration=0.1)
    env.reset(seed=0)
    env.step(np.zeros(2))
    with pytest.raises(ValueError, match=r'^action at tick 10: .*, allowed: two finite numbers'):
        env.step(np.array(action))
    assert env.step(np.zeros(2))[4] == {'tick': 20}
