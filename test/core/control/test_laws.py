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

"""Control laws against formulas written out, and what they are given."""

from __future__ import annotations

from dataclasses import replace
import math

from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.control import BUILT_IN, gain_of, make_law, Sample
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.parameters.sections import (
    ControllerParameters,
    PlantParameters,
    RunConfig,
    TipSensorParameters,
)
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

LENGTHS = (4.0, 5.0)
Q, QD = (0.4, 1.1, 0.3, -0.2), (0.7, -0.5, 0.1, 0.2)
ENCODER = (0.38, 1.12, 0.69, -0.45)
TIP = (1.5, 6.0, -2.0, 1.0)
REFERENCE = (1.0, 6.5, 0.5, -0.5)
SAMPLE = Sample(Q, QD, (0.2, -0.4), ENCODER, TIP, REFERENCE)


def config(location: float = 9.0, **keys) -> RunConfig:
    return RunConfig(
        plant=PlantParameters(length=LENGTHS),
        tip_sensor=TipSensorParameters(location=location),
        controller=ControllerParameters(**keys),
    )


def tip_of(angles) -> np.ndarray:
    a, b, da, db = angles
    (l1, l2), c = LENGTHS, a + b
    x, y = l1 * math.cos(a) + l2 * math.cos(c), l1 * math.sin(a) + l2 * math.sin(c)
    jac = np.array([[-y, -l2 * math.sin(c)], [x, l2 * math.cos(c)]])
    return np.concatenate([[x, y], jac @ [da, db]])


def equation_20(tip: np.ndarray, kp: float = 150.79, kd: float = 17.364) -> np.ndarray:
    """J^T [Kp e + Kd e'] with J at the undelayed angles."""
    error = np.array(REFERENCE) - tip
    (l1, l2), c = LENGTHS, Q[0] + Q[1]
    jac = np.array(
        [
            [-l1 * math.sin(Q[0]) - l2 * math.sin(c), -l2 * math.sin(c)],
            [l1 * math.cos(Q[0]) + l2 * math.cos(c), l2 * math.cos(c)],
        ]
    )
    return jac.T @ (kp * error[:2] + kd * error[2:])


def torque(scenario: RunConfig, sample: Sample = SAMPLE) -> tuple[float, float]:
    return make_law(scenario).torque(0, sample)


def test_pd_is_equation_20() -> None:
    assert torque(config(law='pd')) == pytest.approx(equation_20(np.array(TIP)))
    collocated = torque(config(law='pd', feedback='encoder'))
    assert collocated == pytest.approx(equation_20(tip_of(ENCODER)))
    gains = torque(config(law='pd', kp=3.0, kd=0.5))
    assert gains == pytest.approx(equation_20(np.array(TIP), 3.0, 0.5))


@pytest.mark.parametrize('feedback', ['encoder', 'tip_sensor'])
def test_velocity_from_the_undelayed_joint_rates(feedback: str) -> None:
    tip = np.array(TIP) if feedback == 'tip_sensor' else tip_of(ENCODER)
    tip[2:] = tip_of((*Q[:2], *QD[:2]))[2:]
    found = torque(config(law='pd', feedback=feedback, velocity_source='encoder'))
    assert found == pytest.approx(equation_20(tip))


def test_fls_is_equation_21() -> None:
    law = make_law(config(law='fls'))
    gain = fls_lambda(0.2 / 5.0, -0.4 / 5.0)
    assert law.torque(0, SAMPLE) == pytest.approx(15.0 * gain * equation_20(np.array(TIP)))
    assert law.gain == gain == gain_of(config(law='fls'), 0.2, -0.4)
    assert law.gain > fls_lambda(0.0, 0.0)


def test_pd_has_no_gain() -> None:
    law = make_law(config(law='pd'))
    law.torque(0, SAMPLE)
    assert math.isnan(law.gain)
    assert math.isnan(gain_of(config(law='pd'), 0.1, 0.1))


angle = st.floats(-3.0, 3.0)


@given(angle, angle, angle, angle, st.floats(4.0, 9.0))
def test_every_location_gives_the_tip_without_latency(a, b, da, db, location: float) -> None:
    """The rigid measurand: the loop is the same wherever the sensor sits."""
    plant = PlantParameters(length=LENGTHS)
    sensed = make_point(plant, location, False)(np.array([a, b]), np.array([da, db]))
    sample = SAMPLE._replace(q=(a, b), qd=(da, db), tip=sensed, encoder=(a, b, da, db))
    found = torque(config(location, law='pd'), sample)
    expected = torque(config(9.0, law='pd', feedback='encoder'), sample)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-8)


def test_torque_limit_holds_each_joint() -> None:
    free = torque(config(law='pd'))
    assert abs(free[0]) > 100.0
    assert torque(config(law='pd', torque_limit=20.0)) == tuple(
        math.copysign(min(abs(t), 20.0), t) for t in free
    )


ROWS = ((0.0, 0.0, 1.0), (0.01, 10.0, 1.0), (0.01, -4.0, 2.0), (0.02, -4.0, 0.0))


def open_loop(rows) -> RunConfig:
    return replace(config(law='open_loop'), torques=rows)


def test_open_loop_takes_the_middle_of_each_tick() -> None:
    law = make_law(open_loop(ROWS))
    found = np.array([law.torque(k, SAMPLE) for k in range(30)])
    middles = (np.arange(30) + 0.5) * 1e-3
    expected1 = np.where(middles < 0.01, 1000.0 * middles, -4.0)
    expected2 = np.where(middles < 0.01, 1.0, np.maximum(2.0 - 200.0 * (middles - 0.01), 0.0))
    assert found[:, 0] == pytest.approx(expected1)
    assert found[:, 1] == pytest.approx(expected2, abs=1e-12)


def test_open_loop_holds_the_ends_and_starts_anywhere() -> None:
    law = make_law(open_loop(((0.005, 3.0, 4.0), (0.006, 5.0, 6.0))))
    assert law.torque(0, SAMPLE) == (3.0, 4.0)
    assert law.torque(500, SAMPLE) == (5.0, 6.0)
    assert make_law(open_loop(((1.0, 2.0, 3.0),))).torque(0, SAMPLE) == (2.0, 3.0)


@pytest.mark.parametrize('rows', [(), ((0.0, 0.0, 0.0), (-1.0, 0.0, 0.0))])
def test_a_bad_table_names_the_key(rows) -> None:
    with pytest.raises(ValueError, match='^controller.torque_file'):
        make_law(open_loop(rows))


def test_every_choice_of_the_parameter_is_a_law() -> None:
    from flexarm_ros.core.parameters.sections import specs

    assert set(specs(ControllerParameters)['law'][1].choices) == set(BUILT_IN)
