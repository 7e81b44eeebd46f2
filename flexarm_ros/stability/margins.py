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
Margins of the sampled loop at poses along the trajectory.

All are found from the eigenvalues: a margin is where the largest modulus exceeds 1, searched in
steps and refined by bisection.  A window narrower than a step, :data:`GAIN_STEP` or
:data:`LATENCY_STEPS`, can be missed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

from flexarm_ros.core.arm.kinematics import inverse_kinematics
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import NS_PER_S, Timeline
from flexarm_ros.core.trajectory import make_path, Side
from flexarm_ros.stability.sampled_loop import SampledLoop
import numpy as np

ROUNDING = 1e-9
"""Allowed excess of a modulus over 1 from rounding (a double root moves by 1e-8.5)."""

GAIN_STEP = 1.1
GAIN_SPAN = 1000.0
"""Gains are searched up and down from the loop's own by this factor."""

LATENCY_STEPS = 60
"""Steps of the search for the crossing delay, each at least a tick."""

MAX_LATENCY_S = 0.06


@dataclass(frozen=True)
class Pose:
    """A pose: joint angles, rad, and its time on the trajectory, s (``None``: not on it)."""

    time: float | None
    theta1: float
    theta2: float


@dataclass(frozen=True)
class PoseStability:
    """
    The loop about rest at one pose, with one gain.

    ``gain``: K_s lambda of (21), 1 for (20).  ``modulus``: that of the largest eigenvalue per
    tick, with its growth rate ln(modulus) / T, 1/s, and its frequency, rad/s.  ``gain_low``,
    ``gain_high``: the stable range of gains around this one or, if the loop is unstable, the
    next below it (both ``None`` without one); otherwise ``None`` means an end more than a
    factor of 1000 away.  ``crossing_s``: the smallest total latency, s, at which an eigenvalue
    leaves the unit circle; 0 if the loop is unstable without latency, ``None`` without a
    crossing within ``searched_s``.  ``eigenvalues``: all larger than 0.5, in descending order.
    """

    pose: Pose
    gain: float
    states: int
    modulus: float
    rate: float
    frequency: float
    gain_low: float | None
    gain_high: float | None
    latency_s: float
    crossing_s: float | None
    searched_s: float
    eigenvalues: tuple[complex, ...]

    @property
    def stable(self) -> bool:
        """Whether no eigenvalue is outside the unit circle, up to rounding."""
        return self.modulus <= 1.0 + ROUNDING

    @property
    def gain_margin(self) -> float | None:
        """Factor to the limit of the gain, below 1 if unstable; ``None`` without a limit."""
        return None if self.gain_high is None else self.gain_high / self.gain

    @property
    def delay_margin_s(self) -> float | None:
        """Crossing delay minus latency; negative if unstable because of the latency."""
        return None if self.crossing_s is None else self.crossing_s - self.latency_s


def analyse(
    config: RunConfig,
    pose: Pose,
    gain: float | None = None,
    max_latency_s: float = MAX_LATENCY_S,
    integrator: str = 'exact',
) -> PoseStability:
    """
    Return stability and margins at ``pose``; ``gain`` replaces the law's own.

    Raises NoLinearFormError, and ``ValueError`` for a latency of too many
    ticks, which also limits the search for the crossing delay.
    """
    loop = SampledLoop(config, pose.theta2, integrator, time=pose.time)
    own = loop.gain
    if own <= 0.0:
        raise ValueError('controller.ks: 0.0, with no gain there is no loop to analyse')
    factor = 1.0 if gain is None else gain / own
    values = loop.eigenvalues(factor)
    modulus = float(np.abs(values[0]))
    low, high = gain_range(loop, factor)
    limit_ns = min(round(max_latency_s * NS_PER_S), loop.longest_latency_ns)
    crossing = crossing_ns(loop, factor, limit_ns)
    return PoseStability(
        pose=pose,
        gain=own * factor,
        states=len(values),
        modulus=modulus,
        rate=math.log(modulus) / loop.period if modulus > 0.0 else -math.inf,
        frequency=abs(float(np.angle(values[0]))) / loop.period,
        gain_low=None if low is None else own * low,
        gain_high=None if high is None else own * high,
        latency_s=loop.latency_ns / NS_PER_S,
        crossing_s=None if crossing is None else crossing / NS_PER_S,
        searched_s=limit_ns / NS_PER_S,
        eigenvalues=tuple(complex(v) for v in values if abs(v) > 0.5),
    )


def is_stable(loop: SampledLoop, factor: float = 1.0, latency_ns: int | None = None) -> bool:
    """Return whether no eigenvalue is outside the unit circle, up to rounding."""
    return loop.modulus(factor, latency_ns) <= 1.0 + ROUNDING


def crossing_ns(loop: SampledLoop, factor: float, limit_ns: int) -> int | None:
    """
    Return the smallest latency, ns, at which the loop is unstable; ``None`` if beyond the limit.

    Accurate to a microsecond, or a thousandth of a tick if that is longer.
    """
    step = max(loop.period_ns, limit_ns // LATENCY_STEPS)
    below = 0
    if not is_stable(loop, factor, 0):
        return 0
    for latency in [*range(step, limit_ns, step), limit_ns]:
        if not is_stable(loop, factor, latency):
            break
        below = latency
    else:
        return None
    resolution = max(1000, loop.period_ns // 1000)
    above: int = latency
    while above - below > resolution:
        middle = (above + below) // 2
        if is_stable(loop, factor, middle):
            below = middle
        else:
            above = middle
    return above


def gain_range(loop: SampledLoop, factor: float) -> tuple[float | None, float | None]:
    """
    Return the stable range of factors around ``factor``, or the next one below it.

    ``None``: an end more than :data:`GAIN_SPAN` away; both, if ``factor`` is
    unstable and there is no stable range within that span.
    """

    def search(start: float, ratio: float, wanted: bool) -> float | None:
        """Return the boundary where stability becomes ``wanted``, from ``start`` on."""
        last = start
        while 1.0 / GAIN_SPAN < last / factor < GAIN_SPAN:
            following = last * ratio
            if is_stable(loop, following) == wanted:
                return _boundary(loop, last, following)
            last = following
        return None

    if is_stable(loop, factor):
        return search(factor, 1.0 / GAIN_STEP, False), search(factor, GAIN_STEP, False)
    high = search(factor, 1.0 / GAIN_STEP, True)
    return (None, None) if high is None else (search(high, 1.0 / GAIN_STEP, False), high)


def _boundary(loop: SampledLoop, first: float, second: float) -> float:
    """Bisect between a stable and an unstable factor, to 1e-4 of it; the stable end."""
    steady = is_stable(loop, first)
    while abs(second - first) > 1e-4 * first:
        middle = 0.5 * (first + second)
        if is_stable(loop, middle) == steady:
            first = middle
        else:
            second = middle
    return first if steady else second


def poses_along(config: RunConfig, count: int = 7) -> list[Pose]:
    """
    Return up to ``count`` poses of the trajectory, evenly spaced in theta2 >= 0.

    The loop's eigenvalues depend on theta2 alone.
    """
    path, timeline = make_path(config), Timeline.of(config.run)
    end = timeline.duration_ns
    if path.lap_ns:
        end = min(end, path.lap_ns)
    times = sorted({end * i // 400 for i in range(401)} | set(_corners(path.sides, end)))
    poses = []
    for time in times:
        theta1, theta2 = inverse_kinematics(config.plant.spans, *path.at(time)[:2])
        poses.append(Pose(time / NS_PER_S, theta1, theta2))
    bends = np.array([pose.theta2 for pose in poses])
    wanted = np.linspace(bends.min(), bends.max(), count)
    chosen = {int(np.argmin(np.abs(bends - bend))) for bend in wanted}
    found: list[Pose] = []
    for index in sorted(chosen, key=lambda i: bends[i]):
        if not found or poses[index].theta2 - found[-1].theta2 > 1e-6:
            found.append(poses[index])
    return found


def _corners(sides: list[Side], end: int) -> Iterator[int]:
    for side in sides:
        middle = side.start_ns + side.time_ns // 2
        yield from (time for time in (side.start_ns, middle) if time < end)
