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

"""Compile the code that a scenario needs, or load it from the cache, before the run."""

from __future__ import annotations

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.parts import columns
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.trajectory_rows import Rows


def warm_up(config: RunConfig) -> None:
    """
    Call every compiled function of the loop of ``config`` once, on a separate loop.

    Raises ``ValueError`` as :class:`ClosedLoop` does for a bad ``config``.
    """
    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    for _ in range(2):
        record = loop.tick()
        if record is not None:
            metrics.add(
                rows.row(
                    record.k, record.q, record.qd, record.deflections[:2], record.tip[1:3],
                    record.torque, further=(0.0,) * len(columns(config)),
                )
            )  # fmt: skip
    loop.plant.step(0.0, 0.0)
    metrics.result()
