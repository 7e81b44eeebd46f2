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

"""Export of a bag: a table per topic, the trajectory (CSV, Parquet or MATLAB), the scenario."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from importlib import import_module
from itertools import islice
import os
from pathlib import Path
import re
import shutil
from typing import Any, Protocol

from flexarm_ros import scenario
from flexarm_ros.bag.embedded_metadata import bag_config, SCENARIO_FILE, TORQUES_FILE
from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.mcap.files import make_directory, write_atomically
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.tables.topics import BATCH, Batch, batches
from flexarm_ros.bag.tables.trajectory import trajectory
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.columns import header
from flexarm_ros.wire.topics import Topic
import numpy as np

CHANGES_FILE = 'changes.csv'
"""Parameters changed during the run, which a scenario cannot express."""
MATLAB_UNSAFE = re.compile(r'\W')
"""Characters that a MATLAB field name cannot have."""
NO_PYARROW = 'parquet needs pyarrow, which is not installed: pip install pyarrow'


@dataclass(frozen=True)
class Exported:
    """
    The result of an export.

    ``rows`` of each file; ``damage``: where the bag is damaged, empty if intact; ``notes``:
    what is missing or left out; ``has_scenario``: whether ``scenario.yaml`` was written.
    """

    rows: dict[str, int]
    damage: str
    notes: tuple[str, ...] = ()
    has_scenario: bool = True


def table_name(topic: Topic) -> str:
    """Return the name of a topic's file without its suffix: ``plant_state``."""
    return topic.path.strip('/').replace('/', '_')


def table_columns(topic: Topic) -> tuple[str, ...]:
    """Return the header of a topic's table."""
    return ('tick', 'stamp_ns', *topic.codec.fields)


def export(
    run: str | os.PathLike[str],
    directory: str | os.PathLike[str],
    file_format: str,
    given: RunConfig | None = None,
    namespace: str | None = None,
) -> Exported:
    """
    Write the tables of RUN into a new directory.

    Each topic has a file with the columns tick, stamp_ns (the message's own stamp) and its
    fields; ``trajectory`` has the columns of ``trajectory.csv`` (for its ticks see
    :mod:`flexarm_ros.bag.tables.trajectory`).  ``scenario.yaml`` (with ``torques.csv`` if needed)
    repeats the run; parameters changed during the run are in ``changes.csv``.  These are left
    out without a scenario (``given`` and ``namespace``: see `BagReader`).  A damaged bag is
    exported up to the damage.  Raises BagError, BagContentError for a bag without messages,
    BagExistsError if ``directory`` exists; partial output is removed.
    """
    reader, target = BagReader(run, given, namespace), Path(directory)
    if file_format == 'parquet':
        _pyarrow()
    make_directory(target)
    try:
        if reader.has_scenario:
            _write_scenario(reader, target)
        rows = _write(reader, target, file_format)
        if not any(rows.values()):
            raise reader.nothing()
    except (BagError, OSError) as error:
        shutil.rmtree(target, ignore_errors=True)
        if isinstance(error, OSError):
            raise BagError(f'{target}: cannot be written: {error.strerror}') from None
        raise
    notes = [*reader.notes, *reader.gaps]
    complete = rows.get(f'trajectory.{file_format}', reader.timeline.ticks)
    if reader.own and complete < reader.timeline.ticks:
        notes.append(f'trajectory: only the first {complete} of {reader.timeline.ticks} ticks')
    if not reader.has_scenario:
        notes.append('no scenario: no trajectory and no scenario.yaml (give it with --scenario)')
    return Exported(rows, str(reader.damage or ''), tuple(notes), reader.has_scenario)


def _write_scenario(reader: BagReader, target: Path) -> None:
    text = scenario.dump(bag_config(reader.config))
    if reader.unknown:  # verbatim, with the parts that this version does not know
        text = reader.front.attachments[SCENARIO_FILE].decode()
    write_atomically(target / SCENARIO_FILE, text)
    if reader.config.torques:
        text = scenario.write_torques(reader.config.torques)
        write_atomically(target / TORQUES_FILE, text)
    if reader.config.changes:
        rows = [f'{c.tick},{c.node},{c.key},{c.value!r}\n' for c in reader.config.changes]
        write_atomically(target / CHANGES_FILE, 'tick,node,key,value\n' + ''.join(rows))


def _write(reader: BagReader, target: Path, file_format: str) -> dict[str, int]:
    with ExitStack() as stack:

        def opened(name: str, columns: Sequence[str], integers: int) -> _Table:
            file = _open(target, name, columns, integers, file_format)
            stack.callback(file.close)
            return file

        files = {}
        for index in sorted(reader.names):
            topic = reader.topics[index]
            files[index] = opened(table_name(topic), table_columns(topic), 2)
        for group in batches(reader):
            for batch in group:
                if batch.topic in files:
                    files[batch.topic].write(_columns(batch))
        written = list(files.values())
        if reader.has_scenario:
            written.append(opened('trajectory', header(reader.config), 0))
            for columns in _trajectory(reader):
                written[-1].write(columns)
    return {file.name: file.rows for file in written}


def _columns(batch: Batch) -> list[list[Any]]:
    return [batch.ticks.tolist(), batch.stamps.tolist(), *batch.values.T.tolist()]


def _trajectory(reader: BagReader) -> Iterator[list[list[Any]]]:
    found = trajectory(reader)
    while block := [[float(value) for value in row] for _, row, _ in islice(found, BATCH)]:
        yield [list(column) for column in zip(*block, strict=True)]


class _CsvFile:
    """A CSV file of numbers in the shortest text that reads back exactly."""

    def __init__(self, path: Path, columns: Sequence[str]) -> None:
        self.name, self.rows = path.name, 0
        self._file = open(path, 'w', encoding='ascii', newline='')  # noqa: SIM115 - see close
        self._file.write(','.join(columns) + '\n')

    def write(self, columns: list[list[Any]]) -> None:
        """Append rows, given column by column."""
        lines = [','.join([repr(value) for value in row]) for row in zip(*columns, strict=True)]
        self.rows += len(lines)
        self._file.writelines(line + '\n' for line in lines)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class _ParquetFile:
    """A Parquet file with columns of int64, then of float64."""

    def __init__(self, path: Path, columns: Sequence[str], integers: int) -> None:
        arrow, parquet = _pyarrow()
        self.name, self.rows = path.name, 0
        self._arrow = arrow
        kinds = [arrow.int64()] * integers + [arrow.float64()] * (len(columns) - integers)
        self._schema = arrow.schema(list(zip(columns, kinds, strict=True)))
        self._writer = parquet.ParquetWriter(path, self._schema)

    def write(self, columns: list[list[Any]]) -> None:
        """Append rows, given column by column."""
        arrays = [
            self._arrow.array(column, type=field.type)
            for column, field in zip(columns, self._schema, strict=True)
        ]
        self.rows += len(columns[0])
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


class _MatFile:
    """
    A MATLAB file (version 5) with one variable, a struct of column vectors named as the columns.

    The format has no way to append, so the columns are held in memory until the file is closed.
    """

    def __init__(self, path: Path, columns: Sequence[str], integers: int) -> None:
        self.name, self.rows = path.name, 0
        self._path = path
        self._kinds = [np.int64] * integers + [np.float64] * (len(columns) - integers)
        self._names, self._blocks = columns, [[np.empty(0, kind)] for kind in self._kinds]

    def write(self, columns: list[list[Any]]) -> None:
        """Append rows, given column by column."""
        self.rows += len(columns[0])
        for kind, blocks, column in zip(self._kinds, self._blocks, columns, strict=True):
            blocks.append(np.array(column, kind))

    def close(self) -> None:
        """Write the file."""
        from scipy.io import savemat  # 0.1 s to import

        arrays = {
            MATLAB_UNSAFE.sub('_', name): np.concatenate(blocks)
            for name, blocks in zip(self._names, self._blocks, strict=True)
        }
        savemat(self._path, {self._path.stem: arrays}, long_field_names=True, oned_as='column')


class _Table(Protocol):
    """A file of rows under construction."""

    name: str
    rows: int

    def write(self, columns: list[list[Any]]) -> None: ...

    def close(self) -> None: ...


def _open(
    directory: Path, name: str, columns: Sequence[str], integers: int, file_format: str
) -> _Table:
    path = directory / f'{name}.{file_format}'
    if file_format == 'csv':
        return _CsvFile(path, columns)
    kind = _MatFile if file_format == 'mat' else _ParquetFile
    return kind(path, columns, integers)


def _pyarrow() -> tuple[Any, Any]:
    try:
        return import_module('pyarrow'), import_module('pyarrow.parquet')
    except ImportError:
        raise BagError(NO_PYARROW) from None
