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

"""
Stability boundaries: from the linear analysis, and from simulations.

A simulated boundary is the latency up to which a scenario ends stable, found by bisection: the
run is assumed stable below it and unstable above.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

from flexarm_ros.core.arm.kinematics import rigid_point
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.timeline import NS_PER_S
from flexarm_ros.stability.margins import crossing_ns, Pose, poses_along
from flexarm_ros.stability.sampled_loop import SampledLoop

LIMIT_S = 0.06
RESOLUTION = 0.005
"""Relative accuracy of a simulated boundary."""


def with_latency(config: RunConfig, latency_s: float) -> RunConfig:
    """Return ``config`` with the given latency of the sensor in its loop, in whole ns."""
    latency = round(latency_s * NS_PER_S) / NS_PER_S
    if config.controller.feedback == 'encoder':
        return replace(config, encoder=replace(config.encoder, latency=latency))
    return replace(config, tip_sensor=replace(config.tip_sensor, latency=latency))


def ends_stable(config: RunConfig) -> bool:
    """Simulate a scenario; return whether it reaches its end."""
    loop = ClosedLoop(config)
    while loop.tick() is not None:
        pass
    return loop.unstable is None


def flown_boundary(
    config: RunConfig,
    limit_s: float = LIMIT_S,
    stable: Callable[[RunConfig], bool] = ends_stable,
) -> float | None:
    """
    Return the latency, s, from which on ``stable`` is false, ``None`` if beyond the limit.

    It is 0 if ``stable`` is false without latency.
    """
    if not stable(with_latency(config, 0.0)):
        return 0.0
    below, above = 0.0, limit_s
    if stable(with_latency(config, limit_s)):
        return None
    while above - below > max(RESOLUTION * above, 1e-6):
        middle = 0.5 * (below + above)
        if stable(with_latency(config, middle)):
            below = middle
        else:
            above = middle
    return above


def fades(config: RunConfig) -> bool:
    """
    Simulate a scenario; return whether its joint rates are small at the end, and falling.

    Falling: smaller in the last third than in the second.  Small: below 100 times those of the
    first.  A growing motion may reach poses where it is damped; its run then ends stable, in a
    limit cycle, but has not faded.
    """
    loop = ClosedLoop(config)
    thirds, first = [0.0, 0.0, 0.0], 0.0
    while (record := loop.tick()) is not None:
        third = 3 * record.k // loop.timeline.ticks
        rate = max(abs(float(record.qd[0])), abs(float(record.qd[1])))
        thirds[third] = max(thirds[third], rate)
        first = first or rate
    return loop.unstable is None and thirds[2] < thirds[1] and thirds[2] < 100.0 * first


def fading_boundary(config: RunConfig, pose: Pose, limit_s: float = LIMIT_S) -> float | None:
    """Return the latency, s, from which on a small disturbance at rest no longer decays."""
    return flown_boundary(holding(config, pose, 60.0, 1e-6), limit_s, fades)


@dataclass(frozen=True)
class Linear:
    """
    Crossing delays over the poses, s: the smallest with its pose, and the largest.

    ``None``: beyond the limit.
    """

    least: float | None
    worst: Pose
    most: float | None


def linear_boundary(
    config: RunConfig, gain: float | None = None, count: int = 7, limit_s: float = LIMIT_S
) -> Linear:
    """Return the crossing delays of the linear analysis along the trajectory."""
    found: list[tuple[float, Pose]] = []
    for pose in poses_along(config, count):
        loop = SampledLoop(config, pose.theta2)
        factor = 1.0 if gain is None else gain / loop.gain
        crossing = crossing_ns(loop, factor, round(limit_s * NS_PER_S))
        found.append((math.inf if crossing is None else crossing / NS_PER_S, pose))
    least, worst = min(found, key=lambda one: one[0])
    most = max(value for value, _ in found)
    return Linear(_finite(least), worst, _finite(most))


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def holding(config: RunConfig, pose: Pose, duration: float, kick: float = 0.01) -> RunConfig:
    """
    Return the scenario that holds ``pose`` for ``duration`` s, with joint rates of ``kick`` rad/s.

    As in the linear analysis, the pose is at rest and the links are straight.
    """
    x, y, _, _ = rigid_point(*config.plant.spans, pose.theta1, pose.theta2, 0.0, 0.0)
    return replace(
        config,
        run=replace(config.run, duration=duration),
        plant=replace(
            config.plant,
            initial_position=(pose.theta1, pose.theta2),
            initial_velocity=(kick, -kick),
        ),
        trajectory=replace(config.trajectory, kind='hold', hold_position=(x, y)),
    )


def one_side(config: RunConfig, side_time: float) -> RunConfig:
    """
    Return the scenario that follows the square's first side in ``side_time`` s.

    A side covers every elbow angle of the square.
    """
    return replace(
        config,
        run=replace(config.run, duration=side_time),
        trajectory=replace(config.trajectory, kind='square', side_time=side_time),
    )
