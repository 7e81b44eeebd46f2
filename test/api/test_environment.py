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
import pickle
import re
import subprocess
import sys

import flexarm_ros as fa
from flexarm_ros.api.gymnasium_ids import IDS
import numpy as np
import pytest

checker = pytest.importorskip(
    'gymnasium.utils.env_checker', reason="pip install 'flexarm_ros[gymnasium]'"
)
gymnasium = pytest.importorskip('gymnasium')
error = pytest.importorskip('gymnasium.error')

SQUARE = 'flexarm_ros/Square-v0'
NOISY = {'encoder': {'noise_std': 1e-3}, 'tip_sensor': {'noise_std': 1e-2, 'latency': 0.0035}}


# The checker would like limits of the observation, and a spec where `make` made none.
@pytest.mark.filterwarnings('ignore:.*(imum value|render modes):UserWarning')
@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('name', [None, *IDS])
def test_gymnasium_s_own_checker_is_content(name: str | None) -> None:
    options = {'duration': 0.2, 'render_mode': 'rgb_array', **NOISY}
    if name is None:
        checker.check_env(fa.FlexArmEnv('fls_tip', **options))
    else:
        checker.check_env(gymnasium.make(f'flexarm_ros/{name}', **options).unwrapped)


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
    with pytest.raises(fa.ScenarioError, match="plants: unknown section; did you mean 'plant'"):
        start(7, plants={})
    with pytest.raises(fa.ScenarioError, match='torques: cannot be changed here'):
        start(7, torques=[[0.0, 1.0, 1.0]])
    assert start(7) == first


@pytest.mark.parametrize(
    ('options', 'text'),
    [
        ({'render_mode': 'human'}, "render_mode: 'human', allowed: rgb_array"),
        ({'actuator': {'bandwidth': [20, 20]}}, 'actuator: not available in an environment'),
        ({'plants': {}}, r'plants: unknown section.*\(allowed: run, plant, encoder'),
    ],
)
def test_an_argument_that_cannot_be_used_is_named(options: dict[str, object], text: str) -> None:
    with pytest.raises(ValueError, match=text):
        fa.FlexArmEnv(**options)


def test_no_step_before_a_reset_or_after_the_end() -> None:
    env = fa.FlexArmEnv('fls_tip', duration=0.02, render_mode='rgb_array')
    for call in (lambda: env.step(np.zeros(2)), env.render):
        with pytest.raises(error.ResetNeeded, match='no episode has begun; call reset'):
            call()
    for _ in range(2):
        env.reset(seed=1)
        assert [env.step(np.zeros(2))[3] for _ in range(2)] == [False, True]
        with pytest.raises(error.ResetNeeded, match='the episode has ended; call reset'):
            env.step(np.zeros(2))
    unstable = fa.FlexArmEnv('pd_tip', duration=4.0, torque=1e6)
    unstable.reset(seed=1)
    while not unstable.step(np.ones(2))[2]:
        pass
    with pytest.raises(error.ResetNeeded):
        unstable.step(np.zeros(2))


@pytest.mark.parametrize('action', [[np.nan, 0.0], [0.0], [[0.0, 0.0]], 'up', None])
def test_an_action_that_is_none_is_refused(action: object) -> None:
    env = fa.FlexArmEnv('fls_tip', duration=0.02)
    env.reset(seed=1)
    with pytest.raises(error.InvalidAction, match='allowed: two numbers'):
        env.step(action)
    assert env.step([0.0, 0.0])[4] == {'tick': 10}


def test_actions_beyond_the_limits_are_clipped_and_float32_is_taken() -> None:
    env = fa.FlexArmEnv('fls_tip', duration=0.2)
    seen = []
    for action in (np.ones(2), np.full(2, 9.0), np.ones(2, np.float32)):
        env.reset(seed=1)
        seen.append(env.step(action)[0].tolist())
    assert seen[0] == seen[1] == seen[2]
    assert env.action_space.contains(np.ones(2, np.float32))


@pytest.mark.parametrize(
    'first',
    [
        'import flexarm_ros, gymnasium',
        'import gymnasium, flexarm_ros',
        'import flexarm_ros.api.simulation; from gymnasium import register; import gymnasium',
        'import gymnasium; ID = "flexarm_ros:" + ID',
    ],
)
def test_the_ids_are_known_in_whatever_order_both_are_imported(first: str) -> None:
    code = (
        f'ID = {SQUARE!r}\n{first}\nenv = gymnasium.make(ID, duration=0.02, hold=5)\n'
        'env.reset(seed=1)\nprint(env.spec.id, env.step(env.action_space.sample())[4])'
    )
    told = subprocess.run(
        [sys.executable, '-W', 'error', '-c', code], capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == [SQUARE, "{'tick':", '5}']


def test_the_package_is_imported_without_gymnasium() -> None:
    code = (
        'import sys\nimport flexarm_ros\nassert "gymnasium" not in sys.modules\n'
        'sys.path[:] = [p for p in sys.path if "site-packages" not in p]\n'
        'try:\n    import gymnasium\nexcept ModuleNotFoundError as error:\n    print(error)'
    )
    told = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert told.stdout == "No module named 'gymnasium'\n"


@pytest.mark.parametrize('mode', ['sync', 'async'])
def test_environments_side_by_side(mode: str) -> None:
    many = gymnasium.make_vec(SQUARE, num_envs=2, vectorization_mode=mode, duration=0.02, **NOISY)
    try:
        seen, _ = many.reset(seed=3)
        alone = fa.FlexArmEnv('fls_tip', duration=0.02, **NOISY)
        assert [row.tolist() for row in seen] == [
            alone.reset(seed=seed)[0].tolist() for seed in (3, 4)
        ]
        ends = [many.step(np.zeros((2, 2)))[3].tolist() for _ in range(4)]
        # The third step begins the next episode, as Gymnasium's vector environments do.
        assert ends == [[False, False], [True, True], [False, False], [False, False]]
    finally:
        many.close()


def test_a_picture_of_the_arm() -> None:
    env = gymnasium.make(SQUARE, duration=0.1, hold=5, render_mode='rgb_array')
    env.reset(seed=1)
    first = env.render()
    assert first.shape == (480, 480, 3) and first.dtype == np.uint8
    assert env.metadata['render_fps'] == 200
    for _ in range(10):
        env.step(np.array([1.0, -1.0]))
    assert (env.render() != first).any() and env.render().std() > 0
    kept = gymnasium.make(SQUARE, duration=0.1, render_mode='rgb_array_list')
    kept.reset(seed=1)
    kept.step(np.zeros(2))
    assert len(kept.render()) == 2
    with pytest.warns(UserWarning, match='render_mode='):
        assert fa.FlexArmEnv(duration=0.1).render() is None


def test_a_spec_travels() -> None:
    spec = pickle.loads(pickle.dumps(gymnasium.spec(SQUARE)))
    env = gymnasium.make(spec, scenario='pd_tip', duration=0.05)
    assert env.unwrapped.spec.kwargs == {'scenario': 'pd_tip', 'duration': 0.05}


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
