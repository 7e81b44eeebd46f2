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

"""The nodes in lock-step: beside the floor, composed, and where the time goes."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
from statistics import median
import subprocess
import sys
import tempfile

from bench.launch import Cost, floor, LIMIT_S, MeasurementFailed, nodes
from bench.table import markdown, Part, Ratio
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles

ROLES = roles(RunConfig())

TICKS = 4000
ROUNDS = 5
WHOLE_S = 16

_NAMES = {
    'loops': 'compiled loops: wait, take, check, compute, publish',
    'DDS threads': "the middleware's own threads",
    'Python': 'Python of the nodes',
    'taking': 'recorder: taking and checking messages',
    'recording': 'recorder: collecting, compressing, writing',
}


def measure() -> Part:
    """Run floor, nodes and composed nodes in turn, several times, then the whole run."""
    ways: dict[str, Callable[[], Cost]] = {
        'floor': lambda: floor(TICKS),
        'run': lambda: nodes(TICKS),
        'apart': lambda: nodes(TICKS, apart=True),
        'compose': lambda: nodes(TICKS, compose=True),
    }
    found: dict[str, list[Cost]] = {name: [] for name in ways}
    for _ in range(ROUNDS):
        for name, way in ways.items():
            found[name].append(_again(way))
    tutorial = _again(lambda: floor(TICKS // 4, 'executor'))
    traced = _again(lambda: nodes(TICKS, traced=True))
    whole = {'run': _whole(), 'run --compose': _whole('--compose')}
    return Part(
        'distributed', _ratios(found, whole, tutorial), [_costs(found, tutorial), _shares(traced)]
    )


def _again(way: Callable[[], Cost]) -> Cost:
    """Measure; once more where it failed (a machine under load may miss a time limit)."""
    try:
        return way()
    except (MeasurementFailed, subprocess.TimeoutExpired) as error:
        print(f'bench: again, {error}', file=sys.stderr)
        return way()


def _whole(*words: str) -> float:
    """Run the paper's square as a user does and return the real-time factor it says."""
    with tempfile.TemporaryDirectory(prefix='flexarm-bench-') as folder:
        out = Path(folder) / 'run'
        command = [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'fls_tip', '--no-pictures',
                   '--set', f'duration={WHOLE_S}', '--out', str(out), *words]  # fmt: skip
        subprocess.run(command, check=True, capture_output=True, timeout=2 * LIMIT_S)
        return float(json.loads((out / 'summary.json').read_text(encoding='utf-8'))['rtf'])


def _ratios(found: dict[str, list[Cost]], whole: dict[str, float], tutorial: Cost) -> list[Ratio]:
    wall = [r.wall_us / f.wall_us for r, f in zip(found['run'], found['floor'], strict=True)]
    cpu = [r.cpu_us / f.cpu_us for r, f in zip(found['run'], found['floor'], strict=True)]
    apart = [a.wall_us / r.wall_us for a, r in zip(found['apart'], found['run'], strict=True)]
    run, bare = found['run'], found['floor']
    best = {name: max(cost.rtf() for cost in costs) for name, costs in found.items()}
    ratios = [
        Ratio(
            "a full tick, six processes / the floor's, processor time",
            f'{median(c.cpu_us for c in run):.0f} us', f'{median(c.cpu_us for c in bare):.0f} us',
            median(cpu), 1.3, False, f'median of {ROUNDS} pairs, {TICKS} ticks each',
        ),
        Ratio(
            "a full tick, six processes / the floor's, wall time",
            f'{median(c.wall_us for c in run):.0f} us',
            f'{median(c.wall_us for c in bare):.0f} us',
            median(wall), 1.3, False, f'median of {ROUNDS} pairs, {TICKS} ticks each',
        ),
        Ratio(
            'a full tick, six processes started one by one / as forks of one, wall time',
            f'{median(c.wall_us for c in run):.0f} us',
            f'{median(c.wall_us for c in found["apart"]):.0f} us',
            median(apart), None, True, f'median of {ROUNDS} pairs, {TICKS} ticks each',
        ),
        Ratio(
            'plain rclpy (executor, message objects, empty callbacks) / ours, processor time',
            f'{median(c.cpu_us for c in run):.0f} us', f'{tutorial.cpu_us:.0f} us',
            tutorial.cpu_us / median(c.cpu_us for c in run), None, True,
            f'one run of {TICKS // 4} ticks',
        ),
    ]  # fmt: skip
    for name, key, goals in (
        ('run', 'run', (1.5, 2.5)),
        ('run --compose', 'compose', (4.0, 10.0)),
    ):
        ratios += [
            Ratio(
                f'`flexarm {name} fls_tip`: simulated / wall time', f'{WHOLE_S} s',
                f'{WHOLE_S / whole[name]:.1f} s', whole[name], goal, True,
                'one whole run, recorder on',
            )
            for goal in goals
        ]  # fmt: skip
        ratios.append(
            Ratio(
                f'the same of {TICKS} ticks without the launcher', f'{TICKS / 1000:g} s',
                f'{TICKS / 1000 / best[key]:.2f} s', best[key], goals[1], True,
                f'best of {ROUNDS}',
            )
        )  # fmt: skip
    return ratios


def _costs(found: dict[str, list[Cost]], tutorial: Cost) -> str:
    """Return what a tick costs in each way, and in each process."""
    ways = [
        ('six processes', found['run']), ('floor', found['floor']),
        ('six processes, started one by one', found['apart']),
        ('plain rclpy, empty callbacks', [tutorial]), ('composed', found['compose']),
    ]  # fmt: skip
    rows = []
    for name, costs in ways:
        each = [median(c.roles.get(role, 0.0) for c in costs) for role in ROLES]
        rows.append(
            (
                name, f'{median(c.wall_us for c in costs):.0f}',
                f'{min(c.wall_us for c in costs):.0f}', f'{median(c.cpu_us for c in costs):.0f}',
                *(f'{value:.0f}' if value else '' for value in each),
            )
        )  # fmt: skip
    head = ('us a tick', 'wall, median', 'wall, best', 'processor, median', *ROLES)
    return markdown(head, rows)


def _shares(cost: Cost) -> str:
    """Return the share of each part of a full tick, six processes."""
    total = sum(cost.parts.values())
    rows = [
        (text, f'{cost.parts[part]:.0f}', f'{100 * cost.parts[part] / total:.0f} %')
        for part, text in _NAMES.items()
    ]
    rows.append(('all, timing of the calls included', f'{total:.0f}', '100 %'))
    return markdown(('part of a tick, six processes', 'processor time, us', 'share'), rows)
