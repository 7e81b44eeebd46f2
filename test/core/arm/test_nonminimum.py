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

"""The nonminimum-phase response: the tip starts the wrong way, as a beam without modes says."""

from __future__ import annotations

import math

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.parameters.sections import RunConfig, RunParameters
from flexarm_ros.core.run.make_plant import make_plant
import numpy as np
import pytest
from validation.motion import full_plant
from validation.nonminimum_phase import (
    exact_real_zero,
    first_real_zero,
    held,
    paper_misfit,
    reversal,
    right_half_zeros,
    step_response,
    WAVE_SPEED,
)


@pytest.mark.parametrize('hub', [0.0, 8.0])
@pytest.mark.parametrize('location', [4.5, 6.75, 9.0])
def test_the_lowest_real_zero_is_that_of_the_beam(hub: float, location: float) -> None:
    exact = exact_real_zero(location)
    assert first_real_zero(held(hub), location) == pytest.approx(exact, rel=0.01)
    assert first_real_zero(held(hub, 4), location) == pytest.approx(exact, rel=0.04)


def test_zeros_are_zeros() -> None:
    """The transfer function vanishes there, and not near by."""
    arm = held(8.0, 4)
    state, force = arm.state_space()
    size = len(arm.mass)
    row = np.concatenate([arm.point(9.0)[1], np.zeros(size)])

    def transfer(s: complex) -> float:
        solved = np.linalg.solve(s * np.eye(2 * size) - state, force[:, 0])
        return abs(complex(row @ solved))

    for zero in right_half_zeros(arm, 9.0)[:3]:
        assert transfer(zero) < 1e-6 * transfer(1.05 * zero)


def test_the_reversal_grows_and_lasts_longer_towards_the_tip() -> None:
    arm = held(8.0)
    found = [reversal(arm, location, 1e-4) for location in (4.5, 6.0, 7.5, 9.0)]
    assert all(one.depth > two.depth for one, two in zip(found, found[1:], strict=False))
    assert all(one.time < two.time for one, two in zip(found, found[1:], strict=False))
    assert found[-1].depth < -1e-3
    zeros = [first_real_zero(arm, location) for location in (4.5, 6.0, 7.5, 9.0)]
    assert zeros == sorted(zeros, reverse=True)


def test_the_papers_delay_is_far_too_short() -> None:
    for hub in (0.0, 8.0):
        assert reversal(held(hub), 9.0, 1e-4).time > 8.0 * 9.0 / WAVE_SPEED
        late, prompt = paper_misfit(hub, 9.0, 0.3)
        assert late > 1.0
        assert prompt > 1.0


def test_the_plant_itself_responds_as_the_linear_arm() -> None:
    """The integrated full model, elbow held by an inertia, a small step of torque."""
    plant = full_plant(modes=4, hub_inertia=(8.0, 1e6), initial_position=(0.0, 0.0))
    run = RunParameters(control_period=1e-3, duration=1.0)
    arm = make_plant(RunConfig(run=run, plant=plant))
    tip, heights = make_point(plant, 9.0, True), []
    for _ in range(301):
        heights.append(tip(arm.q, arm.qd)[1])
        arm.step(1e-3, 0.0)
    expected = 1e-3 * step_response(held(8.0, 6), 9.0, 1e-3 * np.arange(301))
    assert min(heights) < 0.0
    assert np.array(heights) == pytest.approx(expected, abs=0.01 * np.abs(expected).max())
    assert math.isfinite(heights[-1])
