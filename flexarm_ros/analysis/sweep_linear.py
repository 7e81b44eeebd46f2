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
The linear stability boundary of a sweep over two parameters.

At each point of the grid the loop is linearised about rest, at poses along the trajectory, as in
``flexarm stability``; randomly drawn parameters have the scenario's values.  Between a stable and
an unstable neighbour the boundary is found by bisection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
import itertools
import math
from typing import Any

from flexarm_ros.analysis.spawning import worker_context
from flexarm_ros.analysis.sweep.worker import start_worker
from flexarm_ros.core.control import LAWS
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.scenario import ScenarioError, with_values
from flexarm_ros.scenario.plugins.registry import find_plugins_of
from flexarm_ros.scenario.sweeps.axes import numbers_in, Parameter
from flexarm_ros.scenario.sweeps.sweep import Sweep
from flexarm_ros.stability.margins import poses_along, ROUNDING
from flexarm_ros.stability.sampled_loop import left_out, SampledLoop, sensor_of

MOST_POINTS = 5000
LONGEST_S = 0.1
"""Longest latency that is analysed: the cost of an eigenvalue grows with its cube."""

HALVINGS = 7
WORST, BEST = 0, 1

Rates = tuple[float, float]
"""Growth rate, 1/s, of the fastest mode: at the worst of the poses, at the best of them."""

Edge = tuple[int, int]


@dataclass
class Linear:
    """
    The analysis of a sweep's grid, by the index of the point.

    ``rates``: where the loop has a linear form; ``notes``: the reason elsewhere.  ``crossings``:
    for WORST and BEST, where stability ends between two points, as a fraction of the distance
    from the first.  ``ignored``: scenario keys that the analysis leaves out.  ``refused``: the
    reason if nothing is analysed.
    """

    rates: dict[int, Rates] = field(default_factory=dict)
    notes: dict[int, str] = field(default_factory=dict)
    crossings: tuple[dict[Edge, float], dict[Edge, float]] = field(
        default_factory=lambda: ({}, {})
    )
    ignored: tuple[str, ...] = ()
    refused: str = ''

    def reasons(self) -> list[str]:
        """Return the reasons for a missing or incomplete boundary."""
        return [self.refused] if self.refused else sorted(set(self.notes.values()))


def analyse_grid(sweep: Sweep, workers: int, stop: Callable[[], bool]) -> Linear | None:
    """Analyse every point of the grid; None for a sweep without a map, or after ``stop()``."""
    if sweep.plan is None or not sweep.plan.y:
        return None
    if sweep.points > MOST_POINTS:
        return Linear(refused=f'{sweep.points} points; at most {MOST_POINTS} are analysed')
    found = Linear()
    context = worker_context()
    with ProcessPoolExecutor(workers, context, start_worker, ((), context.Event())) as pool:
        try:
            _analyse(sweep, found, lambda call, jobs: _mapped(pool, call, jobs, stop))
        except _StoppedError:
            pool.shutdown(cancel_futures=True)
            return None
        except BrokenProcessPool:
            found.refused = 'a process of the linear analysis died'
    return found


class _StoppedError(Exception):
    """The command is being stopped."""


def _mapped(
    pool: ProcessPoolExecutor, call: Callable[[Any], Any], jobs: Sequence[Any],
    stop: Callable[[], bool],
) -> Iterator[Any]:  # fmt: skip
    for result in pool.map(call, jobs, chunksize=4):
        if stop():
            raise _StoppedError
        yield result


def _analyse(sweep: Sweep, found: Linear, mapped: Callable[..., Iterable[Any]]) -> None:
    configs: dict[int, RunConfig] = {}
    for point in range(sweep.points):
        base, overrides = sweep.point(point)
        try:
            configs[point] = with_values(sweep.bases[base], overrides)
        except ScenarioError:
            continue  # its rows report the error
    for point, result in zip(configs, mapped(_rates_or_note, list(configs.values())), strict=True):
        if isinstance(result, str):
            found.notes[point] = result
        else:
            found.rates[point] = result
    kept = {key: None for config in configs.values() for key in left_out(config)}
    found.ignored = tuple(kept)
    for which in (WORST, BEST):
        edges = [
            (names, edge)
            for names, edge in _edges(sweep)
            if all(point in found.rates for point in edge)
            and len({found.rates[point][which] > 0.0 for point in edge}) == 2
        ]
        jobs = [
            (configs[edge[0]], names, *_ends(sweep, names, edge), which) for names, edge in edges
        ]
        for (_, edge), part in zip(edges, mapped(_crossing, jobs), strict=True):
            found.crossings[which][edge] = part


def _edges(sweep: Sweep) -> Iterator[tuple[tuple[str, ...], Edge]]:
    """Yield neighbours on the grid, lower index first, and the parameters that differ."""
    assert sweep.plan is not None
    stride = 1
    for name, texts in reversed(sweep.axes.items()):
        if name in (sweep.plan.x, sweep.plan.y):
            names = (name, *(tied for tied, other in sweep.ties.items() if other == name))
            order = sorted(range(len(texts)), key=lambda i: numbers_in(texts[i])[0])
            for here, there in itertools.pairwise(order):
                for point in range(sweep.points):
                    if point // stride % len(texts) == here:
                        neighbour = point + (there - here) * stride
                        yield names, (min(point, neighbour), max(point, neighbour))
        stride *= len(texts)


def _ends(sweep: Sweep, names: Sequence[str], edge: Edge) -> tuple[str, str]:
    first, second = (sweep.axis_text(names[0], point) for point in edge)
    return first, second


def growth_rates(config: RunConfig) -> Rates:
    """
    Return the growth rates, 1/s, of the loop about rest at its worst and at its best pose.

    Above 0 it is unstable.  Raises ``ValueError`` with the reason for a loop that cannot be
    analysed.
    """
    law, sensor = config.controller.law, sensor_of(config)
    if LAWS[law].TIME_VARYING:
        raise ValueError(f'controller.law: {law} has gains that change with the time')
    if config.section(sensor).latency > LONGEST_S:
        raise ValueError(f'{sensor}.latency: above {LONGEST_S:g} s')
    rates = []
    for pose in poses_along(config):
        loop = SampledLoop(config, pose.theta2, time=pose.time)
        rates.append(math.log(max(loop.modulus() - ROUNDING, 1e-300)) / loop.period)
    return max(rates), min(rates)


def _rates_or_note(config: RunConfig) -> Rates | str:
    find_plugins_of(config)
    try:
        return growth_rates(config)
    except ValueError as error:
        return str(error)


def _crossing(job: tuple[RunConfig, tuple[str, ...], str, str, int]) -> float:
    """Return where stability changes between two values of some parameters, as a fraction."""
    config, names, first, second, which = job
    find_plugins_of(config)
    low, high, unstable = 0.0, 1.0, growth_rates(config)[which] > 0.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        text = Parameter.named(names[0]).between(first, second, middle)
        settings = tuple(Parameter.named(name).override(text) for name in names)
        try:
            same = (growth_rates(with_values(config, settings))[which] > 0.0) == unstable
        except ValueError:  # no valid scenario between them: the middle is the best estimate
            break
        low, high = (middle, high) if same else (low, middle)
    return 0.5 * (low + high)


def linear_table(sweep: Sweep, linear: Linear) -> dict[str, list[Any]]:
    """Return the analysis as columns, one row per point of the grid."""
    points = range(sweep.points)
    table: dict[str, list[Any]] = {
        'scenario': [sweep.scenarios[sweep.point(point)[0]] for point in points]
    }
    for name in sweep.axes:
        table[name] = [sweep.axis_text(name, point) for point in points]
    for which, name in ((WORST, 'worst_rate'), (BEST, 'best_rate')):
        table[name] = [linear.rates[p][which] if p in linear.rates else None for p in points]
    table['note'] = [linear.notes.get(point, '') for point in points]
    return table
