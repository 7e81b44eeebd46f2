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
The directory of a sweep: the rows, and the table made from them.

``rows.jsonl`` gets one line per run, so that an interrupted sweep can continue; ``table.csv``
(and ``table.parquet``) is written from it, sorted, and does not depend on the engine or on
interruptions.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import csv
import fcntl
import io
import json
import os
from pathlib import Path
from types import TracebackType
from typing import Any

from flexarm_ros.analysis.sweep.worker import OUTCOMES, Row
from flexarm_ros.bag.mcap.files import naming
from flexarm_ros.core.run.results.metric_list import METRICS
from flexarm_ros.scenario.sweeps.sweep import Sweep

IDENTITY, ROWS, TABLE, PARQUET = 'sweep.json', 'rows.jsonl', 'table.csv', 'table.parquet'

_LAST = (
    'outcome', 'error', 'stable', 'unstable_tick', 'ticks',
    *(metric.name for metric in METRICS if not metric.per_switch),
)  # fmt: skip
_LISTS = tuple(metric.name for metric in METRICS if metric.per_switch)

Cell = Any
Table = dict[str, list[Cell]]
"""Columns by name, ordered by the index of the runs."""


class StoreError(Exception):
    """The directory belongs to something other than this sweep, or is in use."""


class SweepStore:
    """The rows of one sweep on disk; a context manager that holds a lock on them."""

    def __init__(self, directory: Path, sweep: Sweep) -> None:
        self.directory, self._sweep = directory, sweep
        self.rows: dict[int, Row] = {}

    def __enter__(self) -> SweepStore:
        self.directory.mkdir(parents=True, exist_ok=True)
        self._claim()
        self._file = open(self.directory / ROWS, 'a+b')
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise StoreError(f'{self.directory}: another sweep is writing here') from None
        self._read()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def _claim(self) -> None:
        """Write the identity of the sweep, or check that the directory belongs to it."""
        path = self.directory / IDENTITY
        if not path.exists():
            if any(self.directory.iterdir()):
                raise StoreError(f'{self.directory}: exists already, not overwritten')
            held = {'name': self._sweep.name, 'runs': self._sweep.count}
            _replace(path, json.dumps({**held, 'digest': self._sweep.digest()}, indent=2) + '\n')
            return
        try:
            digest = json.loads(path.read_text('utf-8'))['digest']
        except (ValueError, KeyError, TypeError):
            digest = None
        if digest != self._sweep.digest():
            raise StoreError(
                f'{self.directory}: holds another sweep (or this one, changed since); '
                'give another directory'
            )

    def _read(self) -> None:
        """Read existing rows; a truncated last line is dropped."""
        self._file.seek(0)
        data = self._file.read()
        whole = data[: data.rfind(b'\n') + 1]
        if len(whole) < len(data):
            self._file.truncate(len(whole))
        for line in whole.splitlines():
            try:
                row = json.loads(line)
            except ValueError:
                continue
            known = isinstance(row, dict) and row.get('outcome') in OUTCOMES
            if known and 0 <= row.get('index', -1) < self._sweep.count:
                self.rows[row['index']] = row

    def missing(self) -> list[int]:
        """Return the indices of the runs without a row."""
        return [index for index in range(self._sweep.count) if index not in self.rows]

    def add(self, row: Row) -> None:
        """Append a row and flush it to the operating system."""
        self.rows[row['index']] = row
        with naming(self.directory / ROWS):
            self._file.write(json.dumps(row).encode() + b'\n')
            self._file.flush()

    def counts(self) -> dict[str, int]:
        """Return how many runs had each outcome."""
        outcomes = [row['outcome'] for row in self.rows.values()]
        return {outcome: n for outcome in OUTCOMES if (n := outcomes.count(outcome))}

    def write(self) -> tuple[Table, list[Path]]:
        """Write the table; return it and its files.  Parquet needs pyarrow."""
        table = make_table(self._sweep, self.rows)
        path = self.write_table(TABLE, table)
        parquet = write_parquet(table, self.directory / PARQUET)
        return table, [path, *([parquet] if parquet else [])]

    def write_table(self, name: str, table: Table) -> Path:
        """Write columns as a CSV file of the directory and return its path."""
        path = self.directory / name
        _replace(path, csv_text(table))
        return path


def make_table(sweep: Sweep, rows: dict[int, Row]) -> Table:
    """Return the table of the existing rows, ordered by index."""
    ordered = [rows[index] for index in sorted(rows)]
    table: Table = {'index': [row['index'] for row in ordered]}
    swept = [sweep.case(row['index']).values for row in ordered]
    for name in sweep.columns:
        table[name] = _typed([values[name] for values in swept])
    for name in _LAST:
        table[name] = [row.get(name) for row in ordered]
    for name in _LISTS:
        lists = [row.get(name) or [] for row in ordered]
        for place in range(max(map(len, lists), default=0)):
            table[f'{name}[{place}]'] = [
                values[place] if place < len(values) else None for values in lists
            ]
    return table


def _typed(texts: Sequence[str]) -> list[Cell]:
    """Return texts as numbers if all of them are numbers."""
    try:
        return [int(text) for text in texts]
    except ValueError:
        pass
    try:
        return [float(text) for text in texts]
    except ValueError:
        return list(texts)


def csv_text(table: Table) -> str:
    """Return a table as CSV; numbers are exact, unknown values empty."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator='\n')
    writer.writerow(table)
    writer.writerows([_cell(value) for value in row] for row in _transposed(table))
    return out.getvalue()


def _transposed(table: Table) -> Iterable[tuple[Cell, ...]]:
    return zip(*table.values(), strict=True)


def _cell(value: Cell) -> str:
    if value is None:
        return ''
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else str(value)


def write_parquet(table: Table, path: Path) -> Path | None:
    """Write a table as Parquet and return the file; None if pyarrow is not installed."""
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    temporary = path.with_name(path.name + '.tmp')
    with naming(path):
        pyarrow.parquet.write_table(pyarrow.table(table), temporary)
        os.replace(temporary, path)
    return path


def _replace(path: Path, text: str) -> None:
    temporary = path.with_name(path.name + '.tmp')
    with naming(path):
        temporary.write_text(text, encoding='utf-8', newline='')
        os.replace(temporary, path)
