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

"""What grows with the length of a run, with the number of modes and of sensors: curves."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

from bench.loop import in_turns, MODES, run_blocks
from bench.table import markdown, Part, Ratio
from flexarm_ros import scenario

MINUTES = (1, 10, 100)
WITH_BAG = 10
"""Longest run, minutes, run with a bag too: the longer one would take the time of all."""

SENSORS = (0, 1, 2, 5, 10, 20)
"""Numbers of sensors at ``tip_sensor.more_locations``."""

LONGEST_S = 400.0
"""Wall time beyond which a longer run is left out."""

PICTURE = Path('docs/images/growth.png')


# `ru_maxrss` of a child is at least what its parent had when it was started: it tells itself.
_TOLD = r"""
import re, sys
from flexarm_ros.cli import main
status = main(sys.argv[1:])
peak = re.search(r'VmHWM:\s*(\d+) kB', open('/proc/self/status').read())
print(int(peak[1]) / 1024, file=sys.stderr)
sys.exit(status)
"""


class Used(NamedTuple):
    """What a run took: wall and processor time in s, peak memory in MiB."""

    wall: float
    processor: float
    memory: float


def measure() -> Part:
    """Simulate ever longer runs, then more modes and more sensors, and draw the curves."""
    plain, note = _lengths()
    bag = {m: simulate(m) for m in plain if m <= WITH_BAG}
    modes = {m: in_turns(
        scenario.load('fls_tip', [f'plant.modes={m}']), run_blocks, ticks=1024
    )[0]
             for m in MODES}  # fmt: skip
    sensors = _sensors()
    _draw(plain, bag, modes, sensors)
    text = [_length_table(plain, bag), *note]
    rows = [(f'{count}', f'{us:.1f}') for count, us in sensors.items()]
    text.append(markdown(('extra tip sensors', 'processor, us a tick'), rows))
    text.append('![Growth](images/growth.png)')
    return Part('growth', [_memory('simulate --no-bag', plain), _memory('simulate', bag)], text)


def _lengths() -> tuple[dict[int, Used], list[str]]:
    """Simulate without a bag, longer and longer, as long as the next one will be done in time."""
    found: dict[int, Used] = {}
    for minutes in MINUTES:
        if found and found[max(found)].wall * minutes / max(found) > LONGEST_S:
            return found, [f'{minutes} minutes were left out: this machine is too busy now.']
        found[minutes] = simulate(minutes, '--no-bag')
    return found, []


def _length_table(plain: dict[int, Used], bag: dict[int, Used]) -> str:
    rows = []
    for minutes, used in plain.items():
        more = bag.get(minutes)
        with_bag = (f'{more.processor:.1f}', f'{more.memory:.0f}') if more else ('', '')
        rows.append((f'{minutes}', f'{used.wall:.1f}', f'{used.processor:.1f}',
                     f'{used.memory:.0f}', *with_bag))  # fmt: skip
    head = ('simulated minutes', 'wall, s', 'processor, s', 'peak memory, MiB',
            'processor with a bag, s', 'peak memory with a bag, MiB')  # fmt: skip
    return markdown(head, rows)


def _memory(command: str, runs: dict[int, Used]) -> Ratio:
    first, last = min(runs), max(runs)
    return Ratio(
        f'peak memory of `{command}`, {last} / {first} simulated minutes',
        f'{runs[last].memory:.0f} MiB', f'{runs[first].memory:.0f} MiB',
        runs[last].memory / runs[first].memory, 1.1, False, 'one run each',
    )  # fmt: skip


def simulate(minutes: int, *words: str) -> Used:
    """Run ``flexarm simulate`` for so long; return wall s, processor s and peak memory in MiB."""
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        command = [sys.executable, '-c', _TOLD, 'simulate', 'fls_tip',
                   '--no-pictures', '--set', f'duration={60 * minutes}',
                   '--out', str(Path(folder) / 'run'), *words]  # fmt: skip
        start = time.perf_counter()
        process = subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        try:
            said = process.stderr.read()
            _, status, used = os.wait4(process.pid, 0)
        except BaseException:
            process.kill()
            raise
        process.returncode = os.waitstatus_to_exitcode(status)
        wall = time.perf_counter() - start
    if process.returncode:
        raise ArithmeticError(f'simulate of {minutes} minutes: exit {process.returncode}')
    return Used(wall, used.ru_utime + used.ru_stime, float(said.split()[-1]))


def _sensors() -> dict[int, float]:
    """Return the cost of a tick for a number of extra tip sensors, us of processor time."""
    found = {}
    for count in SENSORS:
        places = [f'tip_sensor.more_locations={[4.5 + 0.2 * i for i in range(count)]}']
        config = scenario.load('fls_tip', places if count else [])
        found[count] = in_turns(config, run_blocks)[0]
    return found


def _draw(plain: dict[int, Used], bag: dict[int, Used], modes: dict[int, float],
          sensors: dict[int, float]) -> None:  # fmt: skip
    from flexarm_ros.analysis.figures.style import BLUE, drawing, new_figure, ORANGE

    with drawing():
        figure = new_figure(9.6, 2.8)
        axes = figure.subplots(1, 4)
        for values, color, label in ((plain, BLUE, 'no bag'), (bag, ORANGE, 'with a bag')):
            axes[0].loglog(list(values), [v.processor for v in values.values()], 'o-', color=color)
            axes[1].semilogx(
                list(values), [v.memory for v in values.values()], 'o-', color=color, label=label
            )
        axes[0].set(xlabel='simulated minutes', ylabel='processor time, s')
        most = max(used.memory for used in (*plain.values(), *bag.values()))
        axes[1].set(xlabel='simulated minutes', ylabel='peak memory, MiB', ylim=(0.0, 1.25 * most))
        axes[1].legend(loc='lower right')
        axes[2].plot(list(modes), list(modes.values()), 'o-', color=BLUE)
        axes[2].set(xlabel='modes a link', ylabel='us a tick', ylim=(0.0, None))
        axes[3].plot(list(sensors), list(sensors.values()), 'o-', color=BLUE)
        axes[3].set(xlabel='extra tip sensors', ylabel='us a tick', ylim=(0.0, None))
        figure.savefig(PICTURE, dpi=110)
