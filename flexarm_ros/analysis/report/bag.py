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

"""A run read from its bag alone, if recovered, moved or interrupted."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from flexarm_ros.bag.outputs import summary_of
from flexarm_ros.bag.reading.reader import open_run
from flexarm_ros.bag.tables.trajectory import trajectory
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.columns import COLUMNS, header
from flexarm_ros.core.run.results.metrics import Metrics
import numpy as np

BLOCK = 512


def read_bag(
    path: Path, given: RunConfig | None = None, namespace: str | None = None
) -> tuple[Mapping[str, FloatArray], dict[str, Any], Path]:
    """
    Return the columns of ``trajectory.csv``, the summary, and the bag that they are from.

    The metrics cover the complete ticks from the start and need a scenario, that of the bag or
    ``given``.  Values that a bag does not hold, the wall time and the reason of the end, are
    ``None``.  Raises ``BagError`` if ``path`` leads to no bag of a run.
    """
    reader = open_run(path, given, namespace)
    metrics = Metrics(reader.config, reader.provenance.external) if reader.has_scenario else None
    parts: list[FloatArray] = []
    found = trajectory(reader)
    while block := list(islice(found, BLOCK)):
        parts.append(np.array([row for _, row, _ in block]))
        for _, row, whole in block:
            if metrics is not None and whole:
                metrics.add(row)
    if not parts:
        raise reader.nothing()
    table = np.concatenate(parts)
    names = header(reader.config) if reader.has_scenario else COLUMNS
    columns = {name: table[:, i].copy() for i, name in enumerate(names)}
    problems = [f'damaged: {reader.damage}'] if reader.damage is not None else []
    problems += [*reader.gaps, *reader.notes]
    if metrics is None:
        return columns, {'problem': '; '.join(['no scenario', *problems])}, reader.path
    if not problems and metrics.ticks != reader.timeline.ticks:
        problems.append(
            f'only the first {metrics.ticks} of {reader.timeline.ticks} ticks are complete'
        )
    summary = summary_of(
        reader.config, metrics.result(), reader.provenance, problem='; '.join(problems)
    )
    return columns, summary, reader.path
