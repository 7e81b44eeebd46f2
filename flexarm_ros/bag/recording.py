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
The output directory of a run: created first, marked incomplete, completed at the end.

``DIR/bag`` is the recording.  ``DIR/summary.json`` marks the run as not finished from the start;
it is replaced, and ``DIR/trajectory.csv`` written, when the bag is closed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
import os
from pathlib import Path
import shutil
from typing import Any

from flexarm_ros.bag.errors import BagError, BagExistsError
from flexarm_ros.bag.outputs import (
    summary_of,
    unfinished_summary,
    write_summary,
    write_trajectory,
)
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.timing import TimingLog
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.real_time import RunTiming
from flexarm_ros.core.run.state import Block

BAG = 'bag'
_DAMAGED = 'bag-damaged'

Work = Callable[[str, float], None]
"""Called with what is being done and the share of it that is done, 0 to 1."""


class Recording:
    """
    A bag in a run's output directory, as filled by the recorder node.

    ``external`` names the roles of external nodes.  Raises BagError if the directory cannot be
    created or holds a bag already.
    """

    def __init__(
        self, config: RunConfig, directory: Path, name: str = '', external: Iterable[str] = ()
    ) -> None:
        self.directory = directory
        self._writer = BagWriter(directory / BAG, config, Provenance.here(name, external))
        self.write = self._writer.write
        self.write_ticks = self._writer.write_ticks
        self.write_change = self._writer.write_change

    def close(self) -> None:
        """Finish the bag; BagError if it cannot be written."""
        self._writer.close()

    def set_aside(self, number: int) -> None:
        """Finish the bag of a run that restarts; it is kept as ``bag-before-reset-NUMBER``."""
        self._writer.close()
        os.rename(self.directory / BAG, self.directory / f'{BAG}-before-reset-{number}')

    def abandon(self) -> None:
        """Leave the bag as it is, after a write error."""
        self._writer.abandon()


def default_name(name: str, namespace: str) -> str:
    """Return the name of a run's default directory; ``left-NAME`` in the namespace ``/left``."""
    return '-'.join(part for part in (*namespace.split('/'), name) if part)


def free_directory(name: str, below: Path = Path('runs')) -> Path:
    """Return ``runs/NAME``, or ``runs/NAME-2`` ... if that exists."""
    number = 1
    while (path := below / (name if number == 1 else f'{name}-{number}')).exists():
        number += 1
    return path


def prepare_directory(
    directory: Path, config: RunConfig, name: str, external: Iterable[str] = ()
) -> None:
    """
    Create a run's output directory and mark it as not finished.

    ``external``: roles of external nodes.  Raises BagExistsError if it is not empty, BagError
    or OSError if it cannot be created.
    """
    directory.mkdir(parents=True, exist_ok=True)
    if any(directory.iterdir()):
        raise BagExistsError(f'{directory}: exists and is not empty, not overwritten')
    write_summary(directory, unfinished_summary(config, Provenance.here(name, external)))


def finish_run(
    directory: Path,
    config: RunConfig,
    name: str,
    wall_s: float | None = None,
    problem: str = '',
    unstable: tuple[int, str] | None = None,
    external: Iterable[str] = (),
    work: Work = lambda *_: None,
    blocks: Iterable[Block] | None = None,
) -> dict[str, Any]:
    """
    Write ``trajectory.csv`` and ``summary.json`` from the bag; return the summary.

    ``blocks``: all that a simulation has recorded in it, which saves reading the bag.

    A bag that was cut off (recorder killed, disk full) is rescued first, and the damaged one
    kept beside it; ``work`` receives the progress.  The bag states which nodes were external;
    ``external`` is used if the bag states none.
    """
    provenance = Provenance.here(name, external)
    metrics = Metrics(config).result()
    timing: RunTiming | None = None
    try:
        if blocks is None:
            _mend_bag(directory, config, provenance, work)
            reader = BagReader(directory)
            provenance = replace(provenance, external=reader.provenance.external)
            config = replace(config, changes=reader.config.changes)
            log = TimingLog(config, reader.topics)
            recorded = log.watch(reader.blocks())
            metrics = write_trajectory(directory, config, recorded, provenance.external)
            timing = log.timing
            log.write(directory)
        else:
            metrics = write_trajectory(directory, config, blocks, provenance.external)
    except BagError as error:
        problem = problem or str(error)
    summary = summary_of(config, metrics, provenance, wall_s, unstable, problem, timing)
    write_summary(directory, summary)
    return summary


def _mend_bag(directory: Path, config: RunConfig, provenance: Provenance, work: Work) -> None:
    """Replace a bag that was never closed by what can be rescued of it, or by an empty one."""
    bag = directory / BAG
    if not bag.is_dir() or (bag / 'metadata.yaml').exists():
        return
    from flexarm_ros.bag.mcap.recover import recover

    rescued = directory / 'bag-rescued'
    mending = partial(work, 'repairing the bag, which the recorder did not finish')
    mending(0.0)
    if not recover(bag, rescued, mending).kept:
        try:
            with BagWriter(rescued, config, provenance):
                pass
        except BagError:  # a full disk
            shutil.rmtree(rescued, ignore_errors=True)
            raise
    os.rename(bag, directory / _DAMAGED)
    os.rename(rescued, bag)
