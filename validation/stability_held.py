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
The laws that plan the motion at rest: growth rates over the latency, beside flights.

Rest is the last corner of the square, 8 s into the hold, when the gains have settled; the flight
is the square and the hold, 76 s in all, with 2 mm of noise.  The latency is varied, what the law
believes is not.
"""

from __future__ import annotations

from collections.abc import Iterator
import math
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.arm.kinematics import elastic_point, inverse_kinematics, make_point
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.timeline import NS_PER_S
from flexarm_ros.core.trajectory import make_path
from flexarm_ros.stability.sampled_loop import SampledLoop, sensor_of
import numpy as np
from validation.controllers import HOLD, HOLD_S, NOISE, SQUARE_S
from validation.tables import grouped, Lines, number, read, table

LATENCIES_MS = {
    'inverse': (0.0, 3.0, 4.0, 6.0),
    'passive': (0.0, 31.2, 60.0),
    'lqg': (0.0, 10.0, 20.0, 31.2, 50.0, 60.0),
    'adaptive': (0.0, 20.0, 31.2, 60.0),
}
SETTLED_S = SQUARE_S + 8.0
LAST_S = 10.0


def tasks() -> list[tuple[str, float]]:
    """Return law and latency, ms, of each row."""
    return [(law, ms) for law, all_ms in LATENCIES_MS.items() for ms in all_ms]


def row(task: tuple[str, float]) -> dict[str, Any]:
    """Return the growth rate at rest and how the flight ended."""
    law, ms = task
    config = scenario.load(f'{law}_smooth', HOLD)
    sensor = sensor_of(config)
    corner = make_path(config).at(round(SQUARE_S * NS_PER_S))[:2]
    theta2 = inverse_kinematics(config.plant.spans, *corner)[1]
    loop = SampledLoop(config, theta2, time=SETTLED_S)
    first = loop.eigenvalues(1.0, round(ms * 1e6))[0]
    flown = scenario.load(f'{law}_smooth', (*HOLD, NOISE, f'{sensor}.latency={ms / 1e3!r}'))
    flight, residual = ClosedLoop(flown), 0.0
    tip = make_point(flown.plant, sum(flown.plant.spans), True)
    while (record := flight.tick()) is not None:
        if record.k * loop.period >= SQUARE_S + HOLD_S - LAST_S:
            x, y, _, _ = elastic_point(record.q, record.qd, tip.shapes, tip.shortening)
            residual = max(residual, math.hypot(x - corner[0], y - corner[1]))
    return {
        'law': law, 'sensor': sensor, 'latency_ms': ms,
        'rate': math.log(abs(first)) / loop.period,
        'frequency': abs(float(np.angle(first))) / loop.period,
        'unstable_s': None if flight.unstable_tick is None else flight.unstable_tick * loop.period,
        'residual_mm': None if flight.unstable else 1e3 * residual,
    }  # fmt: skip


def lines() -> Lines:
    """Write a row a law and latency."""

    def cells() -> Iterator[tuple[str, ...]]:
        for (law, sensor), group in grouped(read('held'), 'law', 'sensor'):
            for r in group:
                ended = (
                    f"diverges after {float(r['unstable_s']):.3g} s" if r['unstable_s'] else
                    f"stable, {number(r['residual_mm'], 2)} mm"
                )  # fmt: skip
                yield (f'`{law}`', sensor, r['latency_ms'], number(r['rate'], 2),
                       number(r['frequency']), ended)  # fmt: skip

    return table(
        ('law', 'latency of', 'ms', 'growth at rest, 1/s', 'at, rad/s',
         'simulated: square and hold, largest tip error of the last 10 s'),
        cells(),
    )  # fmt: skip
