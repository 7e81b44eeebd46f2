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

"""Sweep files: what is flown, in which order, with which values; and their errors."""

from __future__ import annotations

from pathlib import Path

from flexarm_ros import scenario
from flexarm_ros.scenario import ScenarioError, with_values
from flexarm_ros.scenario.sweeps import sweep
import pytest

HERE = Path(__file__).parent


def read(text: str) -> sweep.Sweep:
    return sweep.from_text(text, 's', HERE)


def values(text: str, name: str) -> list[str]:
    made = read(text)
    return [made.case(index).values[name] for index in range(made.count)]


def grid(axis: str) -> str:
    return f'{{scenario: fls_tip, grid: {{{axis}}}}}'


def drawn(how: str, count: int = 50, seed: int = 1) -> str:
    return f'{{scenario: fls_tip, draw: {{count: {count}, seed: {seed}, parameters: {{{how}}}}}}}'


def test_scenarios_run_slowest_then_the_axes_then_the_draws() -> None:
    made = read(
        'scenario: [pd_tip, fls_tip]\n'
        'set: {duration: 2}\n'
        'grid: {controller.kp: [100, 150], plant.modes: [1, 2]}\n'
        'draw: {count: 3, parameters: {seed: {integers: [0, 9]}}}\n'
    )
    cases = [made.case(index) for index in range(made.count)]
    assert made.count == 2 * 2 * 2 * 3
    seeds = [case.values['seed'] for case in cases[:3]]
    assert [tuple(case.values.values()) for case in cases] == [
        (name, kp, modes, seed)
        for name in ('pd_tip', 'fls_tip')
        for kp in ('100', '150')
        for modes in ('1', '2')
        for seed in seeds
    ]
    config = with_values(made.bases[cases[-1].base], cases[-1].overrides)
    assert (config.controller.law, config.controller.kp, config.plant.modes) == ('fls', 150.0, 2)
    assert (config.run.duration, config.run.seed) == (2.0, int(seeds[-1]))


@pytest.mark.parametrize(
    ('axis', 'name', 'wanted'),
    [
        ('controller.kp: {from: 0, to: 1, count: 11}', 'controller.kp',
         ['0.0', '0.1', '0.2', '0.3', '0.4', '0.5', '0.6', '0.7', '0.8', '0.9', '1.0']),
        ('controller.kp: {from: 0.1, to: 0.35, step: 0.1}', 'controller.kp',
         ['0.1', '0.2', '0.3']),
        ('controller.kp: {from: 3, to: 1, step: -1}', 'controller.kp', ['3.0', '2.0', '1.0']),
        ('controller.kp: {from: 1, to: 100, count: 3, scale: log}', 'controller.kp',
         ['1.0', '10.0', '100.0']),
        ('plant.modes: {from: 1, to: 6, step: 2}', 'plant.modes', ['1', '3', '5']),
        ('tip_sensor.latency: {from: 0, to: 0.01, count: 4}', 'tip_sensor.latency',
         ['0.0', '0.003333333', '0.006666667', '0.01']),
        ('controller.law: [pd, fls]', 'controller.law', ['pd', 'fls']),
        ('/**.duration: [1e-1, 2]', 'duration', ['1e-1', '2']),
    ],
)  # fmt: skip
def test_axes_are_listed_or_in_even_steps(axis: str, name: str, wanted: list[str]) -> None:
    assert values(grid(axis), name) == wanted


def test_one_number_stands_for_both_joints() -> None:
    made = read(grid('plant.hub_inertia: [4, [4, 8]]'))
    configs = [with_values(made.bases[0], made.case(i).overrides) for i in (0, 1)]
    assert [config.plant.hub_inertia for config in configs] == [(4.0, 4.0), (4.0, 8.0)]


def test_a_tied_key_follows_the_swept_one() -> None:
    made = read(
        '{scenario: fls_tip, grid: {tip_sensor.latency: [0, 0.001238]},'
        ' tie: {trajectory.delay: tip_sensor.latency}}'
    )
    config = with_values(made.bases[0], made.case(1).overrides)
    assert config.trajectory.delay == config.tip_sensor.latency == 0.001238


@pytest.mark.parametrize(
    ('how', 'name', 'low', 'high'),
    [
        ('controller.kp: {uniform: [100, 200]}', 'controller.kp', 100, 200),
        ('controller.kp: {loguniform: [1, 1000]}', 'controller.kp', 1, 1000),
        ('controller.kp: {factor: [0.9, 1.1]}', 'controller.kp', 150.79 * 0.9, 150.79 * 1.1),
        ('plant.flexural_rigidity: {factor: [0.5, 1.5]}', 'plant.flexural_rigidity', 838, 2514),
        ('seed: {integers: [3, 5]}', 'seed', 3, 5),
    ],
)  # fmt: skip
def test_draws_stay_within_their_bounds_and_fill_them(
    how: str, name: str, low: float, high: float
) -> None:
    texts = values(drawn(how, 400), name)
    numbers = [float(text.strip('[]').split(',')[0]) for text in texts]
    assert low <= min(numbers) <= low + (high - low) * 0.05
    assert high - (high - low) * 0.05 <= max(numbers) <= high


def test_normal_draws_have_the_mean_and_deviation_asked_for() -> None:
    numbers = [float(x) for x in values(drawn('controller.kp: {normal: [150, 5]}', 4000),
                                        'controller.kp')]  # fmt: skip
    mean = sum(numbers) / len(numbers)
    deviation = (sum((x - mean) ** 2 for x in numbers) / len(numbers)) ** 0.5
    # Four standard errors: 5 / sqrt(4000) of the mean, 5 / sqrt(8000) of the deviation.
    assert abs(mean - 150) < 4 * 5 / 4000**0.5
    assert abs(deviation - 5) < 4 * 5 / 8000**0.5


def test_draws_depend_on_the_seed_and_their_own_name_only() -> None:
    one = drawn('controller.kp: {uniform: [1, 2]}')
    both = drawn('controller.kd: {uniform: [1, 2]}, controller.kp: {uniform: [1, 2]}')
    assert values(one, 'controller.kp') == values(both, 'controller.kp')
    assert values(both, 'controller.kd') != values(both, 'controller.kp')
    other = drawn('controller.kp: {uniform: [1, 2]}', seed=2)
    assert values(one, 'controller.kp') != values(other, 'controller.kp')


def test_drawn_times_are_whole_nanoseconds() -> None:
    made = read(drawn('tip_sensor.latency: {uniform: [0, 0.01]}'))
    for index in range(made.count):
        config = with_values(made.bases[0], made.case(index).overrides)
        assert config.tip_sensor.latency == float(made.case(index).values['tip_sensor.latency'])


def test_joints_are_drawn_together_or_each_on_its_own() -> None:
    together = values(drawn('plant.length: {uniform: [4, 5]}'), 'plant.length')
    apart = values(drawn('plant.length: {uniform: [4, 5], independent: true}'), 'plant.length')
    assert all(not text.startswith('[') for text in together)
    pairs = [text.strip('[]').split(', ') for text in apart]
    assert all(len(pair) == 2 and pair[0] != pair[1] for pair in pairs)


def test_the_digest_changes_with_whatever_decides_the_results() -> None:
    text = drawn('controller.kp: {uniform: [1, 2]}')
    digests = {
        read(changed).digest()
        for changed in (
            text,
            text.replace('seed: 1', 'seed: 2'),
            text.replace('fls_tip', 'pd_tip'),
            text.replace('count: 50', 'count: 51'),
            text.replace('scenario:', 'set: {controller.kd: 1}, scenario:'),
        )
    }
    assert len(digests) == 5
    assert read(text).digest() in digests


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('', ['empty']),
        ('[]', ['sweep', 'not a map']),
        ('{grid: {}}', ['scenario: missing']),
        ('{scenario: fls_tip}', ['grid: missing', 'draw']),
        ('{scenario: [], grid: {}}', ['scenario: none']),
        ('{scenario: [fls_tip, fls_tip], grid: {}}', ["'fls_tip'", 'twice']),
        ('{scenario: fls_tp, grid: {}}', ['fls_tp', "did you mean 'fls_tip'"]),
        ('{scenario: fls_tip, grid: {}, gird: {}}', ["'gird'", "'grid'"]),
        ('{scenario: fls_tip, set: {plant.modes: 9}, grid: {}}', ['plant.modes', 'at most 6']),
        (grid('plant.mods: [1]'), ['plant.mods', "'plant.modes'"]),
        (grid('plant.modes: [1, 9]'), ['grid.plant.modes[1]', '9', 'at most 6']),
        (grid('plant.modes: []'), ['grid.plant.modes', '0 values']),
        (grid('plant.modes: {from: 5, to: 7, step: 1}'), ['grid.plant.modes[2]', '7']),
        (grid('controller.kp: {from: 1}'), ['grid.controller.kp', 'count or step']),
        (grid('controller.kp: {from: 1, to: 2, step: 0}'), ['controller.kp.step', '0']),
        (grid('controller.kp: {from: 1, to: 2, step: -1}'), ['controller.kp.step', '-1']),
        (grid('controller.kp: {from: 1, to: 2, step: 1e-9}'), ['controller.kp.step', '100000']),
        (grid('controller.kp: {from: 1, to: 2, count: 1e9}'), ['controller.kp.count', '1e9']),
        (grid('controller.kp: {from: 0, to: 2, count: 3, scale: log}'), ['above 0']),
        (grid('controller.kp: {from: 0, to: 2, count: 3, scale: sqrt}'), ['scale', "'sqrt'"]),
        (grid('controller.law: {from: 0, to: 2, count: 3}'), ['controller.law', 'not a number']),
        (drawn('controller.kp: {uniform: [2, 1]}'), ['controller.kp.uniform', '[low, high]']),
        (drawn('controller.kp: {uniform: [1]}'), ['controller.kp.uniform', 'two']),
        (drawn('controller.kp: {uniform: [.nan, 1]}'), ['controller.kp.uniform', 'finite']),
        (drawn('controller.kp: {loguniform: [0, 1]}'), ['loguniform', 'above 0']),
        (drawn('controller.kp: {normal: [0, -1]}'), ['normal', '-1']),
        (drawn('controller.kp: {gauss: [0, 1]}'), ["'gauss'", 'uniform']),
        (drawn('controller.kp: {}'), ['exactly one']),
        (drawn('seed: {integers: [0.5, 1]}'), ['integers', '0.5']),
        (drawn('controller.law: {uniform: [0, 1]}'), ['controller.law', 'not a number']),
        (drawn('plant.initial_velocity: {factor: [0, 1]}'), ['initial_velocity', 'multiply']),
        (drawn('controller.kp: {uniform: [1, 2], independent: true}'), ['independent']),
        (drawn('', 5), ['draw.parameters: none']),
        (drawn('seed: {integers: [0, 1]}', 0), ['draw.count', '0']),
        (grid('plant.modes: [1]')[:-1] + ', tie: {controller.kp: controller.kd}}',
         ['tie.controller.kp', "'controller.kd'"]),
        (grid('plant.modes: [1]')[:-1] + ', map: {x: controller.kp}}', ['map.x', 'controller.kp']),
        (grid('plant.modes: [1]')[:-1] + ', map: {x: plant.modes, value: rmse}}',
         ['map.value', "'rmse'"]),
        (grid('plant.modes: [1]')[:-1] + ', map: {x: plant.modes, value: complete}}',
         ["'complete'"]),
    ],
)  # fmt: skip
def test_an_error_names_where_it_is(text: str, words: list[str]) -> None:
    with pytest.raises(ScenarioError) as caught:
        read(text)
    found = str(caught.value)
    assert '\n' not in found
    assert not [word for word in words if word not in found], found


@pytest.mark.parametrize('name', sorted(scenario.shipped_sweeps()))
def test_the_shipped_sweeps_can_be_read(name: str) -> None:
    made = sweep.load(name)
    assert made.description
    for index in {0, made.count - 1}:
        with_values(made.bases[made.case(index).base], made.case(index).overrides)
