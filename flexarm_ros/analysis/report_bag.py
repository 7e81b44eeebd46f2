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

"""A run read from its bag alone: rescued, moved, or of a run that was cut off."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from flexarm_ros.bag.outputs import block_rows, summary_of
from flexarm_ros.bag.reader import BagReader
from flexarm_ros.core.compiled import FloatArray
from flexarm_ros.core.metrics import Metrics
from flexarm_ros.core.rows import COLUMNS, Rows
import numpy as np


def read_bag(path: Path) -> tuple[Mapping[str, FloatArray], dict[str, Any]]:
    """
    Return the columns of ``trajectory.csv`` and the summary that a bag's messages give.

    The complete ticks from the front count.  What a bag does not tell, the wall time and why
    a run ended, is ``None``.  Raises ``BagError`` where ``path`` leads to no bag of a run.
    """
    reader = BagReader(path)
    rows, metrics = Rows(reader.config), Metrics(reader.config)
    parts = [np.empty((0, len(COLUMNS)))]
    for block in reader.blocks():
        made = list(block_rows(rows, block))
        for row in made:
            metrics.add(row)
        parts.append(np.array(made))
    table = np.concatenate(parts)
    problem = f'damaged: {reader.damage}' if reader.damage is not None else ''
    ended = len(table) == reader.timeline.ticks
    problem = problem or ('' if ended else "the bag does not reach the run's end")
    summary = summary_of(reader.config, metrics.result(), reader.provenance, problem=problem)
    return {name: table[:, i].copy() for i, name in enumerate(COLUMNS)}, summary
