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

"""A run in memory: its rows, its summary, and conversions for other libraries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
import os
from pathlib import Path
from typing import Any, TYPE_CHECKING

from flexarm_ros.api.extras import extra
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.run.results.columns import ROW_COLUMNS
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    import pandas
    import xarray

SHOWN = ('stable', 'rms_error', 'max_error', 'max_overshoot', 'max_deflection', 'max_torque')

Table = NDArray[np.void]


@dataclass(frozen=True, repr=False, eq=False)
class Run:
    """
    One run.

    Attributes
    ----------
    name
        Name of the scenario, or of the directory that was read.
    trajectory
        A NumPy structured array, shape ``(ticks,)``, one row a tick, with the columns of
        ``trajectory.csv`` as fields: ``run.trajectory["theta1"]``.  Seconds, rad, m, N m.
    summary
        ``summary.json`` as a dict: metrics, versions, every parameter; None for a number that
        is unknown or not finite.
    directory
        Directory of the run's files, or None.

    """

    name: str
    trajectory: Table
    summary: Mapping[str, Any]
    directory: Path | None = None

    @property
    def stable(self) -> bool | None:
        """Whether the arm stayed stable; None for an interrupted run."""
        stable: bool | None = self.summary.get('stable')
        return stable

    @property
    def scenario(self) -> Mapping[str, Mapping[str, Any]]:
        """Return the resolved parameters, ``{section: {key: value}}``."""
        scenario: Mapping[str, Mapping[str, Any]] = self.summary['scenario']
        return scenario

    @property
    def columns(self) -> tuple[str, ...]:
        """Return the names of the columns: those of every run, then those of optional parts."""
        return tuple(self.trajectory.dtype.names or ())

    def to_numpy(self) -> FloatArray:
        """Return the rows as floats, shape ``(ticks, columns)``, in the order of `columns`."""
        return np.stack([self.trajectory[name] for name in self.columns], axis=-1)

    def to_pandas(self) -> pandas.DataFrame:
        """Return the rows as a DataFrame indexed by the time ``t``, s (needs pandas)."""
        with extra('pandas'):
            import pandas

        frame = pandas.DataFrame({name: self.trajectory[name] for name in self.columns[1:]})
        frame.index = pandas.Index(self.trajectory['t'], name='t')
        frame.attrs = {'name': self.name, 'units': self._units()}
        return frame

    def to_xarray(self) -> xarray.Dataset:
        """Return the rows over the coordinate ``t``, with units, descriptions (needs xarray)."""
        with extra('xarray'):
            import xarray

        units = self._units()
        meanings = {column.name: column.meaning for column in ROW_COLUMNS}

        def described(name: str) -> tuple[str, FloatArray, dict[str, str]]:
            notes = {'units': units[name], 'long_name': meanings.get(name, name)}
            return 't', self.trajectory[name].copy(), notes

        return xarray.Dataset(
            {name: described(name) for name in self.columns[1:]},
            coords={'t': described('t')},
            attrs={'name': self.name, 'stable': str(self.stable)},
        )

    def _units(self) -> dict[str, str]:
        """Return the unit of each column; empty for a number, and where it is unknown."""
        from flexarm_ros.analysis.report.runs import ReportedRun

        declared = ReportedRun(Path(self.name), {}, self.summary, self.scenario).units()
        return {name: declared.get(name, '') for name in self.columns}

    def plot(self, kind: str = 'paths') -> Figure:
        """Return a matplotlib figure: ``paths``, ``corners``, ``signals``, ``parts``, ``fls``."""
        from flexarm_ros.api.pictures import plot

        return plot(self, kind=kind)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write the interactive HTML page of this run and return its path."""
        from flexarm_ros.api.pictures import report

        return report(self, path)

    def __repr__(self) -> str:
        values = ', '.join(f'{key}={_brief(self.summary.get(key))}' for key in SHOWN)
        return f'<Run {self.name}: {len(self.trajectory)} ticks, {values}>'

    def _repr_html_(self) -> str:
        """Return the metrics as a small table for notebooks."""
        rows = ''.join(
            f"<tr><th scope='row'>{key}</th><td>{_brief(self.summary.get(key))}</td></tr>"
            for key in ('ticks', *SHOWN)
        )
        return f'<table><caption>{escape(self.name)}</caption>{rows}</table>'


def load(path: str | os.PathLike[str]) -> Run:
    """
    Read a run from its output directory or its bag.

    Parameters
    ----------
    path
        The output directory of a run, or the bag in it.

    Raises
    ------
    RunError
        If ``path`` is not a run, or cannot be read.

    """
    from flexarm_ros.analysis.report.runs import load_run

    read = load_run(Path(path))
    return Run(read.name, _structured(read.columns, read.rows), read.summary, read.directory)


def table_of(rows: FloatArray, names: Sequence[str]) -> Table:
    """Return rows of ``trajectory.csv`` (n, m) with this header as a structured array."""
    return _structured(dict(zip(names, rows.T, strict=True)), len(rows))


def _structured(columns: Mapping[str, FloatArray], length: int) -> Table:
    table = np.empty(length, dtype=[(name, float) for name in columns])
    for name, column in columns.items():
        table[name] = column
    table.flags.writeable = False
    return table


def _brief(value: Any) -> str:
    return f'{value:.4g}' if isinstance(value, float) else str(value)
