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

"""The metrics of a run, in the order of ``summary.json``: the one declaration of them."""

from __future__ import annotations

from typing import NamedTuple


class Metric(NamedTuple):
    """A key of ``summary.json``, its label, unit (empty: a number) and meaning."""

    name: str
    title: str
    unit: str
    meaning: str
    per_switch: bool = False
    """The value is a list with one value per direction switch."""


METRICS = (
    Metric(
        'rms_error', 'rms error', 'm',
        'root mean square of the distance of the rigid end effector from the undelayed reference',
    ),
    Metric('max_error', 'max error', 'm', 'largest such distance'),
    Metric('tip_rms_error', 'rms error, bent tip', 'm', '`rms_error` of the tip of the bent arm'),
    Metric('tip_max_error', 'max error, bent tip', 'm', '`max_error` of the tip of the bent arm'),
    Metric(
        'overshoot', 'overshoot', 'm',
        'largest distance of the rigid end effector past the corner, along the old direction, in '
        'the second after the switch',
        per_switch=True,
    ),
    Metric('max_overshoot', 'max overshoot', 'm', 'largest of `overshoot`'),
    Metric(
        'tip_overshoot', 'overshoot, bent tip', 'm', '`overshoot` of the tip of the bent arm',
        per_switch=True,
    ),
    Metric('max_deflection', 'max deflection', 'm', 'largest end deflection of a link'),
    Metric('max_torque', 'max torque', 'N m', 'largest torque at a joint'),
)  # fmt: skip
"""The metrics of `flexarm_ros.core.run.results.metrics.Metrics.result`, besides ``ticks``."""

TICKS = Metric('ticks', 'ticks', '', 'number of ticks that were run')
TIMING = (
    Metric('wall_s', 'wall time', 's', 'wall time from the first tick to the last'),
    Metric('rtf', 'real-time factor', '', 'simulated time divided by `wall_s`'),
)
NUMBERS = (*METRICS, TICKS, *TIMING)
"""Every number of ``summary.json`` that tables show."""

NAMES = (*(metric.name for metric in METRICS), TICKS.name)
"""Keys of the metrics, in order."""


def unit_of(name: str) -> str:
    """Return the unit of a metric, ``overshoot[0]`` included; empty for any other name."""
    return {metric.name: metric.unit for metric in NUMBERS}.get(name.partition('[')[0], '')
