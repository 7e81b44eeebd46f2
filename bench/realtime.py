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
Free-running runs beside a bare clock_nanosleep loop: how late the plant's ticks are.

The bare loop and the runs take turns in one measurement, with the same period and length.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import json
from pathlib import Path
import subprocess
import sys
import tempfile
from typing import Any

from bench.launch import LIMIT_S, MeasurementFailed
from bench.table import markdown, Part, Ratio
from flexarm_ros.core.run.results.real_time import spread
from flexarm_ros.nodes.realtime.measure import bare_jitter
from flexarm_ros.nodes.realtime.system import can_prioritise, prioritised

SECONDS = 10.0
"""Wall time of each run at 1 kHz; a minute at 200 Hz, where no tick may be late."""

MINUTE = 60.0
_PRIORITY = 10
_OUTSIDE = ('--node', f'controller={sys.executable} examples/minimal_controller.py')

RUNS: tuple[tuple[str, float, float, tuple[str, ...]], ...] = (
    ('six processes', 0.001, SECONDS, ()),
    ('composed', 0.001, SECONDS, ('--compose',)),
    ('composed, the controller outside', 0.001, SECONDS, ('--compose', *_OUTSIDE)),
    ('six processes', 0.005, MINUTE, ()),
)
"""Name, period in s, length in s, words of ``flexarm run``."""


def measure() -> Part:
    """Measure the bare loop and the runs."""
    rows, ratios = [], []
    for period in dict.fromkeys(run[1] for run in RUNS):
        for fifo in (False, True) if can_prioritise(_PRIORITY) else (False,):
            name = f'bare loop{", SCHED_FIFO" if fifo else ""}'
            rows.append(_row(name, period, SECONDS, bare(period, fifo)))
        for name, each, seconds, words in RUNS:
            if each == period:
                found = flown(period, seconds, words)
                rows.append(_row(name + found['remark'], period, seconds, found))
                if seconds == MINUTE:
                    wall = seconds / found['factor']
                    ratios.append(Ratio(
                        'free-running minute at 200 Hz, six processes: wall / simulated time',
                        f'{wall:.4f} s', f'{seconds:g} s', wall / seconds, 1.001, False,
                        f'one run, {found["late_ticks"]} late ticks',
                    ))  # fmt: skip
    head = ('rate', 'run', 'late ticks', 'jitter p50, ms', 'p99, ms', 'max, ms',
            'missed commands', 'latency p50, ms', 'p99, ms', 'max, ms')  # fmt: skip
    text = [markdown(head, rows)]
    return Part('realtime', ratios, text)


def bare(period: float, fifo: bool) -> dict[str, Any]:
    """Return late ticks and jitter of the bare loop, as ``real_time`` has them."""
    loop: Callable[[], Any] = partial(bare_jitter, round(period * 1e9), round(SECONDS / period))
    if fifo:
        with prioritised(_PRIORITY):
            jitter = loop()
    else:
        jitter = loop()
    return {'late_ticks': int((jitter >= period).sum()), 'tick_jitter_ms': spread(jitter)}


def flown(period: float, seconds: float, words: tuple[str, ...]) -> dict[str, Any]:
    """Return ``real_time`` of a free-running run of pd_tip, and a remark if it was unstable."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / 'run'
        done = subprocess.run(
            [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'pd_tip', '--rtf', '1',
             '--set', 'sync=free', '--set', f'duration={seconds}',
             '--set', f'control_period={period}', '--set', 'plant.command_hold=30',
             '--no-pictures', '--out', str(out), *words],
            capture_output=True, text=True, timeout=LIMIT_S, check=False,
        )  # fmt: skip
        summary = json.loads((out / 'summary.json').read_text(encoding='utf-8'))
        if done.returncode and summary['stable'] is not False:
            raise MeasurementFailed(done.stderr.strip().splitlines()[-1])
    # A controller that falls behind makes the arm unstable: that is a result too.
    remark = '' if summary['stable'] else f', unstable at tick {summary["unstable_tick"]}'
    return {**summary['real_time'], 'remark': remark}


def _row(name: str, period: float, seconds: float, found: dict[str, Any]) -> tuple[str, ...]:
    jitter, latency = (
        [f'{value:.3f}' for value in found[key].values()] if key in found else [''] * 3
        for key in ('tick_jitter_ms', 'command_latency_ms')
    )
    return (
        f'{1.0 / period:.0f} Hz, {seconds:g} s', name, str(found['late_ticks']), *jitter,
        str(found.get('missed_commands', '')), *latency,
    )  # fmt: skip
