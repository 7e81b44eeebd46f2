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

"""The search for the best parameters: SciPy's least squares, in two weightings, resumable."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
import math
import time

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.identification.estimate.problem import Problem, starting_points, steps_of
from flexarm_ros.identification.estimate.scores import Block, correlation_length
import numpy as np
from scipy.optimize import least_squares

MOST_ITERATIONS = 30
ANCHOR = 1e-3
"""Weight of a number's relative change from its start, against residuals of 1 std."""

_TINY = 1e-9


class Stopped(Exception):
    """The caller has stopped the search."""


Report = Callable[['Search'], None]


@dataclass
class Search:
    """
    A search in progress: at any time ``best`` holds the best values so far.

    ``starts``: searches of the first round, each from another point (`starting_points`), of which
    the best is taken; ``start``: the one that is in progress.

    Two rounds: the channels are weighted with the std of what is measured, then with the rms of
    the residuals that the first round leaves, times the root of their correlation length, so that
    each channel counts by its noise, and against the priors by its independent samples.
    """

    problem: Problem
    report: Report
    stop: Callable[[], bool] = lambda: False
    best: FloatArray = field(default_factory=lambda: np.zeros(0))
    best_cost: float = math.inf
    round: int = 0
    starts: int = 1
    start: int = 0
    evaluations: int = 0
    iterations: int = 0
    started: float = field(default_factory=time.monotonic)
    finished: bool = False
    fingerprint: str = ''
    weights: dict[str, float] = field(default_factory=dict)
    steps: FloatArray = field(default_factory=lambda: np.zeros(0))
    last: tuple[FloatArray, FloatArray] = field(default_factory=lambda: (np.zeros(0), np.zeros(0)))
    """The numbers of the last trial, and its weighted residuals."""
    most: int = MOST_ITERATIONS

    def __post_init__(self) -> None:
        if not len(self.best):
            self.best = np.array([free.start for free in self.problem.free])

    @property
    def seconds_left(self) -> float | None:
        """Return an upper estimate of the time left, s: as if every iteration were needed."""
        if not self.iterations:
            return None
        each = (time.monotonic() - self.started) / self.iterations
        return each * max(self.most_iterations - self.iterations, 1)

    @property
    def most_iterations(self) -> int:
        """Return the largest number of iterations of the search."""
        return (self.starts + 1) * self.most

    def run(self) -> Search:
        """Search until both rounds have converged; may be interrupted by any exception."""
        if self.round == 0:
            self._weigh(0)
            points = starting_points(self.problem.free, self.starts)
            if self.start > 0:
                self.values(self.best)  # of an earlier run that was stopped: to be beaten
            for number in range(self.start, len(points)):
                self.start = number
                self._solve(self.best if number == 0 else points[number])
            self.round = 1
        self._weigh(1)
        self.best_cost = math.inf
        self._solve(self.best)
        self.finished = True
        return self

    def _weigh(self, number: int) -> None:
        """Set the weight of each channel from all of its samples."""
        squares: dict[str, list[float]] = {}
        if number == 0:
            for prediction in self.problem.predictions(self.best):
                for name, channel in prediction.channels.items():
                    level = float(np.var(channel.measured[channel.valid]))
                    squares.setdefault(name, []).append(level)
        else:
            for name, _, _, residual in self.problem.residuals(self.best):
                lags = correlation_length(residual)
                squares.setdefault(name, []).append(lags * float(np.mean(residual**2)))
        self.last = np.zeros(0), np.zeros(0)  # weighted otherwise
        self.weights = {
            name: 1.0 / math.sqrt(max(sum(parts) / len(parts), 1e-300))
            for name, parts in squares.items()
        }

    def _solve(self, start: FloatArray) -> None:
        problem = self.problem
        low = np.array([free.low for free in problem.free])
        high = np.array([free.high for free in problem.free])
        inside = np.clip(start, low, high)
        sizes = np.array([max(abs(f.start), _TINY) if f.start else f.scale for f in problem.free])
        self.steps = steps_of(problem.free, start)
        least_squares(
            lambda x: self.values(x * sizes),
            _strictly_inside(inside, low, high) / sizes,
            jac=lambda x: self.differences(x * sizes) * sizes,
            bounds=(low / sizes, high / sizes),
            x_scale='jac', max_nfev=self.most, ftol=1e-5, xtol=1e-6, gtol=1e-10,
        )  # fmt: skip

    def values(self, x: FloatArray) -> FloatArray:
        """Return the weighted residuals and the deviations from the priors."""
        found = self._weighted(x)
        self.last = x.copy(), found
        cost = 0.5 * float(found @ found)
        self.evaluations += 1
        if self.evaluations == 1:
            self.started = time.monotonic()  # the first evaluation may compile: not counted
        if cost < self.best_cost:
            self.best, self.best_cost = x.copy(), cost
            self.report(self)
        return found

    def blocks(self) -> list[Block]:
        """Return each recording's weighted Jacobian and residual at the best values."""
        if not self.weights:
            self._weigh(0)
        self.steps = steps_of(self.problem.free, self.best)
        self.stop = lambda: False
        whole = self.differences(self.best)
        found: dict[int, list[Block]] = {}
        row = 0
        for name, task, used, values in self.problem.residuals(self.best):
            rows = slice(row, row + len(values))
            jacobian, residual = np.zeros((len(used), len(self.best))), np.zeros(len(used))
            jacobian[used], residual[used] = whole[rows], values * self.weights[name]
            found.setdefault(task, []).append((jacobian, residual))
            row += len(values)
        return [
            (np.stack([one for one, _ in parts]), np.stack([other for _, other in parts]))
            for parts in found.values()
        ]

    def _weighted(self, x: FloatArray) -> FloatArray:
        if self.stop():
            raise Stopped
        parts = [part.values * self.weights[part.channel] for part in self.problem.residuals(x)]
        return np.concatenate([*parts, self.problem.prior_residuals(x), self._anchor(x)])

    def _anchor(self, x: FloatArray) -> FloatArray:
        """Return the term that keeps numbers without information in the data near their start."""
        start = np.array([free.start for free in self.problem.free])
        scale = np.array([free.scale for free in self.problem.free])
        return np.asarray(ANCHOR * (x - start) / scale)

    def differences(self, x: FloatArray) -> FloatArray:
        """
        Return the Jacobian by differences, (n, p), each step as large as it needs to be.

        The step of a number grows until the residuals change enough.
        """
        centre = self.last[1] if np.array_equal(x, self.last[0]) else self._weighted(x)
        columns = []
        size = float(np.linalg.norm(centre)) + _TINY
        for place, free in enumerate(self.problem.free):
            column, step = self._difference(x, place, free.high, centre, size)
            self.steps[place] = step
            columns.append(column)
            self.report(self)
        self.iterations += 1
        return np.stack(columns, axis=1)

    def _difference(
        self, x: FloatArray, place: int, high: float, centre: FloatArray, size: float
    ) -> tuple[FloatArray, float]:
        step = float(self.steps[place])
        column = np.zeros_like(centre)
        for _ in range(8):
            there = x.copy()
            sign = 1.0 if x[place] + step <= high else -1.0
            there[place] += sign * step
            moved = self._weighted(there) - centre
            column = moved / (sign * step)
            change = float(np.linalg.norm(moved)) / size
            if change > 1e-6:
                break
            step *= 10.0 if change < 1e-7 else 3.0
        if change > 1e-3:
            step *= 1e-4 / change
        return column, step


def _strictly_inside(x: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the start, moved off the bounds, which SciPy does not allow."""
    margin = 1e-6 * np.where(np.isfinite(high - low), np.minimum(np.abs(high - low), 1.0), 1.0)
    return np.clip(x, low + margin * (np.abs(low) < 1e300), high - margin)
