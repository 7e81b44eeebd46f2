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
The files beside a bag: ``trajectory.csv`` and ``summary.json``.

Both are computed from the recorded messages, by the same code for a run of nodes and for a
simulation in one process, so that the two agree byte for byte.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable
import contextlib
from importlib import metadata
import json
import os
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.embedded_metadata import bag_config
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.mcap.files import write_atomically
from flexarm_ros.bag.number_text import csv_lines
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.columns import header
from flexarm_ros.core.run.results.metric_list import NAMES
from flexarm_ros.core.run.results.metrics import Metrics
from flexarm_ros.core.run.results.real_time import RunTiming
from flexarm_ros.core.run.results.trajectory_rows import Rows
from flexarm_ros.core.run.state import Block
from flexarm_ros.core.timeline import Timeline

TRAJECTORY = 'trajectory.csv'
SUMMARY = 'summary.json'

_ROS_PACKAGES = ('rclpy', 'ros-rmw-fastrtps-cpp')


def write_trajectory(
    directory: Path, config: RunConfig, blocks: Iterable[Block], external: Collection[str] = ()
) -> dict[str, Any]:
    """
    Write ``trajectory.csv`` and return the metrics of the run.

    The file is written atomically.  Numbers have the shortest text that reads back exactly;
    missing ones are ``nan``.
    """
    rows, metrics = Rows(config, external), Metrics(config, external)
    path = directory / TRAJECTORY
    temporary = path.with_name(path.name + '.tmp')
    try:
        with open(temporary, 'wb') as file:
            file.write((','.join(header(config)) + '\n').encode())
            for block in blocks:
                table = rows.table(block)
                metrics.add_table(table)
                file.write(csv_lines(table))
        os.replace(temporary, path)
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror}') from None
    finally:
        with contextlib.suppress(OSError):
            temporary.unlink()  # half a file: on a full disk the summary needs its room
    return metrics.result()


def summary_of(
    config: RunConfig,
    metrics: dict[str, Any],
    provenance: Provenance,
    wall_s: float | None = None,
    unstable: tuple[int, str] | None = None,
    problem: str = '',
    timing: RunTiming | None = None,
) -> dict[str, Any]:
    """
    Return the content of ``summary.json`` for a run that has ended.

    ``unstable`` is the tick and the text of the state that ended the run.  ``external`` are the
    roles of external nodes; parameters that are unused with them are left out.  ``timing`` is that
    of a free-running run.
    """
    timeline = Timeline.of(config.run)
    ticks = metrics['ticks']
    finished = ticks == timeline.ticks
    simulated = ticks * timeline.period_ns * 1e-9
    return {
        'name': provenance.name,
        'complete': finished or unstable is not None,
        'stable': False if unstable else True if finished else None,
        'unstable_tick': unstable[0] if unstable else None,
        'external': list(provenance.external),
        'problem': problem or (f'unstable: {unstable[1]}' if unstable else ''),
        **metrics,
        'wall_s': wall_s,
        'rtf': simulated / wall_s if wall_s else None,
        **({} if timing is None else {'real_time': timing.summary()}),
        'versions': {**provenance.versions, **_ros_versions(), 'commit': provenance.commit},
        'scenario': scenario.to_dict(bag_config(config), provenance.external),
        **({'changes': [c._asdict() for c in config.changes]} if config.changes else {}),
    }


def unfinished_summary(config: RunConfig, provenance: Provenance) -> dict[str, Any]:
    """Return the content of ``summary.json`` for a run that is in progress or was cut off."""
    metrics = {**dict.fromkeys(NAMES), 'ticks': 0}
    return {
        **summary_of(config, metrics, provenance),
        'ticks': None,
        'complete': False,
        'stable': None,
        'problem': 'not finished: still running, or cut off',
    }


def write_summary(directory: Path, summary: dict[str, Any]) -> None:
    """Write ``summary.json`` atomically; BagError on failure."""
    write_atomically(
        directory / SUMMARY, json.dumps(finite(summary), indent=2, allow_nan=False) + '\n'
    )


def finite(value: Any) -> Any:
    """Return ``value`` with None for every number that is not finite."""
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and value - value != 0.0:
        return None
    return value


def _ros_versions() -> dict[str, str]:
    found = {}
    for package in _ROS_PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
