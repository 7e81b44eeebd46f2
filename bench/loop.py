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

"""The closed loop in one process: cost a tick, start-up, writing the files."""

from __future__ import annotations

from collections.abc import Sequence
import json
from pathlib import Path
import subprocess
import sys
import tempfile
import time

from bench.table import markdown, Part, Ratio
from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
from flexarm_ros.core.run.warmup import warm_up

TICKS = 4000
ROUNDS = 5
MODES = (1, 2, 3, 4, 5, 6)

_START = """
import time
start = time.perf_counter()
from flexarm_ros import scenario
from flexarm_ros.core.run.loop import ClosedLoop
ClosedLoop(scenario.load("fls_tip")).tick()
print(time.perf_counter() - start, time.process_time())
"""


def loop_us(config: RunConfig, blocks: bool = False, ticks: int = TICKS) -> tuple[float, float]:
    """
    Return wall and processor time of a tick in the loop, us: the best of some runs.

    ``blocks``: with the messages of each tick collected for the bag, as ``simulate`` does.
    """
    warm_up(config)
    wall, cpu = [], []
    for _ in range(ROUNDS):
        loop = ClosedLoop(config)
        start, used = time.perf_counter(), time.process_time()
        if blocks:
            for _ in loop_blocks(loop):
                if loop.k >= ticks:
                    break
        else:
            while loop.k < ticks and loop.tick() is not None:
                pass
        wall.append((time.perf_counter() - start) / loop.k)
        cpu.append((time.process_time() - used) / loop.k)
    return min(wall) * 1e6, min(cpu) * 1e6


def measure() -> Part:
    """Time the loop by itself, over modes, and the start."""
    config = scenario.load('fls_tip')
    wall, cpu = loop_us(config)
    _, blocks = loop_us(config, blocks=True)
    start_wall, start_cpu = start_up()
    whole = whole_simulation()
    text = (
        f'`flexarm simulate fls_tip` (16 s, no pictures): {whole["wall_s"]:.2f} s of wall time '
        f'from the first tick to the last with the bag written beside ({whole["rtf"]:.0f} times '
        f"real time), {whole['all_s']:.2f} s from the shell's prompt back to it, start-up, "
        f'`trajectory.csv` and `summary.json` included. The loop alone takes {cpu:.1f} us of '
        'processor time a tick, with the messages of a tick collected for the bag '
        f'{blocks:.1f} us.'
    )
    ratios = [
        Ratio(
            '`simulate`, one mode a link, in the loop: simulated / processor time', '1000 us',
            f'{cpu:.1f} us', 1000.0 / cpu, 50.0, True,
            f'best of {ROUNDS}, {TICKS} ticks; by wall time {1000.0 / wall:.0f}',
        ),
        Ratio(
            'start-up, import to first tick, warm caches / 1.5 s', f'{start_wall:.2f} s', '1.5 s',
            start_wall / 1.5, 1.0, False,
            f'best of {ROUNDS}; {start_cpu:.2f} s of processor time',
        ),
    ]  # fmt: skip
    return Part('loop', ratios, [text, _modes()])


def _modes() -> str:
    rows = []
    for model in ('eq14', 'full'):
        for modes in MODES:
            config = scenario.load(
                'fls_full' if model == 'full' else 'fls_tip', [f'plant.modes={modes}']
            )
            wall, cpu = loop_us(config, ticks=1000)
            steps = ClosedLoop(config).plant.substeps
            rows.append(
                (f'`{model}`', f'{modes}', f'{steps}', f'{wall:.1f}', f'{cpu:.1f}',
                 f'{1000.0 / cpu:.0f}')
            )  # fmt: skip
    head = ('model', 'modes a link', 'integrator steps', 'wall, us a tick',
            'processor, us a tick', 'times real time (processor)')  # fmt: skip
    return markdown(head, rows)


def start_up() -> tuple[float, float]:
    """Return wall and processor time from import to the end of the first tick, s."""
    found = []
    for _ in range(ROUNDS + 1):  # the first may have to fill the caches
        done = subprocess.run(
            [sys.executable, '-c', _START], capture_output=True, text=True, check=True, timeout=120
        )
        wall, cpu = done.stdout.split()
        found.append((float(wall), float(cpu)))
    return min(found[1:])


def whole_simulation(words: Sequence[str] = ()) -> dict[str, float]:
    """Run ``flexarm simulate fls_tip`` and return what it says and what it took."""
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        out = Path(folder) / 'run'
        command = [sys.executable, '-m', 'flexarm_ros.cli', 'simulate', 'fls_tip',
                   '--no-pictures', '--out', str(out), *words]  # fmt: skip
        start = time.perf_counter()
        subprocess.run(command, check=True, capture_output=True, timeout=300)
        all_s = time.perf_counter() - start
        told = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
    return {'wall_s': told['wall_s'], 'rtf': told['rtf'], 'all_s': all_s}
