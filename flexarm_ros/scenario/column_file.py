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

"""CSV files whose columns become keys of the scenario: of a disturbance, of latencies."""

from __future__ import annotations

import csv
from dataclasses import replace
import io
import math
from pathlib import Path

from flexarm_ros.core.parameters.channel import ChannelParameters, LONGEST_MEASURED_S
from flexarm_ros.core.parameters.sections import RunConfig, SECTIONS, with_section
from flexarm_ros.core.run.rig_parts import DisturbancePart, TABLES
from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.files import read_text

HEADERS = {'force_file': ('t', 'fx', 'fy'), 'payload_file': ('t', 'payload_mass')}
MAX_BYTES = 1024 * 1024
MAX_ROWS = 10_000


def is_file(section: str, key: str) -> bool:
    """Return whether the value of a key is the path of such a file."""
    return key == 'latency_file' or (section == DisturbancePart.NAME and key in HEADERS)


def with_columns(config: RunConfig, base: Path) -> RunConfig:
    """
    Return ``config`` with the files' columns in the place of their paths, relative to ``base``.

    Raises ScenarioError naming the file, the line and what is allowed.
    """
    held = config.section(DisturbancePart.NAME)
    for key in HEADERS if held is not None else ():
        path = getattr(held, key)
        if path is not None:
            columns = read_columns(base / path, HEADERS[key])
            held = replace(held, **dict(zip(TABLES[key], columns, strict=True)), **{key: None})
    if held is not None:
        config = with_section(config, DisturbancePart.NAME, held)
    for section in SECTIONS:
        channel = config.section(section)
        if isinstance(channel, ChannelParameters) and channel.latency_file is not None:
            latencies = read_latencies(base / channel.latency_file)
            channel = replace(channel, latencies=latencies, latency_file=None)
            config = with_section(config, section, channel)
    return config


def read_latencies(path: Path) -> tuple[float, ...]:
    """Return the latencies of a CSV file without a header, s, one a line; at least 1."""
    name, found = clip(str(path)), list[float]()
    for number, line in enumerate(read_text(path, MAX_BYTES).splitlines(), start=1):
        text = line.strip()
        if not text:
            continue
        try:
            latency = float(text) if '_' not in text else math.nan
        except ValueError:
            latency = math.nan
        if not 0.0 <= latency <= LONGEST_MEASURED_S:
            raise ScenarioError(
                f"{name}: line {number}: '{clip(text)}' is not a latency of 0 to "
                f'{LONGEST_MEASURED_S:g} s'
            )
        found.append(latency)
    if not 1 <= len(found) <= MAX_ROWS:
        raise ScenarioError(f'{name}: {len(found)} latencies; allowed: 1 to {MAX_ROWS}')
    return tuple(found)


def read_columns(path: Path, header: tuple[str, ...]) -> list[tuple[float, ...]]:
    """Return the columns of a CSV file with this header, all of one length, at least 1."""
    name = clip(str(path))
    reader = csv.reader(io.StringIO(read_text(path, MAX_BYTES)))
    wanted = ','.join(header)
    try:
        first = [cell.strip() for cell in next(reader, [])]
        if tuple(first) != header:
            raise ScenarioError(
                f"{name}: line 1 is '{clip(','.join(first))}'; it must be '{wanted}'"
            )
        rows = [
            _row(cells, len(header), f'{name}: line {reader.line_num}')
            for cells in reader
            if cells
        ]
    except csv.Error as error:
        raise ScenarioError(f'{name}: line {reader.line_num}: {clip(str(error))}') from None
    if not 1 <= len(rows) <= MAX_ROWS:
        raise ScenarioError(f"{name}: {len(rows)} rows below '{wanted}'; allowed: 1 to {MAX_ROWS}")
    return list(zip(*rows, strict=True))


def _row(cells: list[str], width: int, place: str) -> list[float]:
    try:
        row = [float(cell) if '_' not in cell else math.nan for cell in cells]
    except ValueError:
        row = []
    if len(row) != width or not all(map(math.isfinite, row)):
        raise ScenarioError(f"{place}: '{clip(','.join(cells))}' is not {width} finite numbers")
    return row
