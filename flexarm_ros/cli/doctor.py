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

"""``flexarm doctor``: real-time permissions and timing of this machine."""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
from pathlib import Path
import platform
import time
from typing import Any

from flexarm_ros.cli.options.numbers import number
from flexarm_ros.cli.version import package_version

_PRIORITY = 10


def add_parser(make: Any) -> None:
    """Add the command to the main parser; ``make`` returns its parser."""
    parser = make(
        description='Print which requests of a free-running run (sync: free) are allowed here '
        '(SCHED_FIFO, CPUs, locked memory), and measure how late a bare loop with absolute '
        'deadlines (clock_nanosleep) wakes up, without and, where allowed, with SCHED_FIFO. '
        'No node is started.',
    )
    parser.add_argument(
        '--duration', type=_positive, default=10.0, metavar='S',
        help='wall time to measure for, s (default 10)',
    )  # fmt: skip
    parser.add_argument(
        '--rate', type=_positive, default=1000.0, metavar='HZ',
        help='rate of the loop (default 1000)',
    )  # fmt: skip
    parser.add_argument('--json', action='store_true', help='print JSON instead of text')


def _positive(text: str) -> float:
    value = number(text)
    if not 0.0 < value <= 1e5:
        raise argparse.ArgumentTypeError(f'{text}: a number above 0, at most 1e5')
    return value


def run(args: argparse.Namespace) -> int:
    """Print the permissions and the measured timing; return 0."""
    found = {**_machine(), **_allowed(), 'timing': _timing(args.duration, args.rate)}
    if args.json:
        print(json.dumps(found, indent=2))
        return 0
    timing = found.pop('timing')
    rows = [(key.replace('_', ' '), str(value)) for key, value in found.items()]
    rows += [(f'wake-up, {name}', _shown(values)) for name, values in timing.items()]
    width = max(len(name) for name, _ in rows)
    for name, text in rows:
        print(f'{name:<{width}}  {text}')
    return 0


def _machine() -> dict[str, str]:
    realtime = Path('/sys/kernel/realtime')
    preempt = realtime.is_file() and realtime.read_text(encoding='ascii').strip() == '1'
    load = ', '.join(f'{value:.2f}' for value in os.getloadavg())
    return {
        'flexarm_ros': package_version(),
        'rclpy': 'found' if importlib.util.find_spec('rclpy') else 'not found',
        'kernel': f'{platform.system()} {platform.release()}, PREEMPT_RT {_yes(preempt)}',
        'load': f'{load} (1, 5 and 15 minutes)',
        'monotonic_clock': f'resolution {time.get_clock_info("monotonic").resolution:.3g} s',
    }


def _allowed() -> dict[str, str]:
    from flexarm_ros.nodes.realtime.system import (
        can_lock,
        can_prioritise,
        memory_limit,
        priority_limit,
    )

    return {
        'CPUs': ', '.join(map(str, sorted(os.sched_getaffinity(0)))),
        'SCHED_FIFO': f'{_allowed_text(can_prioritise(_PRIORITY))} ({priority_limit()})',
        'locked_memory': f'{_allowed_text(can_lock())} ({memory_limit()})',
    }


def _timing(duration: float, rate: float) -> dict[str, dict[str, Any]]:
    """Measure for ``duration`` s in all."""
    from flexarm_ros.nodes.realtime.system import can_prioritise, prioritised

    fifo = can_prioritise(_PRIORITY)
    duration = duration / 2.0 if fifo else duration
    found = {'default priority': _measured(duration, rate)}
    if fifo:
        with prioritised(_PRIORITY):
            found[f'SCHED_FIFO {_PRIORITY}'] = _measured(duration, rate)
    return found


def _measured(duration: float, rate: float) -> dict[str, Any]:
    from flexarm_ros.core.run.results.real_time import spread
    from flexarm_ros.nodes.realtime.measure import bare_jitter

    jitter = bare_jitter(round(1e9 / rate), max(1, round(duration * rate)))
    late = int((jitter >= 1.0 / rate).sum())
    return {'rate_hz': rate, 'ticks': len(jitter), 'late_ticks': late, **spread(jitter)}


def _shown(values: dict[str, Any]) -> str:
    p50, p99, largest = (f'{values[key]:.3f} ms' for key in ('p50', 'p99', 'max'))
    return (
        f'{values["ticks"]} ticks at {values["rate_hz"]:g} Hz, {values["late_ticks"]} late; '
        f'late by {p50} (median), {p99} (99 %), {largest} (largest)'
    )


def _yes(value: bool) -> str:
    return 'yes' if value else 'no'


def _allowed_text(value: bool) -> str:
    return 'allowed' if value else 'not allowed'
