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

"""The full model against another multibody code; the long motions are slow."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from validation.cases import CASES
from validation.motion import compare, Difference, fly, full_plant

REASON = 'exudyn has wheels for x86_64 only'
exudyn_arm = pytest.importorskip('validation.exudyn_arm', reason=REASON)
another_code = pytest.importorskip('validation.another_code', reason=REASON)
joints = pytest.importorskip('validation.joints', reason=REASON)


@cache
def solved(name: str, mesh: object, duration: float) -> np.ndarray:
    return exudyn_arm.solve(replace(CASES[name], duration=duration), mesh)


def difference(name: str, mesh: object, duration: float) -> Difference:
    case, reference = replace(CASES[name], duration=duration), solved(name, mesh, duration)
    assert len(reference) == round(duration / exudyn_arm.EVERY) + 1
    motion = fly(full_plant(modes=4, payload_mass=case.payload), case, every=20)
    # The two do move, and as far as the case is meant to.
    assert np.ptp(reference[:, 1]) > 0.05
    return compare(motion[: len(reference)], reference)


def judge(found: Difference) -> None:
    assert max(found.angles) < another_code.LIMIT
    assert found.tip_of_range < another_code.LIMIT
    assert found.tip < another_code.TIP_LIMIT


@pytest.mark.parametrize(
    ('name', 'duration'),
    [('shoulder_pulse', 3.0), ('pulses_both', 2.0), ('free_bent', 2.0), ('payload_pulse', 1.5)],
)
def test_pulses_and_free_flight(name: str, duration: float) -> None:
    """Deflections up to 4.6 % of the length; on a mesh that is coarse but fine enough for 1 %."""
    judge(difference(name, exudyn_arm.COARSE, duration))


@pytest.mark.slow
@pytest.mark.parametrize('name', ['torques_both', 'torques_opposed', 'free_bent'])
def test_five_seconds(name: str) -> None:
    judge(difference(name, exudyn_arm.FINE, 5.0))


def test_the_comparison_would_see_a_stiffness_wrong_by_a_tenth() -> None:
    case = CASES['shoulder_pulse']
    reference = solved('shoulder_pulse', exudyn_arm.COARSE, 3.0)
    plant = full_plant(modes=4, flexural_rigidity=(1.1 * 1676.0, 1.1 * 1676.0))
    found = compare(fly(plant, case, every=20)[: len(reference)], reference)
    assert max(found.angles) > another_code.LIMIT


@cache
def bench_motion(case: str) -> np.ndarray:
    return joints.solve(replace(joints.ARM, **joints.CASES[case]), joints.QUICK)


@pytest.mark.parametrize('case', joints.CASES)
def test_friction_and_rigid_parts(case: str) -> None:
    """
    Angles and curvatures within 0.1 % of their ranges.

    With steps of 0.2 ms, found were at most 0.054 %.  Half the step changes the differences by
    at most 0.03 %, twice the elements by 0.003 %, three or six modes in place of four by 0.01 %; a
    zone of Coulomb friction four times as wide by 0.1 %.
    """
    plant, motion = replace(joints.ARM, **joints.CASES[case]), bench_motion(case)
    assert joints.differences(plant, motion, joints.QUICK).max() < joints.LIMIT
    # Without friction or rigid parts the angles are far off.
    assert joints.differences(joints.ARM, motion, joints.QUICK)[:2].min() > 100.0 * joints.LIMIT


@pytest.mark.parametrize(
    'key', ['hub_radius', 'end_offset', 'viscous_friction', 'coulomb_friction']
)
def test_the_comparison_would_see_a_key_wrong_by_two_percent(key: str) -> None:
    plant = replace(joints.ARM, **joints.CASES['all three'])
    wrong = replace(plant, **{key: tuple(1.02 * value for value in getattr(plant, key))})
    found = joints.differences(wrong, bench_motion('all three'), joints.QUICK)
    assert found.max() > 2.0 * joints.LIMIT
