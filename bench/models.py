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

"""The fuzzy system beside scikit-fuzzy, the plant's step beside SciPy and Exudyn."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from bench.table import markdown, Part, Ratio
from flexarm_ros import scenario
from flexarm_ros.core.arm.plant_eq14 import _acceleration, Eq14Matrices
from flexarm_ros.core.control.fls import fls_lambda
from flexarm_ros.core.control.fls_definition import build, INPUTS, OUTPUT
from flexarm_ros.core.numerics.compiled import compiled
from flexarm_ros.core.run.make_plant import make_plant
import numpy as np
from scipy.integrate import solve_ivp
from skfuzzy import control


@compiled
def acceleration(
    q: Any, qd: Any, tau1: float, tau2: float, mass: Any, diagonals: Any, coupling: float,
    matrix: Any, out: Any,
) -> None:  # fmt: skip
    """Call the plant's right-hand side, which has no entry from Python."""
    _acceleration(q, qd, tau1, tau2, mass, diagonals, coupling, matrix, out)


SECONDS = 1.0
TORQUE = (60.0, -20.0)
_GRID = np.linspace(-0.9, 0.9, 7)


def best(call: Callable[[], Any], rounds: int = 5) -> float:
    """Return the least processor time of ``call``, s: what it takes on an idle machine."""
    found = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        found.append(time.process_time() - start)
    return min(found)


def measure() -> Part:
    """Compare all three."""
    ratios = [_fuzzy()]
    scipy_ratios, rows = _steps()
    ratios += scipy_ratios
    text = [
        markdown(
            (
                'one second of motion, constant torque, by',
                'error at its end',
                'processor time, ms',
            ),
            rows,
        )
    ]
    try:
        from bench import exudyn_step
    except ImportError:
        text.append('Exudyn is not installed here, so it is not compared.')
    else:
        ratio, table = exudyn_step.measure()
        ratios.append(ratio)
        text.append(table)
    return Part('models', ratios, text)


def _fuzzy() -> Ratio:
    """Time the exact evaluation and scikit-fuzzy's own; refuse to where they differ."""
    simulation = control.ControlSystemSimulation(build(), cache=False)
    points = [(float(a), float(b)) for a in _GRID for b in _GRID]

    def slow() -> list[float]:
        values = []
        for a, b in points:
            simulation.input[INPUTS[0]], simulation.input[INPUTS[1]] = a, b
            simulation.compute()
            values.append(float(simulation.output[OUTPUT]))
        return values

    def fast() -> list[float]:
        return [fls_lambda(a, b) for _ in range(200) for a, b in points]

    worst = max(abs(x - y) for x, y in zip(slow(), fast(), strict=False))
    if worst > 1e-6:
        raise ArithmeticError(f'the fuzzy systems differ by {worst}')
    theirs, ours = best(slow, 3) / len(points), best(fast) / len(points) / 200
    return Ratio(
        "scikit-fuzzy's `compute` / our evaluation", f'{ours * 1e6:.2f} us',
        f'{theirs * 1e3:.1f} ms', theirs / ours, 1000.0, True,
        f'{len(points)} points, the same values to {worst:.0e}; '
        'processor time, best of 3 and of 5',
    )  # fmt: skip


def _steps() -> tuple[list[Ratio], list[tuple[str, ...]]]:
    """Compare RK4 in the plant with solve_ivp on the same compiled right-hand side."""
    config = scenario.load('pd_tip')
    plant = make_plant(config)
    matrices, size = Eq14Matrices(config.plant), len(plant.q)
    start = np.concatenate([plant.q, plant.qd])
    ticks = round(SECONDS / config.run.control_period)
    work = (
        matrices.mass, np.stack([matrices.stiffness, matrices.damping, matrices.end_shape]),
        matrices.coupling, np.zeros((size, size)), np.zeros(size),
    )  # fmt: skip

    def slope(_: float, state: Any) -> Any:
        acceleration(state[:size], state[size:], *TORQUE, *work)
        return np.concatenate([state[size:], work[4]])

    def ours() -> Any:
        plant.set_state(start[:size], start[size:])
        for _ in range(ticks):
            plant.step(*TORQUE)
        return np.concatenate([plant.q, plant.qd])

    def once(method: str, tolerance: float) -> Any:
        span = (0.0, SECONDS)
        found = solve_ivp(slope, span, start, method, rtol=tolerance, atol=1e-3 * tolerance)
        return found.y[:, -1]

    def tick_by_tick(method: str, tolerance: float, count: int = 100) -> Any:
        state = start
        for _ in range(count):  # as in the loop, where the torque changes at each tick
            span = (0.0, SECONDS / ticks)
            found = solve_ivp(slope, span, state, method, rtol=tolerance, atol=1e-3 * tolerance)
            state = found.y[:, -1]
        return state

    exact = once('DOP853', 1e-13)
    error = _error(ours(), exact)
    wall = best(ours)
    rows = [('our plant, a step of RK4 a tick', f'{error:.1e}', f'{wall * 1e3:.2f}')]
    ratios = []
    for method in ('RK45', 'DOP853'):
        tolerance = next(
            t
            for t in 10.0 ** -np.arange(3.0, 13.0, 0.5)
            if _error(once(method, t), exact) <= error
        )
        reached = _error(once(method, tolerance), exact)
        theirs = best(lambda m=method, t=tolerance: once(m, t), 3)
        stepped = best(lambda m=method, t=tolerance: tick_by_tick(m, t), 2) * ticks / 100
        name = f"SciPy's `solve_ivp`, {method}, rtol {tolerance:.0e}"
        rows.append((f'{name}, in one call', f'{reached:.1e}', f'{theirs * 1e3:.2f}'))
        rows.append((f'{name}, tick by tick', '', f'{stepped * 1e3:.0f}'))
        ratios.append(
            Ratio(
                f'`solve_ivp` ({method}) / our plant, one second at equal error',
                f'{wall * 1e3:.2f} ms', f'{theirs * 1e3:.2f} ms', theirs / wall, None, True,
                'in one call, which a control loop cannot have; processor time, best of 3',
            )
        )  # fmt: skip
    return ratios, rows


def _error(state: Any, exact: Any) -> float:
    return float(np.abs(state - exact).max())
