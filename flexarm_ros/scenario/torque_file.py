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

"""The torque file of law ``open_loop``: CSV ``t,tau1,tau2``, seconds and N m."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path

from flexarm_ros.scenario.errors import clip, ScenarioError
from flexarm_ros.scenario.files import read_text

Torques = tuple[tuple[float, float, float], ...]

HEADER = ['t', 'tau1', 'tau2']
MAX_BYTES = 64 * 1024 * 1024
MAX_ROWS = 1_000_000


def read_torques(path: Path) -> Torques:
    """
    Return the rows ``(t, tau1, tau2)`` of a torque file; two rows of equal time make a step.

    Raises ScenarioError naming the file, the line and what is allowed.
    """
    return parse_torques(read_text(path, MAX_BYTES), clip(str(path)))


def parse_torques(text: str, name: str) -> Torques:
    """Return the rows of a torque file's text; ``name`` is used in errors."""
    reader = csv.reader(io.StringIO(text))
    rows: list[tuple[float, float, float]] = []
    try:
        header = [cell.strip() for cell in next(reader, [])]
        if header != HEADER:
            raise ScenarioError(
                f"{name}: line 1 is '{clip(','.join(header))}'; it must be 't,tau1,tau2'"
            )
        for cells in reader:
            if cells:
                rows.append(_row(cells, f'{name}: line {reader.line_num}'))
                check_order(rows, f'{name}: line {reader.line_num}')
    except csv.Error as error:
        raise ScenarioError(f'{name}: line {reader.line_num}: {clip(str(error))}') from None
    if not rows:
        raise ScenarioError(f"{name}: no rows below the line 't,tau1,tau2'; give at least one")
    return tuple(rows)


def _row(cells: list[str], place: str) -> tuple[float, float, float]:
    if len(cells) != 3:
        raise ScenarioError(f'{place}: {len(cells)} values; a row is t,tau1,tau2')
    return _number(cells[0], 't', place), _number(cells[1], 'tau1', place), _number(
        cells[2], 'tau2', place
    )  # fmt: skip


def _number(text: str, column: str, place: str) -> float:
    try:
        value = float(text) if '_' not in text else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ScenarioError(f"{place}: {column} is '{clip(text)}'; it must be a finite number")
    return value


def check_order(rows: list[tuple[float, float, float]], place: str) -> None:
    """Raise ScenarioError if the last row's time is before the one above it."""
    if len(rows) > MAX_ROWS:
        raise ScenarioError(f'{place}: more than the {MAX_ROWS} rows allowed')
    if len(rows) > 1 and rows[-1][0] < rows[-2][0]:
        raise ScenarioError(
            f'{place}: t is {rows[-1][0]!r} after {rows[-2][0]!r}; times must not decrease'
        )


def write_torques(torques: Torques) -> str:
    """Return rows as the text of a torque file that reads back exactly."""
    lines = ['t,tau1,tau2', *(f'{t!r},{a!r},{b!r}' for t, a, b in torques)]
    return '\n'.join(lines) + '\n'
