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

"""Sweeps: runs a second with one worker and with two."""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile
import time

from bench.table import markdown, Part, Ratio

RUNS, SECONDS = 48, 16.0
_SWEEP = f"""
scenario: fls_tip
set: {{duration: {SECONDS}}}
draw: {{count: {RUNS}, seed: 1, parameters: {{plant.flexural_rigidity: {{factor: [0.9, 1.1]}}}}}}
"""


def measure() -> Part:
    """Fly the same sweep with 1 and with 2 worker processes, and see that the tables agree."""
    rows, walls, tables = [], {}, {}
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        file = Path(folder) / 'sweep.yaml'
        file.write_text(_SWEEP, encoding='utf-8')
        for workers in (1, 2):
            out = Path(folder) / f'with{workers}'
            command = [sys.executable, '-m', 'flexarm_ros.cli', 'sweep', str(file), '--workers',
                       str(workers), '--out', str(out), '--no-pictures']  # fmt: skip
            start = time.perf_counter()
            subprocess.run(command, check=True, capture_output=True, timeout=600)
            walls[workers] = time.perf_counter() - start
            tables[workers] = (out / 'table.csv').read_bytes()
            thousand = walls[workers] / RUNS * 1000 / 60
            rows.append((f'{workers}', f'{walls[workers]:.1f}', f'{RUNS / walls[workers]:.2f}',
                         f'{thousand:.1f}'))  # fmt: skip
    if tables[1] != tables[2]:
        raise ArithmeticError('the tables of 1 and of 2 workers differ')
    ratio = Ratio(
        f'sweep of {RUNS} runs of {SECONDS:g} s, 1 worker / 2 workers', f'{walls[2]:.1f} s',
        f'{walls[1]:.1f} s', walls[1] / walls[2], None, True,
        'one each, start-up of the workers included, tables equal byte for byte',
    )  # fmt: skip
    head = ('workers', 'wall time, s', 'runs a second', '1000 runs, minutes')
    return Part('sweeps', [ratio], [markdown(head, rows)])
