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

"""Numbers at their limits: refused with one line, or flown to an end that is told as it is."""

from __future__ import annotations

import math
import re

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, specs
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.parts import recorded_roles
from flexarm_ros.scenario import ScenarioError
from hypothesis import given, settings
from hypothesis import strategies as st
import pytest

TICKS = 5
EXTREMES = ('0', '5e-324', '1e-308', '1e-300', '1e-12', '1e300', '1e308', '-1e308', '-0.0')
KEYS = [
    (f'{section}.{key}', spec)
    for section in recorded_roles(RunConfig())
    for key, (_, spec, _) in specs(SECTIONS[section]).items()
    if spec.kind in ('float', 'float2')
]


def fly(*overrides: str, ticks: int = TICKS) -> ClosedLoop:
    """Fly some ticks; what was recorded before the end is finite and within bounds."""
    config = scenario.load('fls_tip', [f'duration={ticks / 1000}', *overrides])
    loop = ClosedLoop(config)
    while (record := loop.tick()) is not None:
        assert all(math.isfinite(v) for v in (*record.q, *record.qd, *record.deflections))
        ends = record.deflections[:2]
        assert all(abs(d) <= most for d, most in zip(ends, loop.plant.limits, strict=True))
    return loop


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from(KEYS),
    st.sampled_from(EXTREMES) | st.just('low') | st.just('high'),
    st.sampled_from(('eq14', 'full')),
)
def test_a_parameter_at_its_limits(case: tuple[str, object], value: str, model: str) -> None:
    key, spec = case
    if value in ('low', 'high'):
        bound = getattr(spec, value)
        value = '0' if bound is None else repr(float(bound))
    text = f'[{value}, {value}]' if spec.kind == 'float2' else value
    try:
        loop = fly(f'plant.model={model}', f'{key}={text}')
    except (ScenarioError, ValueError) as error:
        assert re.search(r'[a-z_*]+\.[a-z_]+', str(error)), str(
            error
        )  # the key, or one it decides
        assert '\n' not in str(error)
        return
    assert loop.unstable is not None or loop.k == TICKS


@pytest.mark.parametrize('law', ['pd', 'fls'])
def test_a_blow_up_ends_the_run_at_its_tick(law: str) -> None:
    """A torque that bends the arm beyond all measure within one tick is told at the next."""
    loop = fly(f'controller.law={law}', 'controller.kp=1e9', 'controller.kd=1e9',
               'controller.ks=1e6')  # fmt: skip
    assert loop.unstable_tick == 1
    assert loop.unstable is not None
    assert loop.unstable.startswith('deflection of link1: ')


EDGE = 9.0 * math.sqrt(2.0)
"""Side of the square whose corners are as far from the shoulder as the arm is long."""


@pytest.mark.parametrize('side', [EDGE, math.nextafter(EDGE, 0.0), EDGE - 1e-9])
@pytest.mark.parametrize('law', ['pd', 'fls'])
def test_a_square_that_touches_the_edge_of_the_workspace(side: float, law: str) -> None:
    """At a corner the arm is straight and the Jacobian singular; the start is one."""
    loop = fly(f'controller.law={law}', f'trajectory.side={side!r}', 'trajectory.side_time=0.1',
               ticks=401)  # fmt: skip
    assert loop.unstable is not None or loop.k == 401


def test_a_square_beyond_the_workspace_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r'trajectory\.side'):
        fly(f'trajectory.side={EDGE + 1e-6!r}')


@pytest.mark.parametrize('elbow', [0.0, math.pi, -math.pi, 1e-300])
def test_a_straight_or_folded_arm(elbow: float) -> None:
    loop = fly(f'plant.initial_position=[0.3, {elbow!r}]', ticks=50)
    assert loop.unstable is not None or loop.k == 50
