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

"""``fa.linearize`` and ``fa.linear_law``: arm and control law for python-control."""

from __future__ import annotations

from typing import Any, TYPE_CHECKING

from flexarm_ros.api.extras import extra
from flexarm_ros.api.numbers import within
from flexarm_ros.api.simulation import configure, Scenario
from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, specs
from flexarm_ros.core.sensing.strain_gauge import closes_the_loop
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import initial_angles
from flexarm_ros.stability import linear_model
from flexarm_ros.stability.law import linear_law as law_matrices
from flexarm_ros.stability.law import reads_deflections
from flexarm_ros.stability.linear_model import DEFLECTION, ENCODER, TIP_SENSOR, TORQUES
from flexarm_ros.stability.modes import linearise

if TYPE_CHECKING:
    import control

OUTPUTS = ('feedback', 'encoder', 'tip_sensor', 'deflection', 'state', 'law', 'all')


def linearize(
    scenario: Scenario,
    theta2: float | None = None,
    theta1: float | None = None,
    *,
    outputs: str = 'feedback',
    continuous: bool = False,
    **changes: Any,
) -> control.StateSpace:
    """
    Return the arm linearised about a pose, with sensors and delays, as a StateSpace.

    Inputs are the joint torques, N m; outputs are deviations from the pose, at rest with straight
    links.  The discrete-time model, one step per tick, is exact: zero-order-hold torques, and
    the delay as simulated.  Noise, encoder resolution and motion of the pose are left out.

    Parameters
    ----------
    scenario
        As for :func:`flexarm_ros.simulate`.
    theta2, theta1
        The pose, rad; default the scenario's start.
    outputs
        ``feedback``: the sensor that closes the scenario's loop.  ``encoder``: both angles and
        their rates, as delivered.  ``tip_sensor``: x, y, vx, vy in frame ``base``, as delivered.
        ``deflection``: delta1 and delta2.  ``state``: the plant's coordinates and rates.
        ``law``: the inputs of :func:`linear_law`.  ``all``: all outputs.
    continuous
        Return a continuous-time model, each delay a second-order Pade approximation as in the
        paper.
    **changes
        Sections and values as for :func:`flexarm_ros.simulate`,
        ``tip_sensor={"latency": 0.0312}``.

    Returns
    -------
    control.StateSpace
        With named states, inputs and outputs (needs the package ``control``).

    Raises
    ------
    ScenarioError, ValueError
        For a bad scenario or pose; for a sensor that has no time-invariant model.

    """
    with extra('control'):
        import control

    if outputs not in OUTPUTS:
        raise ValueError(f'outputs: {outputs!r}, allowed: {", ".join(OUTPUTS)}')
    config = configure(scenario, **changes)
    model = linear_model.linear_model(config, *_pose(config, theta1, theta2), continuous)
    model = model.select(_names(config, model, outputs))
    return control.ss(
        model.a, model.b, model.c, model.d, *([] if continuous else [model.period]),
        states=list(model.states), inputs=list(TORQUES), outputs=list(model.outputs), name='arm',
    )  # fmt: skip


def linear_law(
    scenario: Scenario, theta2: float | None = None, theta1: float | None = None, **changes: Any
) -> control.StateSpace:
    """
    Return the scenario's control law, linearised about rest at a pose, as a discrete StateSpace.

    Inputs are the outputs of ``linearize(..., outputs="law")``, outputs the torques with their
    sign: ``control.feedback(arm, law, sign=1)`` is the closed loop, whose poles are those of
    ``flexarm stability``.  The fuzzy law is linearised at lambda(0, 0) = 1/6, ``lqg`` and
    ``adaptive`` with the gains of the last time at which the plan has the elbow angle.

    Parameters
    ----------
    scenario, theta2, theta1, **changes
        As for :func:`linearize`.

    Raises
    ------
    NoLinearFormError
        A ``ValueError``, for a law that has no linear form, ``open_loop``, and for a tip sensor
        slower than the tick with ``passive``, ``lqg`` and ``adaptive``.
    ValueError
        For a law that reads strain gauges, which `linearize` does not have.

    """
    with extra('control'):
        import control

    config = configure(scenario, **changes)
    angle1, angle2 = _pose(config, theta1, theta2)
    arm = linearise(config, angle2, angle1)
    law = law_matrices(config, arm)
    if closes_the_loop(config) and reads_deflections(config):
        raise ValueError(
            'controller.deflection_source: strain_gauge, which is not in the linear model; '
            'allowed with this law: plant'
        )
    model = linear_model.linear_model(config, angle1, angle2)
    return control.ss(
        law.a, law.b, law.c, law.d, Timeline.of(config.run).period,
        inputs=list(_names(config, model, 'law')), outputs=list(TORQUES), name='law',
    )  # fmt: skip


def _pose(config: RunConfig, theta1: float | None, theta2: float | None) -> tuple[float, float]:
    spec = specs(PlantParameters)['initial_position'][1].item
    given = {'theta1': theta1, 'theta2': theta2}
    angle1, angle2 = (
        start if angle is None else within(name, angle, spec)
        for (name, angle), start in zip(given.items(), initial_angles(config), strict=True)
    )
    return angle1, angle2


def _names(config: RunConfig, model: linear_model.LinearModel, outputs: str) -> tuple[str, ...]:
    """Return the names of a choice of outputs."""
    state = model.outputs[: 4 + 4 * config.plant.modes]
    feedback = ENCODER if config.controller.feedback == 'encoder' else TIP_SENSOR
    read = DEFLECTION if outputs == 'law' and reads_deflections(config) else ()
    return {
        'feedback': feedback,
        'encoder': ENCODER,
        'tip_sensor': TIP_SENSOR,
        'deflection': DEFLECTION,
        'state': state,
        'law': (*state, *ENCODER, *TIP_SENSOR, *read),
        'all': model.outputs,
    }[outputs]
