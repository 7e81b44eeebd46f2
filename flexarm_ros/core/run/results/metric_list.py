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

"""The metrics of a run, in the order of ``summary.json``: the one list of their names."""

from __future__ import annotations

from typing import NamedTuple


class Metric(NamedTuple):
    """A key of ``summary.json``, its label and its unit."""

    name: str
    title: str
    unit: str
    per_switch: bool = False
    """The value is a list with one value per direction switch."""


METRICS = (
    Metric('rms_error', 'rms error', 'm'),
    Metric('max_error', 'max error', 'm'),
    Metric('tip_rms_error', 'rms error, bent tip', 'm'),
    Metric('tip_max_error', 'max error, bent tip', 'm'),
    Metric('overshoot', 'overshoot', 'm', per_switch=True),
    Metric('max_overshoot', 'max overshoot', 'm'),
    Metric('tip_overshoot', 'overshoot, bent tip', 'm', per_switch=True),
    Metric('max_deflection', 'max deflection', 'm'),
    Metric('max_torque', 'max torque', 'N m'),
)
"""The metrics of `flexarm_ros.core.run.results.metrics.Metrics.result`, besides ``ticks``."""

NAMES = (*(metric.name for metric in METRICS), 'ticks')
"""Keys of the metrics, in order."""
