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
The commanded motion of the end effector: square, hold and way points.

A trajectory is a path of straight sides, each with its own duration.  At a way point the velocity
is that of the side that begins there.  The delayed command (the paper's forward-loop correction)
at a time before ``delay`` is the start position, at rest, as for the delayed feedback.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
import math
from typing import NamedTuple

from flexarm_ros.core.arm.kinematics import inverse_kinematics, reach, REACH_TOLERANCE, rigid_point
from flexarm_ros.core.numerics.compiled import bound, compiled, FloatArray, internal
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import named_ns, NS_PER_S, Timeline
import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float, float, float]
Vector6 = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class Side:
    """One straight side: from ``x``, ``y`` by ``dx``, ``dy`` (m) from ``start_ns`` on."""

    start_ns: int
    time_ns: int
    x: float
    y: float
    dx: float
    dy: float


@dataclass(frozen=True)
class Switch:
    """A change of direction: time, corner, and the old direction (unit vector)."""

    time_ns: int
    x: float
    y: float
    along_x: float
    along_y: float


class Sides(NamedTuple):
    """
    The sides of a path as arrays, for compiled code.

    ``times`` (n, 2): start and duration, ns; ``lines`` (n, 4): x, y, dx, dy, m; ``lap_ns``,
    ``smooth``: see `Path`.
    """

    times: NDArray[np.int64]
    lines: FloatArray
    lap_ns: int
    smooth: bool


class Path:
    """The sides of a trajectory; ``lap_ns`` is the period of a repeating one, else 0."""

    def __init__(self, sides: list[Side], lap_ns: int, smooth: bool) -> None:
        self.sides, self.lap_ns = sides, lap_ns
        times = np.array([(side.start_ns, side.time_ns) for side in sides], np.int64)
        lines = np.array([(side.x, side.y, side.dx, side.dy) for side in sides], float)
        self.record = Sides(times, lines, lap_ns, smooth)

    def command(self, time_ns: int) -> Point:
        """Return x, y, vx, vy at ``time_ns``; before 0 the start, at rest."""
        found = bound(command_at, *self.record, example=(0,))
        self.command = found  # type: ignore[method-assign]
        point: Point = found(time_ns)
        return point

    def at(self, time_ns: int) -> Vector6:
        """Return x, y, vx, vy, ax, ay (m, s) at ``time_ns`` >= 0; at rest after the end."""
        point: Vector6 = point_at(*self.record, time_ns)
        return point

    def switch(self, index: int) -> Switch | None:
        """Return direction switch ``index`` (from 0) in order of time, or ``None``."""
        if self.lap_ns:
            lap, place = divmod(index, len(self.sides))
            return _corner(self.sides[place], lap * self.lap_ns)
        turns = [
            s
            for s, after in zip(self.sides, [*self.sides[1:], None], strict=True)
            if _turns(s, after)
        ]
        return _corner(turns[index], 0) if index < len(turns) else None


def _distance(x: float, y: float) -> float:
    return math.sqrt(x * x + y * y)


def _turns(side: Side, after: Side | None) -> bool:
    if side.dx == 0.0 and side.dy == 0.0:
        return False
    if after is None:
        return True
    old, new = _distance(side.dx, side.dy), _distance(after.dx, after.dy)
    cross = side.dx * after.dy - side.dy * after.dx
    dot = side.dx * after.dx + side.dy * after.dy
    return new == 0.0 or dot <= 0.0 or abs(cross) > 1e-9 * old * new


def _corner(side: Side, offset_ns: int) -> Switch:
    length = _distance(side.dx, side.dy)
    time_ns = offset_ns + side.start_ns + side.time_ns
    return Switch(
        time_ns, side.x + side.dx, side.y + side.dy, side.dx / length, side.dy / length
    )  # fmt: skip


@internal
def rest_to_rest(part: float) -> tuple[float, float, float]:
    """
    Return the fraction of the way and its first and second rates at ``part`` of the time, 0 to 1.

    The septic 35 p^4 - 84 p^5 + 70 p^6 - 20 p^7: velocity, acceleration and
    jerk vanish at both ends.
    """
    p = part
    square, both = p * p, p * (1.0 - p)
    share = square * square * (35.0 + p * (-84.0 + p * (70.0 - 20.0 * p)))
    return share, 140.0 * both * both * both, 420.0 * both * both * (1.0 - 2.0 * p)


@compiled
def point_at(
    times: NDArray[np.int64], lines: FloatArray, lap_ns: int, smooth: bool, time_ns: int
) -> Vector6:
    """Return x, y, vx, vy, ax, ay (m, s) at ``time_ns`` >= 0; arguments: see `Sides`."""
    if lap_ns:
        time_ns %= lap_ns
    low, high = 0, times.shape[0] - 1  # the last side that has begun
    while low < high:
        middle = (low + high + 1) // 2
        if times[middle, 0] <= time_ns:
            low = middle
        else:
            high = middle - 1
    elapsed, length = time_ns - times[low, 0], times[low, 1]
    x, y, dx, dy = lines[low, 0], lines[low, 1], lines[low, 2], lines[low, 3]
    if elapsed >= length:
        return x + dx, y + dy, 0.0, 0.0, 0.0, 0.0
    part, seconds = elapsed / length, length / NS_PER_S
    if not smooth:
        return x + dx * part, y + dy * part, dx / seconds, dy / seconds, 0.0, 0.0
    share, rate, second = rest_to_rest(part)
    rate, second = rate / seconds, second / (seconds * seconds)
    return x + dx * share, y + dy * share, dx * rate, dy * rate, dx * second, dy * second


@compiled
def command_at(
    times: NDArray[np.int64], lines: FloatArray, lap_ns: int, smooth: bool, time_ns: int
) -> Point:
    """Return x, y, vx, vy at ``time_ns``; before 0 the start, at rest."""
    x, y, vx, vy, _, _ = point_at(times, lines, lap_ns, smooth, max(time_ns, 0))
    if time_ns < 0:
        return x, y, 0.0, 0.0
    return x, y, vx, vy


def make_path(config: RunConfig) -> Path:
    """Return the path of ``config``; ``ValueError`` names the invalid key."""
    parameters = config.trajectory
    smooth = parameters.time_law == 'smooth'
    if parameters.kind == 'square':
        half = 0.5 * parameters.side
        time_ns = named_ns('trajectory.side_time', parameters.side_time)
        corners = [(-half, -half), (-half, half), (half, half), (half, -half)]
        sides = [
            Side(
                i * time_ns,
                time_ns,
                x,
                y,
                corners[(i + 1) % 4][0] - x,
                corners[(i + 1) % 4][1] - y,
            )
            for i, (x, y) in enumerate(corners)
        ]
        return Path(sides, 4 * time_ns, smooth)
    if parameters.kind == 'hold':
        x, y = _hold_position(config)
        return Path([Side(0, 1, x, y, 0.0, 0.0)], 0, smooth)
    return Path(_waypoint_sides(config), 0, smooth)


def _hold_position(config: RunConfig) -> tuple[float, float]:
    if config.trajectory.hold_position is not None:
        return config.trajectory.hold_position
    if config.plant.initial_position is None:
        return -0.5 * config.trajectory.side, -0.5 * config.trajectory.side
    x, y, _, _ = rigid_point(*config.plant.spans, *config.plant.initial_position, 0.0, 0.0)
    return x, y


def _waypoint_sides(config: RunConfig) -> list[Side]:
    parameters = config.trajectory
    times, xs, ys = parameters.waypoint_times, parameters.waypoint_x, parameters.waypoint_y
    for name, values in (('waypoint_times', times), ('waypoint_x', xs), ('waypoint_y', ys)):
        if values is None:
            raise ValueError(f'trajectory.{name}: missing, needed by trajectory.kind waypoints')
        if times is not None and len(values) != len(times):
            raise ValueError(
                f'trajectory.{name}: {len(values)} values, waypoint_times has {len(times)}'
            )
    assert times is not None and xs is not None and ys is not None
    stamps = [named_ns('trajectory.waypoint_times', t) for t in times]
    if stamps[0] != 0 or any(b <= a for a, b in pairwise(stamps)):
        raise ValueError(f'trajectory.waypoint_times: {list(times)}, must increase from 0')
    if len(stamps) == 1:
        return [Side(0, 1, xs[0], ys[0], 0.0, 0.0)]
    return [
        Side(
            stamps[i],
            stamps[i + 1] - stamps[i],
            xs[i],
            ys[i],
            xs[i + 1] - xs[i],
            ys[i + 1] - ys[i],
        )
        for i in range(len(stamps) - 1)
    ]


class Reference:
    """The reference of a run, tick by tick."""

    def __init__(self, config: RunConfig) -> None:
        self.path = make_path(config)
        self._period_ns = Timeline.of(config.run).period_ns
        self.delay_ns = 0
        self.set_delay_ns(named_ns('trajectory.delay', config.trajectory.delay))

    def at(self, k: int) -> Vector6:
        """Return the undelayed x, y, vx, vy, ax, ay (m, s; ``base``) at tick ``k``."""
        return self.path.at(k * self._period_ns)

    def command(self, k: int) -> Point:
        """
        Return x, y, vx, vy of ``trajectory.delay`` ago, as sent to the controller.

        Before the start: the start position with zero velocity.
        """
        return self.path.command(k * self._period_ns - self.delay_ns)

    def set_delay_ns(self, delay_ns: int) -> None:
        """Change the delay of the command from the next tick on."""
        if delay_ns < 0:
            raise ValueError(f'trajectory.delay: {delay_ns} ns, must be 0 or more')
        self.delay_ns = delay_ns

    def retune(self, config: RunConfig) -> None:
        """Use the live parameters of ``config`` from the next tick on."""
        self.set_delay_ns(named_ns('trajectory.delay', config.trajectory.delay))


def initial_angles(config: RunConfig) -> tuple[float, float]:
    """
    Return the initial joint angles, rad: as given, or on the reference.

    On the reference, the branch with theta2 >= 0 is used.  Raises
    ``ValueError``, naming the key, if the reference starts out of reach.
    """
    if config.plant.initial_position is not None:
        return config.plant.initial_position
    x, y = make_path(config).at(0)[:2]
    try:
        return inverse_kinematics(config.plant.spans, x, y, once=True)
    except ValueError as error:
        raise ValueError(f'{_key(config)}: start out of reach, {error}') from None


def check_reachable(config: RunConfig) -> None:
    """
    Raise ``ValueError``, naming the key, if a point of the path is out of reach.

    The complete path counts, even if the run ends before.
    """
    low, high = reach(config.plant.spans)
    slack = REACH_TOLERANCE * high
    for side in make_path(config).sides:
        for x, y in ((side.x, side.y), (side.x + side.dx, side.y + side.dy)):
            if _distance(x, y) > high + slack:
                raise ValueError(_unreachable(config, x, y, low, high))
        x, y = _nearest(side)
        if _distance(x, y) < low - slack:
            raise ValueError(_unreachable(config, x, y, low, high))


def _nearest(side: Side) -> tuple[float, float]:
    """Return the point of a side that is nearest to the shoulder."""
    square = side.dx * side.dx + side.dy * side.dy
    part = -(side.x * side.dx + side.y * side.dy) / square if square > 0.0 else 0.0
    part = min(1.0, max(0.0, part))
    return side.x + part * side.dx, side.y + part * side.dy


def _key(config: RunConfig) -> str:
    trajectory = config.trajectory
    if trajectory.kind == 'waypoints':
        return 'trajectory.waypoint_x, waypoint_y'
    if trajectory.kind == 'hold' and trajectory.hold_position is not None:
        return f'trajectory.hold_position: {list(trajectory.hold_position)}'
    return f'trajectory.side: {trajectory.side!r}'


def _unreachable(config: RunConfig, x: float, y: float, low: float, high: float) -> str:
    return (
        f'{_key(config)}: ({x:.6g}, {y:.6g}) m is {_distance(x, y):.6g} m from the shoulder, '
        f'allowed: {low:.6g} to {high:.6g} m'
    )
