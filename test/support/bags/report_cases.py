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

"""Run directories for the tests of pictures and reports: real ones, and spoilt ones."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.figures import runs
from flexarm_ros.bag import outputs
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.loop_blocks import loop_blocks
import pytest


def fly(directory: Path, name: str, *overrides: str) -> Path:
    """Write what ``flexarm simulate NAME --no-bag`` writes beside its pictures."""
    config = scenario.load(name, list(overrides))
    loop = ClosedLoop(config)
    directory.mkdir(parents=True)
    metrics = outputs.write_trajectory(directory, config, loop_blocks(loop))
    unstable = None
    if loop.unstable is not None and loop.unstable_tick is not None:
        unstable = (loop.unstable_tick, loop.unstable)
    summary = outputs.summary_of(config, metrics, Provenance.here(name), 1.0, unstable)
    outputs.write_summary(directory, summary)
    return directory


def leave_pictures_empty(patch: pytest.MonkeyPatch) -> None:
    """Let `write_figures` make its figures and write empty files, in a fifth of the time."""

    def save(figure: object, out: Path, stem: str) -> list[Path]:
        paths = [out / f'{stem}.{kind}' for kind in ('png', 'svg')]
        for path in paths:
            path.touch()
        return paths

    patch.setattr(runs, 'save', save)


def edit_summary(directory: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change a run's ``summary.json``."""
    path = directory / 'summary.json'
    summary = json.loads(path.read_text('utf-8'))
    change(summary)
    path.write_text(json.dumps(summary), 'utf-8')


def cut_rows(directory: Path, rows: int, rest: str = '') -> None:
    """Keep the first rows of ``trajectory.csv``, and ``rest`` as a row that was cut off."""
    path = directory / 'trajectory.csv'
    lines = path.read_text('ascii').splitlines(keepends=True)
    path.write_text(''.join(lines[: rows + 1]) + rest, 'ascii')
