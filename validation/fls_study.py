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
The FLS against its own parameters, and against (20) with a constant gain.

A variant's gain takes the place of K_s lambda in (21); all else is the code of the simulated loop.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.control import Sample
from flexarm_ros.core.control.pd import FlsLaw
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.trajectory_rows import Rows
import numpy as np
from validation.fuzzy_variants import FuzzyGain

Task = tuple[str, str, float, float]
CASES = ('fls_collocated', 'fls_tip')


class VariantLaw(FlsLaw):
    """(21) with the lambda of another fuzzy system, or with lambda = 1 (``system`` ``None``)."""

    def __init__(self, config: RunConfig, system: FuzzyGain | None) -> None:
        super().__init__(config)
        self._system = system
        self.seen: list[float] = []

    def torque(self, k: int, sample: Sample) -> tuple[float, float]:
        """Return tau1, tau2 (N m)."""
        self.gain = 1.0 if self._system is None else self._system(*sample.deflection)
        scale = self.config.controller.ks * self.gain
        self.seen.append(scale)
        return self._scaled(sample, scale)


def system_of(kind: str, kn: float) -> FuzzyGain | None:
    """Return the fuzzy system of a variant; ``None`` for the constant gain."""
    systems = {'three': (3, 'sum'), 'five': (5, 'sum'), 'three, largest': (3, 'largest')}
    return FuzzyGain(systems[kind][0], kn, systems[kind][1]) if kind in systems else None


def tasks() -> list[Task]:
    """Return (case, kind, K_s, K_n) of every run."""
    kinds = ('three', 'five', 'three, largest', 'constant')
    found = [(case, kind, float(ks), 5.0) for case in CASES for kind in kinds
             for ks in range(1, 31)]  # fmt: skip
    found += [(case, 'constant', 0.25 * i, 5.0) for case in CASES for i in range(5, 40) if i % 4]
    found += [(case, 'three', 15.0, kn) for case in CASES for kn in (1.0, 2.0, 3.0, 4.0, 7.0, 10.0,
              20.0)]  # fmt: skip
    return found


def row(task: Task) -> dict[str, Any]:
    """Simulate one variant."""
    case, kind, ks, kn = task
    config = scenario.load(case)
    config = replace(config, controller=replace(config.controller, ks=ks, kn=kn))
    loop, rows, metrics = ClosedLoop(config), Rows(config), Metrics(config)
    law = VariantLaw(config, system_of(kind, kn))
    loop.law = law
    while (record := loop.tick()) is not None:
        metrics.add(
            rows.row(record.k, record.q, record.qd, record.deflections[:2], record.tip[1:3],
                     record.torque)
        )  # fmt: skip
    found = metrics.result()
    stable = loop.unstable is None
    names = ('rms_error', 'max_error', 'max_overshoot', 'tip_rms_error', 'tip_max_error',
             'max_deflection', 'max_torque')  # fmt: skip
    return {
        'case': case, 'kind': kind, 'ks': ks, 'kn': kn,
        'outcome': 'stable' if stable else 'unstable',
        'unstable_tick': loop.unstable_tick,
        **{name: found[name] if stable else None for name in names},
        'least_gain': min(law.seen), 'mean_gain': float(np.mean(law.seen)),
        'largest_gain': max(law.seen),
    }  # fmt: skip


def flight() -> list[dict[str, Any]]:
    """Return elbow angle and gain of the shipped FLS cases every 25 ms."""
    found = []
    for case in CASES:
        loop = ClosedLoop(scenario.load(case))
        while (record := loop.tick()) is not None:
            if record.k % 25 == 0:
                found.append(
                    {'case': case, 't': record.k / 1000.0, 'theta2': float(record.q[1]),
                     'gain': 15.0 * record.gain}
                )  # fmt: skip
    return found
