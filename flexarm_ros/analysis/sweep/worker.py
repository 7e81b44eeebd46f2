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
One run of a sweep, in any process: metrics only, no files.

Numpy and the compiled core are imported within the functions, so that a worker can first limit
its linear algebra to one thread.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from multiprocessing import parent_process
from multiprocessing.synchronize import Event
import os
import signal
import threading
from typing import Any

from flexarm_ros.analysis.spawning import ENDING
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.warned import allow_warnings

Task = tuple[int, int, tuple[str, ...]]
"""Index of the run, index of its scenario, overrides."""

Row = dict[str, Any]
"""``index``, ``outcome``, ``error``, ``unstable_tick`` and the metrics of ``summary.json``."""

OUTCOMES = ('stable', 'unstable', 'invalid', 'failed', 'crashed')


class Stopped(Exception):
    """The sweep is being stopped; the run is incomplete."""


def simulate_row(config: RunConfig, stop: Callable[[], bool] = lambda: False) -> Row:
    """
    Simulate a scenario in this process and return its outcome and metrics.

    The numbers are those of ``summary.json`` of ``flexarm simulate``.  Raises Stopped once
    ``stop()``, called after each block of ticks, is true.
    """
    from flexarm_ros.core.run.loop import ClosedLoop
    from flexarm_ros.core.run.loop_blocks import loop_blocks
    from flexarm_ros.core.run.results.metrics import Metrics
    from flexarm_ros.core.run.results.trajectory_rows import Rows

    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    for block in loop_blocks(loop):
        metrics.add_table(rows.table(block))
        if stop():
            raise Stopped
    stable = loop.unstable is None
    return {
        'outcome': 'stable' if stable else 'unstable',
        'error': loop.unstable or '',
        'stable': stable,
        'unstable_tick': loop.unstable_tick,
        **metrics.result(),
    }


def run_task(
    bases: Sequence[RunConfig], task: Task, stop: Callable[[], bool] = lambda: False
) -> Row:
    """Return the row of one run; an error becomes part of it."""
    from flexarm_ros.scenario import ScenarioError, with_values
    from flexarm_ros.scenario.plugins.registry import find_plugins_of

    index, base, overrides = task
    try:
        find_plugins_of(bases[base])
        return {'index': index, **simulate_row(with_values(bases[base], overrides), stop)}
    except ScenarioError as error:
        return {'index': index, 'outcome': 'invalid', 'error': str(error)}
    except Stopped:
        raise
    except Exception as error:
        text = ' '.join(f'{type(error).__name__}: {error}'.split())[:300]
        return {'index': index, 'outcome': 'failed', 'error': text}


_bases: Sequence[RunConfig] = ()
_stop: Event | None = None


def start_worker(bases: Sequence[RunConfig], stop: Event) -> None:
    """Prepare a worker process: the scenarios, no terminal signals, one thread."""
    global _bases, _stop
    _bases, _stop = bases, stop
    allow_warnings()
    os.environ['OPENBLAS_NUM_THREADS'] = os.environ['OMP_NUM_THREADS'] = '1'
    # Signals to the process group, as from a terminal, are handled by the parent alone.
    # SIGTERM is not ignored: since Python 3.12 a pool that has lost a process uses it to end the
    # others.
    os.setpgid(0, 0)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, ENDING)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    """Exit once the parent has died, since no process would take the results."""
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def run_tasks(tasks: Sequence[Task]) -> list[Row]:
    """Return the rows of some runs, in a worker process; fewer if the sweep is stopped."""
    rows: list[Row] = []
    stop = _stop.is_set if _stop is not None else lambda: False
    try:
        for task in tasks:
            if stop():
                break
            rows.append(run_task(_bases, task, stop))
    except Stopped:
        pass
    return rows


def run_tasks_remotely(bases: Sequence[RunConfig], tasks: Sequence[Task]) -> list[Row]:
    """Return the rows of some runs, on a machine of a cluster."""
    return [run_task(bases, task) for task in tasks]


def code_version() -> dict[str, str]:
    """Return what determines the numbers: versions of packages and a digest of the code."""
    from flexarm_ros.bag.provenance import Provenance

    here = Provenance.here()
    return {**here.versions, 'digest': here.digest}
