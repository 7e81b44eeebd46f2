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
Execution of a sweep's runs: in local processes, or on a Dask cluster.

Each run depends only on its own scenario, so the rows do not depend on the engine or on the
order of execution.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import (
    CancelledError,
    FIRST_COMPLETED,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from flexarm_ros.analysis.spawning import worker_context
from flexarm_ros.analysis.sweep.worker import (
    code_version,
    Row,
    run_tasks,
    run_tasks_remotely,
    start_worker,
    Task,
)
from flexarm_ros.core.parameters.sections import RunConfig

Stop = Callable[[], bool]
_LARGEST_CHUNK = 16
_POLL_S = 0.2
_MOST_CRASHES = 100


class EngineError(Exception):
    """The engine cannot be used: no cluster, no Dask, or other code on its workers."""


def chunks(tasks: Sequence[Task], workers: int) -> list[Sequence[Task]]:
    """Return tasks in portions, few enough for low overhead and enough for balance."""
    size = max(1, min(_LARGEST_CHUNK, len(tasks) // (workers * 8)))
    return [tasks[i:][:size] for i in range(0, len(tasks), size)]


class LocalPool:
    """Runs tasks in local processes; a process that dies costs one row."""

    def __init__(self, bases: Sequence[RunConfig], workers: int) -> None:
        self._bases, self._workers = bases, workers
        self._context = worker_context()

    def rows(self, tasks: Sequence[Task], stop: Stop) -> Iterator[Row]:
        """Yield rows as they are done; stops early once ``stop()`` is true."""
        waiting = chunks(tasks, self._workers)[::-1]
        crashes = 0
        while waiting:
            lost = yield from self._run_tasks(waiting, self._workers, 2 * self._workers, stop)
            # One at a time, to identify the run that kills its process.
            suspects: list[Sequence[Task]] = [[task] for task in reversed(lost)]
            while suspects:
                for index, _, _ in (yield from self._run_tasks(suspects, 1, 1, stop)):
                    yield {'index': index, 'outcome': 'crashed', 'error': 'its process died'}
                    crashes += 1
                if crashes > _MOST_CRASHES:
                    raise EngineError(f'{crashes} worker processes have died')

    def close(self) -> None:
        """Do nothing: every pool ends with its work."""

    def _run_tasks(
        self, waiting: list[Sequence[Task]], workers: int, ahead: int, stop: Stop
    ) -> Generator[Row, None, list[Task]]:
        """
        Yield rows of ``waiting``, taken from its end, at most ``ahead`` portions at a time.

        Returns the tasks of a pool that died; the others are still in ``waiting``.
        """
        event = self._context.Event()
        pool = ProcessPoolExecutor(workers, self._context, start_worker, (self._bases, event))
        flying: dict[Future[list[Row]], Sequence[Task]] = {}
        lost: list[Task] = []
        try:
            while (waiting or flying) and not lost:
                if stop():
                    event.set()
                    waiting.clear()
                while waiting and len(flying) < ahead:
                    future = pool.submit(run_tasks, waiting[-1])
                    flying[future] = waiting.pop()
                done, _ = wait(flying, timeout=_POLL_S, return_when=FIRST_COMPLETED)
                for future in done:
                    yield from _rows_or_lost(future, flying.pop(future), lost)
        except BrokenProcessPool:  # from submit: the tasks are still in ``waiting``
            pass
        finally:
            if not lost:  # else SIGTERM ends them, perhaps while they hold the event's lock
                event.set()
            pool.shutdown(cancel_futures=True)
        for future, part in flying.items():
            yield from _rows_or_lost(future, part, lost)
        return lost


def _rows_or_lost(future: Future[list[Row]], part: Sequence[Task], lost: list[Task]) -> list[Row]:
    try:
        return future.result(timeout=0)
    except (BrokenProcessPool, CancelledError):
        lost += part
        return []


class DaskCluster:
    """Runs tasks on the workers of a Dask scheduler (``pip install flexarm_ros[dask]``)."""

    def __init__(self, bases: Sequence[RunConfig], address: str) -> None:
        try:
            import distributed
        except ImportError:
            raise EngineError(
                "--scheduler needs Dask: pip install 'flexarm_ros[dask]', here and there"
            ) from None
        self._distributed = distributed
        try:
            self._client: Any = distributed.Client(address, timeout='5s')
        except (OSError, ValueError, TypeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise EngineError(f'--scheduler {address}: {reason}') from None
        self._bases = bases
        self._check_workers(address)

    def _check_workers(self, address: str) -> None:
        """Refuse a cluster without workers, or with other code, which may give other numbers."""
        found = self._client.run(code_version)
        if not found:
            self.close()
            raise EngineError(f'--scheduler {address}: no workers')
        mine = code_version()
        for worker, theirs in found.items():
            other = sorted(key for key in mine if theirs.get(key) != mine[key])
            if other:
                self.close()
                raise EngineError(f'--scheduler {address}: {worker} differs in {", ".join(other)}')
        self._workers = len(found)

    def rows(self, tasks: Sequence[Task], stop: Stop) -> Iterator[Row]:
        """Yield rows as they are done; stops early once ``stop()`` is true."""
        bases = self._client.scatter(tuple(self._bases), broadcast=True, hash=False)
        parts = chunks(tasks, self._workers)
        futures = {
            self._client.submit(run_tasks_remotely, bases, part, pure=False, retries=2): part
            for part in parts
        }
        try:
            while futures:
                ready = [future for future in futures if future.done()]
                for future in ready:
                    part = futures.pop(future)
                    yield from _result(future, part)
                if stop():
                    return
                if not ready:
                    self._wait(list(futures))
        finally:
            self._client.cancel(list(futures), force=True)

    def _wait(self, futures: list[Any]) -> None:
        try:
            self._distributed.wait(futures, timeout=_POLL_S, return_when='FIRST_COMPLETED')
        except (TimeoutError, self._distributed.TimeoutError):
            return

    def close(self) -> None:
        """Disconnect from the cluster."""
        self._client.close()


def _result(future: Any, part: Sequence[Task]) -> list[Row]:
    if future.status == 'finished':
        rows: list[Row] = future.result()
        return rows
    error = future.exception() if future.status == 'error' else None
    outcome = 'crashed' if type(error).__name__ == 'KilledWorker' else 'failed'
    text = f'{type(error).__name__}: {error}'[:300] if error else f'future {future.status}'
    return [{'index': index, 'outcome': outcome, 'error': text} for index, _, _ in part]
