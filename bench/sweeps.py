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

"""Sweeps: 1000 runs with one worker and with two, and the grid of the stability map."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile
import time

from bench.table import markdown, Part, Ratio

RUNS, SECONDS, GOAL_S = 1000, 16.0, 20.0
_SWEEP = f"""
scenario: fls_tip
set: {{duration: {SECONDS}}}
draw: {{count: {RUNS}, seed: 1, parameters: {{plant.flexural_rigidity: {{factor: [0.9, 1.1]}}}}}}
"""
MAP = 'stability_map'
"""The shipped sweep of docs/stability.md: location x latency of the sensor."""


def measure() -> Part:
    """Run a sweep with 1 and with 2 workers, whose tables must agree, then the map."""
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        there = Path(folder)
        file = there / 'sweep.yaml'
        file.write_text(_SWEEP, encoding='utf-8')
        walls = {workers: sweep(file, workers, there / f'with{workers}') for workers in (1, 2)}
        tables = {(there / f'with{workers}' / 'table.csv').read_bytes() for workers in walls}
        if len(tables) > 1:
            raise ArithmeticError('the tables of 1 and of 2 workers differ')
        mapped = sweep(MAP, 2, there / 'map')
        grid = len((there / 'map' / 'table.csv').read_text(encoding='utf-8').splitlines()) - 1
    how = 'one run, start-up of the workers included'
    ratios = [
        Ratio(
            f'sweep of {RUNS} runs of {SECONDS:g} s with 2 workers / {GOAL_S:g} s',
            f'{walls[2]:.1f} s', f'{GOAL_S:g} s', walls[2] / GOAL_S, 1.0, False, how,
        ),
        Ratio(
            'the same sweep, 1 worker / 2 workers', f'{walls[2]:.1f} s', f'{walls[1]:.1f} s',
            walls[1] / walls[2], None, True, 'one run each, tables equal byte for byte',
        ),
    ]  # fmt: skip
    rows = [
        (f'{RUNS} runs of {SECONDS:g} s, {workers} worker{"s" if workers > 1 else ""}',
         f'{wall:.1f}', f'{RUNS / wall:.1f}') for workers, wall in walls.items()
    ]  # fmt: skip
    rows.append((f'`{MAP}`, {grid} runs, 2 workers', f'{mapped:.1f}', f'{grid / mapped:.1f}'))
    return Part('sweeps', ratios, [markdown(('sweep', 'wall time, s', 'runs a second'), rows)])


def sweep(name: Path | str, workers: int, out: Path) -> float:
    """Run ``flexarm sweep`` without pictures; return its wall time, s."""
    command = [sys.executable, '-m', 'flexarm_ros.cli', 'sweep', str(name), '--workers',
               str(workers), '--out', str(out), '--no-pictures']  # fmt: skip
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True, timeout=900)
    return time.perf_counter() - start
