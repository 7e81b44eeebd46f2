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

from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice
import json
import math
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import Any

from bench.table import markdown, Part, Ratio
from flexarm_ros import scenario
from flexarm_ros.core.arm.plant_eq14 import Eq14Plant, step_eq14
from flexarm_ros.core.numerics.compiled import compiled
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import BLOCK_TICKS, loop_blocks

TICKS = 8192
ROUNDS = 5
MODES = (1, 2, 3, 4, 5, 6)
START_S = 0.6
"""Goal of the start-up, s."""

_START = """
import time
start = time.perf_counter()
from flexarm_ros import scenario
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
next(loop_blocks(ClosedLoop(scenario.load("fls_tip", ["duration=0.001"]))))
print(time.perf_counter() - start, time.process_time())
"""


@compiled
def steps_alone(plant: Any, count: int) -> None:
    """Advance the plant of (14) by ``count`` ticks without torque."""
    for _ in range(count):
        step_eq14(
            plant.state, 0.0, 0.0, plant.step, plant.substeps, plant.mass, plant.diagonals,
            plant.coupling, plant.matrix, plant.work,
        )  # fmt: skip


def run_blocks(config: RunConfig) -> Callable[[int], None]:
    """Return what runs a number of ticks in blocks, as ``simulate`` and sweeps do."""
    blocks = loop_blocks(ClosedLoop(config))
    return lambda count: deque(islice(blocks, -(-count // BLOCK_TICKS)), 0) and None


def run_ticks(config: RunConfig) -> Callable[[int], None]:
    """Return what runs a number of ticks one by one, from Python."""
    loop = ClosedLoop(config)

    def run(count: int) -> None:
        for _ in range(count):
            loop.tick()

    return run


def run_steps(config: RunConfig) -> Callable[[int], None]:
    """Return what advances only the plant of (14)."""
    record = Eq14Plant(config).record()
    return lambda count: steps_alone(record, count)


def in_turns(
    config: RunConfig, *makers: Callable[[RunConfig], Callable[[int], None]], ticks: int = TICKS
) -> list[float]:
    """Return the processor time of a tick, us, of each way to run it: the best of some turns."""
    best = [math.inf] * len(makers)
    for _ in range(ROUNDS + 1):  # the first compiles
        for i, make in enumerate(makers):
            run = make(config)
            run(BLOCK_TICKS)
            used = time.process_time()
            run(ticks)
            best[i] = min(best[i], (time.process_time() - used) / ticks)
    return [seconds * 1e6 for seconds in best]


def measure() -> Part:
    """Time the loop by itself, over modes, and the start."""
    config = scenario.load('fls_tip')
    blocks, ticks, step = in_turns(config, run_blocks, run_ticks, run_steps)
    start_wall, start_cpu = start_up()
    whole = whole_simulation()
    text = (
        f'`flexarm simulate fls_tip` (16 s, no pictures): {whole["wall_s"]:.2f} s of wall time '
        f'from the first tick to the last with the bag written beside ({whole["rtf"]:.0f} times '
        f"real time), {whole['all_s']:.2f} s from the shell's prompt back to it, start-up, "
        f'`trajectory.csv` and `summary.json` included. The loop alone takes {blocks:.2f} us of '
        f'processor time a tick in compiled blocks, {ticks:.1f} us tick by tick; the step of the '
        f'plant is {step:.2f} us of it.'
    )
    ratios = [
        Ratio(
            '`simulate`, one mode a link, in the loop: simulated / processor time', '1000 us',
            f'{blocks:.2f} us', 1000.0 / blocks, 50.0, True, f'best of {ROUNDS}, {TICKS} ticks',
        ),
        Ratio(
            'loop of `fls_tip`, a tick in a block / the step alone', f'{blocks:.2f} us',
            f'{step:.2f} us', blocks / step, 2.2, False, 'in turns, processor time',
        ),
        Ratio(
            'loop of `fls_tip`, single ticks / blocks', f'{blocks:.2f} us', f'{ticks:.1f} us',
            ticks / blocks, None, True, 'in turns, processor time; the same bytes',
        ),
        Ratio(
            f'start-up, import to first tick, warm caches / {START_S:g} s', f'{start_wall:.2f} s',
            f'{START_S:g} s', start_wall / START_S, 1.0, False,
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
            blocks, ticks = in_turns(config, run_blocks, run_ticks, ticks=1024)
            steps = ClosedLoop(config).plant.substeps
            rows.append(
                (f'`{model}`', f'{modes}', f'{steps}', f'{blocks:.2f}', f'{ticks:.1f}',
                 f'{1000.0 / blocks:.0f}')
            )  # fmt: skip
    head = ('model', 'modes a link', 'integrator steps', 'blocks, us a tick',
            'single ticks, us a tick', 'times real time (blocks)')  # fmt: skip
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
