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

"""A scenario's model and plan, computed once and shared by laws and runs."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
import math
from typing import NamedTuple

from flexarm_ros.core.arm.full.dynamics import make_work
from flexarm_ros.core.arm.full.model import floats, link_bases, make_constants_on
from flexarm_ros.core.arm.full.plant import FullPlant
from flexarm_ros.core.arm.kinematics import inverse_kinematics, make_point
from flexarm_ros.core.control.design.model import adjust, Arm, Point
from flexarm_ros.core.control.design.plan import fill_ticks, Grid, make_plan, Motion, Weights
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.numerics.records import Records
from flexarm_ros.core.parameters.sections import (
    PlantParameters,
    RunConfig,
    RunParameters,
    TrajectoryParameters,
)
from flexarm_ros.core.timeline import NS_PER_S, Timeline
from flexarm_ros.core.trajectory import initial_angles, make_path, Path
import numpy as np

KNOT_S = 0.02
"""Spacing of the plan's knots, s: the torques are linear between them."""

LONGEST_S = 200.0
"""Longest motion that is planned, s: computing time and memory grow with it."""

_AHEAD_S = 2.0
_SETTLE_S = 8.0
_ROUNDS = 15
APART = 0.1
"""Relative change of EI and density for their finite differences."""


def model_of(config: RunConfig) -> PlantParameters:
    """Return the controller's model of the arm: the plant's values by default, no friction."""
    plant, own = config.plant, config.controller
    return replace(
        plant,
        model='full',
        modes=own.model_modes or plant.modes,
        flexural_rigidity=own.model_flexural_rigidity or plant.flexural_rigidity,
        mass_density=own.model_mass_density or plant.mass_density,
        viscous_friction=(0.0, 0.0),
        coulomb_friction=(0.0, 0.0),
        coulomb_friction_negative=None,
        substeps=None,
    )


def make_arm(plant: PlantParameters, location: float) -> Arm:
    """Return the model of ``plant`` with a sensor ``location`` m along the arm."""
    bases = link_bases(plant)
    con = make_constants_on(plant, bases)
    ei, rho = plant.flexural_rigidity, plant.mass_density
    stiff = make_constants_on(replace(plant, flexural_rigidity=(2 * ei[0], 2 * ei[1])), bases)
    heavy = make_constants_on(replace(plant, mass_density=(2 * rho[0], 2 * rho[1])), bases)
    tip, sensed = (
        make_point(plant, at, True) for at in (plant.spans[0] + plant.spans[1], location)
    )
    return Arm(
        con, floats(stiff) - floats(con), floats(heavy) - floats(con),
        Point(tip.shapes, tip.shortening), Point(sensed.shapes, sensed.shortening),
        make_work(plant.modes),
    )  # fmt: skip


def around(arm: Arm) -> tuple[Records, Records, Records, Records]:
    """Return constants with EI and then density lowered and raised by ``APART`` / 2."""
    half = 0.5 * APART
    none = np.zeros_like(arm.rigidity)
    ends = [arm.con.copy() for _ in range(4)]
    both = ((arm.rigidity, -half), (arm.rigidity, half), (arm.density, -half), (arm.density, half))
    for end, (change, share) in zip(ends, both, strict=True):
        adjust(floats(arm.con), change, none, share, 0.0, floats(end))
    softer, stiffer, lighter, heavier = ends
    return softer, stiffer, lighter, heavier


class Planned(NamedTuple):
    """Model, time grid, plan at the knots and at each tick (K ticks + 1, 2n + 2)."""

    arm: Arm
    grid: Grid
    motion: Motion
    dense: FloatArray


def plan_for(config: RunConfig) -> Planned:
    """
    Return the plan of ``config``, recomputed only if it differs from recent ones.

    Raises ``ValueError``, naming the key, for a motion that is too long.
    """
    gains = config.controller
    limit = gains.plan_torque_share * gains.torque_limit
    weights = Weights(
        gains.plan_tip_weight, gains.plan_torque_weight, gains.plan_rate_weight, limit,
        gains.plan_tip_weight / 1e4,
    )  # fmt: skip
    period = config.run.control_period
    run = replace(RunParameters(), control_period=period, duration=period)
    return _plan(
        run, model_of(config), config.trajectory, config.tip_sensor.location, horizon_ns(config),
        weights,
    )  # fmt: skip


def horizon_ns(config: RunConfig) -> int:
    """Return the planned time: slightly longer than the run, or the path and its rest."""
    timeline, path = Timeline.of(config.run), make_path(config)
    end = timeline.duration_ns + int(_AHEAD_S * NS_PER_S)
    if not path.lap_ns:
        last = path.sides[-1]
        end = min(end, last.start_ns + last.time_ns + int(_SETTLE_S * NS_PER_S))
    if end > LONGEST_S * NS_PER_S:
        raise ValueError(
            f'/**.duration: {config.run.duration!r} s, law {config.controller.law} plans the '
            f'motion before the run; allowed: up to {LONGEST_S - _AHEAD_S:g} s'
        )
    return end


@lru_cache(maxsize=4)
def _plan(
    run: RunParameters, plant: PlantParameters, trajectory: TrajectoryParameters, location: float,
    end_ns: int, weights: Weights,
) -> Planned:  # fmt: skip
    config = RunConfig(run=run, plant=plant, trajectory=trajectory)
    timeline, body = Timeline.of(run), FullPlant(config)
    period_ns = timeline.period_ns
    arm = make_arm(plant, location)
    ticks = max(1, round(KNOT_S * NS_PER_S / period_ns))
    grid = Grid(ticks, body.substeps, timeline.period / body.substeps, body.order)
    count = max(1, math.ceil(end_ns / (ticks * period_ns)))
    path = make_path(config)
    times = [j * ticks * period_ns for j in range(count + 1)]
    points = np.array([path.at(time)[:2] for time in times])
    guess = _guess(config, path, times, 2 + 2 * plant.modes)
    motion = make_plan(arm, points, weights, grid, guess, _ROUNDS)
    dense = np.zeros((count * ticks + 1, guess.shape[1] + 2))
    fill_ticks(arm, grid, motion, dense)
    return Planned(arm, grid, motion, dense)


def _guess(config: RunConfig, path: Path, times: list[int], n: int) -> FloatArray:
    """Return the rigid arm on the path; the first row is the arm's start, at rest."""
    states = np.zeros((len(times), 2 * n))
    before = initial_angles(config)
    for j, time in enumerate(times):
        x, y = path.at(time)[:2]
        angles = inverse_kinematics(config.plant.spans, x, y) if j else before
        for c in (0, 1):
            turn = round((before[c] - angles[c]) / (2.0 * math.pi)) * 2.0 * math.pi
            states[j, c] = angles[c] + turn
        before = (float(states[j, 0]), float(states[j, 1]))
    spacing = (times[1] - times[0]) / NS_PER_S
    joint_rates = states[:, n:][:, :2]
    joint_rates[1:] = (states[1:, :2] - states[:-1, :2]) / spacing
    if config.plant.initial_velocity is not None:
        joint_rates[0] = config.plant.initial_velocity
    return states
