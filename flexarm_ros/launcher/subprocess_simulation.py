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

"""A simulation in its own process: threads would share one interpreter's time."""

from __future__ import annotations

from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path
import signal
from typing import Any

from flexarm_ros.analysis.spawning import spawn_context
from flexarm_ros.bag.errors import BagError
from flexarm_ros.core.ending import handle_ending
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.warned import allow_warnings

_LOOK_S = 0.1


def simulate_apart(
    config: RunConfig,
    directory: Path,
    name: str,
    watch: Callable[[int, int], None],
    stop: Callable[[], bool],
) -> dict[str, Any]:
    """Like `flexarm_ros.bag.simulation.simulate`; also BagError if the process dies."""
    context = spawn_context()
    here, there = context.Pipe(duplex=False)
    halt = context.Event()
    process = context.Process(
        target=_work, args=(there, halt, config, directory, name), daemon=True
    )
    process.start()
    there.close()
    try:
        while True:
            if stop():
                halt.set()
            if not here.poll(_LOOK_S):
                continue
            kind, value = here.recv()
            if kind == 'ticks':
                watch(*value)
            elif kind == 'summary':
                return dict(value)
            else:
                raise BagError(value)
    except EOFError:
        process.join()
        raise BagError(f'simulation: ended with exit status {process.exitcode}') from None
    finally:
        here.close()
        process.join(_LOOK_S)
        if process.is_alive():
            process.kill()
            process.join()


def _work(line: Connection, halt: Any, config: RunConfig, directory: Path, name: str) -> None:
    """Simulate and report progress until asked to stop, or until the launcher is gone."""
    handle_ending(signal.SIG_IGN)  # signals reach the process group: the launcher decides
    allow_warnings()  # before modules that warn are imported
    from flexarm_ros.bag.simulation import simulate
    from flexarm_ros.scenario.plugins.registry import find_plugins_of

    try:
        find_plugins_of(config)
        summary = simulate(
            config, directory, name,
            watch=lambda ticks, total: line.send(('ticks', (ticks, total))), stop=halt.is_set,
        )  # fmt: skip
        line.send(('summary', summary))
    except BrokenPipeError:
        return  # the launcher is gone
    except (BagError, OSError, ValueError) as error:
        line.send(('error', str(error)))
