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

"""Predictions of the arm and its joints: from measured torques or currents, or in closed loop."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from flexarm_ros.core.arm.driven.dynamics import make_scratch, Rig, Scratch
from flexarm_ros.core.arm.kinematics import make_point
from flexarm_ros.core.control.state_feedback import StateFeedback, StateFeedbackParameters
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import PlantParameters
from flexarm_ros.core.sensing.lowpass import lowpass_step
from flexarm_ros.identification.model.arm_model import ArmModel, make_model
from flexarm_ros.identification.model.arm_motion import ANGLE, ELASTIC, predict_rows, RATE, STRAIN
from flexarm_ros.identification.prediction.driven_arm import (
    driven_states,
    DrivenData,
    Motion,
    rest_state,
    true_angles,
    zeroed,
)
from flexarm_ros.identification.recording import Recording
from flexarm_ros.identification.setting import Setting
from flexarm_ros.scenario.errors import clip, ScenarioError
import numpy as np

STATE_FEEDBACK = f'{StateFeedback.__module__}:{StateFeedback.__qualname__}'
RATE_TIME = 0.03
"""Time over which a joint rate is estimated from the angles before, s."""


@dataclass(frozen=True, eq=False)
class JointArm:
    """Arguments of the compiled motion of an arm with its joints."""

    rig: Rig
    scratch: Scratch
    model: ArmModel


def make_joint_arm(setting: Setting, model: ArmModel) -> JointArm:
    """Return the compiled arm of a scenario."""
    plant = setting.config.plant
    scratch = make_scratch(2 + 2 * plant.modes)
    return JointArm(_rig(plant), scratch, model)


def _rig(plant: PlantParameters) -> Rig:
    negative = plant.coulomb_friction_negative or plant.coulomb_friction
    tip = make_point(plant, plant.spans[0] + plant.spans[1], elastic=True)
    zeros = np.zeros(2)
    friction = np.array([plant.coulomb_friction, negative], dtype=float).T.copy()
    return Rig(friction, zeros, zeros, zeros, tip.shapes, tip.shortening)


class Loop(NamedTuple):
    """The controller in a closed loop; see `identification.model.arm_motion.predict_rows`."""

    law: FloatArray
    rates: FloatArray
    references: FloatArray


OPEN = Loop(np.zeros((0, 8)), np.zeros((2, 4)), np.zeros((0, 2)))


def loop_of(recording: Recording, setting: Setting) -> Loop:
    """
    Return the controller of a scenario with the reference of a recording.

    Raises ScenarioError if the law is another than joint state feedback, or there is no reference.
    """
    keys = setting.config.controller.own()
    if not isinstance(keys, StateFeedbackParameters):
        name = clip(setting.config.controller.law)
        raise ScenarioError(
            f'controller.law: {name} is not allowed in mode closed_loop: {STATE_FEEDBACK}'
        )
    encoder = setting.config.encoder
    constants = setting.actuator.torque_per_ampere
    law = np.array(
        [
            [
                keys.angle[j], keys.deflection[j], keys.rate[j], keys.deflection_rate[j],
                keys.limit[j], constants[j], encoder.resolution, encoder.offset[j],
            ]
            for j in (0, 1)
        ]
    )  # fmt: skip
    rates = lowpass_step(keys.rate_cutoff, keys.filter_damping, recording.period)
    return Loop(law, rates, recording.pair('theta{}_reference'))


def torques_of(recording: Recording, setting: Setting) -> FloatArray:
    """
    Return the joint torques of a recording, (n, 2), N m: measured, or from currents.

    Raises ScenarioError if it has neither.
    """
    if recording.has('tau{}'):
        return recording.pair('tau{}')
    if recording.has('i{}'):
        return np.asarray(recording.pair('i{}') * np.array(setting.actuator.torque_per_ampere))
    raise ScenarioError(f'{recording.name}: neither torques tau1, tau2 nor currents i1, i2')


def past_rates(angles: FloatArray, period: float) -> FloatArray:
    """
    Return rates of angles, (n, k), rad/s, each from the angles up to its sample.

    The slope at the end of a parabola through the last `RATE_TIME`; before the start the arm is
    taken to be at rest.
    """
    count = max(3, round(RATE_TIME / period))
    times = (np.arange(count) - (count - 1)) * period
    weights = np.linalg.pinv(np.stack([np.ones(count), times, times * times], axis=1))[1]
    padded = np.concatenate([np.repeat(angles[:1], count - 1, axis=0), angles])
    return np.stack([np.convolve(column, weights[::-1], 'valid') for column in padded.T], axis=1)


def rate_half_width(period: float) -> int:
    """Return half the number of samples, at least 1, of a difference in `centred_rates`."""
    return max(1, round(0.008 / period))


def centred_rates(angles: FloatArray, period: float) -> FloatArray:
    """
    Return joint rates, (n, 2), rad/s, by central differences over some 16 ms.

    Near an end over as many samples as there are on the shorter side, at the end over one.
    """
    places = np.arange(len(angles))
    width = np.minimum(places, len(angles) - 1 - places)
    width = np.clip(width, 1, rate_half_width(period))
    before = np.maximum(places - width, 0)
    after = np.minimum(places + width, len(angles) - 1)
    times = np.maximum(after - before, 1) * period
    return np.asarray((angles[after] - angles[before]) / times[:, None])


def predict_torque(
    data: DrivenData, setting: Setting, window: float | None, zero: float | None,
    closed: bool = False,
) -> Motion:  # fmt: skip
    """
    Return the predicted motion; its outputs are strains, angles as read, and rates, (n, 6).

    ``closed``: the scenario's law closes the loop; otherwise the torques are as measured.
    """
    recording = data.recording
    model = make_model(setting, recording.period, data.kinds)
    angles = true_angles(data, setting)
    if zero is not None:
        model = zeroed(data, model, angles, zero)
    arm = make_joint_arm(setting, model)
    if closed:
        loop, torques = loop_of(recording, setting), np.zeros(angles.shape)
    else:
        loop, torques = OPEN, torques_of(recording, setting)
    rows, size = len(angles), model.coordinates
    length = rows if window is None else max(1, round(window / model.period))
    if window is None:
        states = rest_state(data, model, angles)[None]
    else:
        states = driven_states(data, model, angles)[::length]
    rates = past_rates(angles, model.period)[::length]
    outputs = np.zeros((rows, ELASTIC + size))
    for number, state in enumerate(states):
        first = number * length
        start = np.concatenate(
            [angles[first], state[:size], rates[number], state[size : 2 * size], state[2 * size :]]
        )
        predict_from(arm, torques, data, first, min(first + length, rows), start, outputs, loop)
    turned = outputs[:, ANGLE : ANGLE + 2].copy()
    outputs[:, ANGLE : ANGLE + 2] += np.array(setting.config.encoder.offset)
    return Motion(outputs[:, :ELASTIC], turned, outputs[:, ELASTIC:], model)


def predict_from(
    arm: JointArm, torques: FloatArray, data: DrivenData, first: int, last: int,
    start: FloatArray, outputs: FloatArray, loop: Loop,
) -> None:  # fmt: skip
    """Fill rows of ``outputs`` from a start state; see `identification.model.arm_motion`."""
    model = arm.model
    predict_rows(
        model.terms, arm.rig, arm.scratch, model.shapes, model.gauges, model.lowpass,
        torques, model.period, model.substeps, data.on, first, last, start, outputs, loop.law,
        loop.rates, loop.references,
    )  # fmt: skip


__all__ = [
    'ANGLE', 'RATE', 'STRAIN', 'centred_rates', 'make_joint_arm', 'past_rates', 'predict_torque',
    'rate_half_width',
]  # fmt: skip
