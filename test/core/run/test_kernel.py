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

"""The kernel over blocks of ticks against the loop tick by tick: every bit is the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import itertools

from flexarm_ros import scenario
from flexarm_ros.core.control import PLANNING
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.sections import keys, RunConfig, SECTIONS
from flexarm_ros.core.parameters.spec import Spec
from flexarm_ros.core.run.kernel import Kernel
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks, single_ticks
from flexarm_ros.scenario import locate
import pytest

SIZES = (1, 2, 60, 128)
SHORT = 'duration=0.25'
NOISE = (
    'encoder.noise_std=1e-4', 'encoder.resolution=1e-3', 'encoder.latency=2.5e-3',
    'tip_sensor.noise_std=1e-4', 'tip_sensor.rate=500',
)  # fmt: skip


def config(name: str, *settings: str, changes: Sequence[Change] = ()) -> RunConfig:
    return replace(scenario.load(name, [SHORT, *settings]), changes=tuple(changes))


def fly_both(of: RunConfig) -> ClosedLoop:
    """Compare blocks of different sizes with single ticks, and what is left of both loops."""
    fast, slow = ClosedLoop(of), ClosedLoop(of)
    kernel = Kernel.of(fast)
    assert kernel is not None
    for size in itertools.cycle(SIZES):
        block = kernel.block(size)
        ticks = single_ticks(slow, len(block))
        assert block.first == ticks.first
        if not len(block):
            break
        for mine, theirs in zip(
            (*block.stamps, *block.values), (*ticks.stamps, *ticks.values), strict=True
        ):
            assert mine.shape == theirs.shape
            assert mine.tobytes() == theirs.tobytes()
        assert repr(fast.law.gain) == repr(slow.law.gain)
        assert (fast.k, fast.config) == (slow.k, slow.config)
        assert repr(fast.torque) == repr(slow.torque)  # nan too
        if fast.unstable is None:
            assert fast.plant.q.tobytes() == slow.plant.q.tobytes()
    assert slow.tick() is None
    assert (fast.unstable, fast.unstable_tick) == (slow.unstable, slow.unstable_tick)
    return fast


@pytest.mark.parametrize('name', locate.shipped())
def test_a_shipped_case(name: str) -> None:
    of = config(name)
    if of.controller.law in PLANNING or of.further:
        assert Kernel.of(ClosedLoop(of)) is None
    else:
        fly_both(of)


GENTLE = 'controller.kp=20', 'controller.kd=2', 'controller.ks=2'  # stable with such delays
CHANNEL = (
    *GENTLE, 'tip_sensor.jitter=0.003', 'encoder.jitter=0.0021', 'encoder.dropout=0.05',
    'tip_sensor.dropout=0.2', 'tip_sensor.dropout_burst=3',
)  # fmt: skip
OTHER = (
    'tip_sensor.jitter_distribution=exponential', 'encoder.jitter_distribution=normal',
    'tip_sensor.arrival=in_order', 'seed=3',
)  # fmt: skip
FEATURES = {
    'noise, rate, resolution, fractional latency': ('fls_tip', *NOISE),
    'noise at every tick': ('fls_tip', *NOISE, 'tip_sensor.rate=0'),
    'pade2': ('pd_tip', 'tip_sensor.latency_model=pade2', *NOISE),
    'pade2 without latency': (
        'pd_tip', 'tip_sensor.latency_model=pade2', 'tip_sensor.latency=0'
    ),
    'elastic point': ('fls_tip', 'tip_sensor.measurand=elastic', 'duration=0.08'),
    'elastic point of full': (
        'fls_full', 'tip_sensor.measurand=elastic', 'plant.modes=2', 'duration=0.08'
    ),
    'joint rates': ('fls_mid', 'controller.velocity_source=encoder'),
    'collocated': ('pd_tip', 'controller.feedback=encoder', *NOISE),
    'torque limit': ('fls_tip', 'controller.torque_limit=20'),
    'torque limit in open loop': ('open_loop', 'controller.torque_limit=0.5'),
    'smooth square': (
        'fls_tip', 'trajectory.time_law=smooth', 'trajectory.side_time=0.2', 'trajectory.side=2.0'
    ),
    'delayed way points': (
        'fls_tip', 'trajectory.kind=waypoints', 'trajectory.waypoint_times=[0, 0.02, 0.05, 0.1]',
        'trajectory.waypoint_x=[5, 5.1, 5.1, 5]', 'trajectory.waypoint_y=[2, 2, 2.1, 2]',
        'trajectory.delay=0.0015',
    ),
    'hold': ('pd_tip', 'trajectory.kind=hold'),
    'odd period': ('fls_tip', 'control_period=0.0007', 'duration=0.21'),
    'rates': (
        'fls_tip', *NOISE, 'encoder.rate=250', 'tip_sensor.rate=200', 'controller.rate=500'
    ),
    'rates with latencies of many samples': (
        'fls_mid', 'encoder.rate=500', 'tip_sensor.rate=200', 'tip_sensor.latency=0.0123',
        'encoder.latency=0.0075', 'controller.velocity_source=encoder',
    ),
    'computation of several ticks': ('pd_tip', 'controller.compute_delay=0.0035', *NOISE),
    'rate and computation': (
        'fls_tip', 'controller.rate=500', 'controller.compute_delay=0.007', *NOISE, *GENTLE
    ),
    'rate of an open loop': (
        'open_loop', 'controller.rate=100', 'controller.compute_delay=0.003'
    ),
    'uniform jitter': ('fls_tip', *CHANNEL, *NOISE),
    'exponential jitter': ('fls_tip', *CHANNEL, *NOISE, *OTHER),
    'jitter, loss and rates': (
        'fls_tip', *CHANNEL, *NOISE, *OTHER, 'encoder.rate=500', 'tip_sensor.rate=250',
        'controller.rate=500', 'controller.compute_delay=0.0025',
    ),
    'measured latencies': (
        'fls_tip', 'tip_sensor.latencies=[0.001, 0.0135, 0.004, 0.0]', 'encoder.dropout=0.3',
        *NOISE,
    ),
    'everything lost': ('fls_tip', 'tip_sensor.dropout=1.0', 'duration=0.02'),
    'jitter of full': ('fls_full', *CHANNEL, *NOISE, 'duration=0.08'),
    'clock rate': ('fls_tip', 'clock_rate=100'),
    'six modes of full': ('pd_full', 'plant.modes=6', 'duration=0.05'),
}  # fmt: skip


@pytest.mark.parametrize('feature', FEATURES)
def test_a_feature(feature: str) -> None:
    assert fly_both(config(*FEATURES[feature])).unstable is None


LIVE = (
    Change(30, 'tip_sensor', 'latency', 0.0015),
    Change(30, 'tip_sensor', 'noise_std', 0.01),
    Change(31, 'controller', 'kp', 120.0),
    Change(90, 'controller', 'kn', 2.0),
    Change(97, 'encoder', 'latency', 0.0),
    Change(97, 'encoder', 'noise_std', 0.0),
    Change(110, 'trajectory', 'delay', 0.004),
    Change(180, 'tip_sensor', 'noise_std', 0.0),
)


@pytest.mark.parametrize('model', ['buffer', 'pade2'])
def test_live_changes(model: str) -> None:
    of = config('fls_tip', *NOISE, f'tip_sensor.latency_model={model}', changes=LIVE)
    loop = fly_both(of)
    assert loop.config.controller.kn == 2.0
    assert loop.k == 250


def test_blocks_and_single_ticks_may_alternate() -> None:
    of = config('fls_tip', *NOISE, changes=LIVE)
    mixed, slow = ClosedLoop(of), ClosedLoop(of)
    kernel = Kernel.of(mixed)
    assert kernel is not None
    while mixed.k < 250 and mixed.unstable is None:
        kernel.block(7)
        mixed.tick()
    while slow.tick() is not None:
        pass
    assert mixed.plant.q.tobytes() == slow.plant.q.tobytes()
    assert mixed.torque == slow.torque


@pytest.mark.parametrize('model', ['eq14', 'full'])
def test_an_unstable_run_ends_at_the_same_tick(model: str) -> None:
    hubs = ('plant.hub_inertia=[0.0, 0.0]', 'plant.substeps=4', f'plant.model={model}')
    loop = fly_both(config('pd_tip', *hubs))
    assert loop.unstable is not None
    assert loop.unstable_tick == loop.k > 1
    assert not len(next(loop_blocks(loop), ()))


def test_a_torque_that_is_not_finite_ends_the_run_behind_its_tick() -> None:
    huge = Change(70, 'controller', 'kp', float('inf'))
    loop = fly_both(config('pd_tip', changes=[huge]))
    assert 'controller (pd): tick 70: torque at the ' in str(loop.unstable)
    assert (loop.unstable_tick, loop.k) == (71, 71)


def test_an_initially_unstable_arm_has_no_tick() -> None:
    loop = fly_both(config('pd_tip', 'plant.deflection_limit=[1e-300, 1e-300]'))
    assert loop.k == loop.unstable_tick


def test_what_the_kernel_does_not_know_runs_tick_by_tick() -> None:
    of = config('fls_tip', 'tip_sensor.more_locations=[5.0]')
    assert Kernel.of(ClosedLoop(of)) is None
    assert sum(len(block) for block in loop_blocks(ClosedLoop(of))) == 250


CHANNEL_CHANGES = (
    Change(30, 'tip_sensor', 'jitter', 0.003),
    Change(33, 'tip_sensor', 'latency', 0.0074),
    Change(40, 'encoder', 'dropout', 0.4),
    Change(77, 'tip_sensor', 'jitter', 0.0),
    Change(130, 'encoder', 'jitter', 0.001),
)


@pytest.mark.parametrize('first', [(), CHANNEL, ('encoder.rate=500', 'controller.rate=500')])
def test_channels_that_change_on_the_way(first: tuple[str, ...]) -> None:
    fly_both(config('fls_tip', *NOISE, *first, changes=CHANNEL_CHANGES))


def test_blocks_and_single_ticks_may_alternate_with_samples_under_way() -> None:
    of = config(
        'fls_tip', *CHANNEL, *NOISE, 'controller.rate=500', 'controller.compute_delay=0.003',
        changes=CHANNEL_CHANGES,
    )  # fmt: skip
    mixed, slow = ClosedLoop(of), ClosedLoop(of)
    kernel = Kernel.of(mixed)
    assert kernel is not None
    while mixed.k < 250 and mixed.unstable is None:
        kernel.block(7)
        mixed.tick()
    while slow.tick() is not None:
        pass
    assert mixed.plant.q.tobytes() == slow.plant.q.tobytes()
    assert mixed.torque == slow.torque


def test_a_subclass_of_a_known_part_runs_tick_by_tick() -> None:
    loop = ClosedLoop(config('fls_tip'))
    assert Kernel.of(loop) is not None
    loop.law.__class__ = type('Mine', (type(loop.law),), {})
    assert Kernel.of(loop) is None


def other_values(spec: Spec, default: object) -> list[str]:
    """Return values of a key, as text, one of which should suit a scenario."""
    if spec.kind == 'bool':
        return ['false' if default else 'true']
    if spec.choices:
        return [choice for choice in spec.choices if choice not in (default, *PLANNING)]
    if spec.kind == 'int':
        return [str(value) for value in (2, 3, 40) if value != default]
    known = default[0] if isinstance(default, tuple) else default
    scaled = [1.25 * known] if isinstance(known, float) and known else []
    numbers = [repr(value) for value in (*scaled, 0.002, 0.5, 6.0, 125.0)]
    if spec.kind == 'float2':
        return [f'[{number}, {number}]' for number in numbers]
    return [f'[{number}]' for number in numbers] if spec.kind == 'floats' else numbers


ALL_KEYS = [(section, key) for section in SECTIONS for key in keys(section)]
TOGETHER = {
    *('waypoint_times', 'waypoint_x', 'waypoint_y', 'torque_file', 'force_file', 'force_times'),
    *('force_x', 'force_y', 'payload_file', 'payload_times', 'payload_masses', 'latency_file'),
    'deflection_source',
}
"""Keys that mean nothing alone; `FEATURES` has them."""


@pytest.mark.parametrize(('section', 'key'), ALL_KEYS)
def test_no_key_is_forgotten(section: str, key: str) -> None:
    """A key that the kernel does not know must keep the run from it, whoever adds the key."""
    _, spec, default = keys(section)[key]
    tried = 0
    for value in other_values(spec, default):
        settings = [*NOISE, 'duration=0.05', f'{section}.{key}={value}']
        try:
            of = config('fls_tip', *settings)
        except scenario.ScenarioError:
            continue
        tried += 1
        if tried > 2:
            break
        if Kernel.of(ClosedLoop(of)) is not None:
            fly_both(of)
            if spec.live:
                change = Change(13, section, key, float(value))
                fly_both(config('fls_tip', *NOISE, 'duration=0.05', changes=[change]))
    assert tried or key in TOGETHER
