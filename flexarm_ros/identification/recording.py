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

"""Recordings of an arm: channels over time in SI units, from a CSV, a run or a bag."""

from __future__ import annotations

from collections.abc import Mapping
import csv
from dataclasses import dataclass, replace
import math
import os
from pathlib import Path
import re
from typing import Any

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.identification.setting import GAUGE
from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError, suggestion
import numpy as np

PathLike = str | os.PathLike[str]

_ANGLE = {'rad': 1.0, 'mrad': 1e-3, 'deg': math.pi / 180.0}
_RATE = {'rad_s': 1.0, 'deg_s': math.pi / 180.0}
_LENGTH = {'m': 1.0, 'mm': 1e-3}
_UNITS: dict[str, dict[str, float]] = {
    't': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6, 'ns': 1e-9},
    'theta': _ANGLE,
    'theta_rate': _RATE,
    'theta_reference': _ANGLE,
    'tau': {'nm': 1.0, 'mnm': 1e-3},
    'i': {'a': 1.0, 'ma': 1e-3},
    'strain': {'': 1.0, **_ANGLE, **_LENGTH},
    'tip_x': _LENGTH,
    'tip_y': _LENGTH,
}
"""Channel without the joint's or link's number -> unit suffix -> factor to SI."""

LEAST_ROWS = 20
MOST_VALUE = 1e6
"""Largest value of a channel, SI units; beyond it the unit is wrong."""

GAP_STEPS = 10.0
"""Length of a time step, in sample periods, from which it is called a gap."""

MOST_BYTES = 512 * 1024 * 1024
UNEVEN = 1e-3
"""Largest deviation of a time step from the mean step, as a fraction, without resampling."""

HELD_S = 0.05
"""Time, s, at the start over which an exactly constant channel counts as held."""


@dataclass(frozen=True, eq=False)
class Recording:
    """
    Channels of one arm over time.

    ``times`` (n,): s, evenly spaced by ``period``, from 0.  ``channels``: name -> (n,) in rad,
    rad/s, N m, A, m.  ``strain_units``: of each strain channel: ``angle`` (rad), ``deflection``
    (m) or ``strain``.  ``notes``: a line for each column that is not used, and for resampling.
    """

    name: str
    period: float
    channels: Mapping[str, FloatArray]
    strain_units: Mapping[str, str]
    notes: tuple[str, ...] = ()

    @property
    def rows(self) -> int:
        """Return the number of samples."""
        return len(next(iter(self.channels.values())))

    @property
    def times(self) -> FloatArray:
        """Return the time of each sample, s, from 0."""
        return np.asarray(np.arange(self.rows) * self.period)

    def pair(self, form: str) -> FloatArray:
        """
        Return two channels side by side, shape ``(n, 2)``.

        ``form`` has a place for the number, ``theta{}``.  Raises ScenarioError if one is missing.
        """
        names = [form.format(number) for number in (1, 2)]
        for name in names:
            if name not in self.channels:
                raise ScenarioError(
                    f'{self.name}: no channel {name}; there are {", ".join(self.channels)}'
                )
        return np.ascontiguousarray(np.stack([self.channels[name] for name in names], axis=1))

    def has(self, form: str) -> bool:
        """Whether both channels of a form such as ``tau{}`` are there."""
        return all(form.format(number) in self.channels for number in (1, 2))

    def held_until(self, name: str) -> int:
        """
        Return the first sample at which a channel changes, 0 if it changes at once.

        Until then a sensor program gave a constant (such as 0 while it removes its bias), so that
        these samples are no measurement.
        """
        values = self.channels[name]
        first = int(np.argmax(values != values[0])) if (values != values[0]).any() else 0
        return first if first * self.period >= HELD_S else 0


def read(path: PathLike) -> Recording:
    """
    Read a recording: a ``.csv`` file, or a run or bag of this package or another recorder.

    Raises ScenarioError, one line, if it cannot be read or has no joint angles.
    """
    place = Path(path)
    if place.suffix.lower() == '.csv' and place.is_file():
        return read_csv(place)
    return read_run(place)


def read_csv(path: Path) -> Recording:
    """Read a CSV whose header names each channel with its unit: ``theta1_deg``, ``i1_a``."""
    name = clip(str(path), PATH_WIDTH)
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ScenarioError(f'{name}: larger than {MOST_BYTES} bytes')
        with path.open(newline='', encoding='utf-8-sig') as file:
            header = [text.strip() for text in next(csv.reader([file.readline()]), [])]
            used = [place for place, column in enumerate(header) if channel_of(column)]
            table = _table(file.read().splitlines(), len(header), used, name)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, 'strerror', None) or 'not UTF-8 text'
        raise ScenarioError(f'{name}: cannot be read: {reason}') from None
    doubled = [column for column in header if header.count(column) > 1]
    if doubled:
        raise ScenarioError(f'{name}: two columns {clip(doubled[0])}')
    columns = {header[place]: table[:, i] for i, place in enumerate(used)}
    return _taken(name, {column: columns.get(column) for column in header})


def read_columns(columns: Mapping[str, Any], name: str = 'data') -> Recording:
    """Return columns, (n,) each, named with their unit as in a CSV.  Raises ScenarioError."""
    table = {str(key): np.asarray(values, dtype=float) for key, values in columns.items()}
    shapes = {values.shape for values in table.values()}
    if len(shapes) != 1 or len(next(iter(shapes))) != 1:
        raise ScenarioError(f'{name}: columns of one length are needed, not {shapes}')
    for key, values in table.items():
        if len(values) < LEAST_ROWS or not np.isfinite(values).all():
            raise ScenarioError(f'{name}: {key}: at least {LEAST_ROWS} finite numbers are needed')
    return _taken(name, table)


def _taken(name: str, table: Mapping[str, FloatArray | None]) -> Recording:
    """Return the recording of columns by name; one that is not used may be None."""
    used: dict[str, FloatArray] = {}
    units: dict[str, str] = {}
    notes: list[str] = []
    for column, values in table.items():
        found = channel_of(column)
        if found is None or values is None:
            notes.append(f'column {clip(column)} is not used')
            continue
        channel, factor, unit = found
        if channel in used:
            raise ScenarioError(f'{name}: two columns for {channel}')
        used[channel] = np.ascontiguousarray(values * factor)
        if channel.startswith('strain'):
            units[channel] = unit
    if 't' not in used:
        raise ScenarioError(f'{name}: no column t_s; the columns are {clip(", ".join(table))}')
    return _even(name, _complete(name, used, notes), units, notes)


def _complete(
    name: str, used: Mapping[str, FloatArray], notes: list[str]
) -> dict[str, FloatArray]:
    """Return the channels without the rows that lack a value, with a note; check their range."""
    empty = [channel for channel, values in used.items() if not np.isfinite(values).any()]
    notes.extend(f'{channel}: no row has a value: not used' for channel in empty)
    used = {channel: values for channel, values in used.items() if channel not in empty}
    if 't' not in used:
        raise ScenarioError(f'{name}: t: no row has a value')
    whole = np.asarray(np.isfinite(np.stack(list(used.values()))).all(axis=0))
    missing = len(whole) - int(whole.sum())
    if missing:
        first = int(np.argmin(whole)) + 2
        notes.append(f'rows without a value, left out: {missing}, the first is row {first}')
    if len(whole) - missing < LEAST_ROWS:
        raise ScenarioError(
            f'{name}: {len(whole) - missing} complete rows; at least {LEAST_ROWS} are needed'
        )
    for channel, values in used.items():
        largest = float(np.abs(values[whole]).max())
        if channel != 't' and largest > MOST_VALUE:
            raise ScenarioError(
                f'{name}: {channel}: {largest:.4g} in SI units is out of range, at most '
                f'{MOST_VALUE:g}: is the unit of the column right?'
            )
    return {channel: np.ascontiguousarray(values[whole]) for channel, values in used.items()}


def channel_of(column: str) -> tuple[str, float, str] | None:
    """
    Return channel, factor to SI and, of a strain, its kind, of a column's name; None: unknown.

    The kind is ``angle``, ``deflection`` or ``strain``.
    """
    found = re.fullmatch(
        r'(t|tip_[xy]|[a-z]+?)([12]?)((?:_rate|_reference)?)(?:_(\w+))?', column.lower()
    )
    if found is None:
        return None
    stem, number, more, suffix = found.groups()
    units = _UNITS.get(stem + more)
    if units is None or (suffix or '') not in units or bool(number) == (stem in _UNNUMBERED):
        return None
    unit = suffix or ''
    kind = 'angle' if unit in _ANGLE else 'deflection' if unit in _LENGTH else 'strain'
    return f'{stem}{number}{more}', units[unit], kind


_UNNUMBERED = ('t', 'tip_x', 'tip_y')


def _table(lines: list[str], width: int, used: list[int], name: str) -> FloatArray:
    """Return the columns at the places ``used``, (rows, used); NaN for an empty cell."""
    if len(lines) < LEAST_ROWS:
        raise ScenarioError(f'{name}: {len(lines)} rows; at least {LEAST_ROWS} are needed')
    if not used:
        return np.zeros((len(lines), 0))
    try:
        if any(line.count(',') != width - 1 for line in lines):
            raise ValueError
        return np.asarray(np.loadtxt(lines, delimiter=',', ndmin=2, usecols=used), dtype=float)
    except ValueError:
        return _slow_table(lines, width, used, name)


def _slow_table(lines: list[str], width: int, used: list[int], name: str) -> FloatArray:
    """Read cell by cell as `_table` does, to name the row that cannot be read."""
    table = []
    for row, values in enumerate(csv.reader(lines), start=2):
        if len(values) != width:
            raise ScenarioError(f'{name}: row {row}: {len(values)} values, the header has {width}')
        table.append([_number(values[place].strip(), row, name) for place in used])
    return np.array(table, dtype=float)


def _number(text: str, row: int, name: str) -> float:
    try:
        return float(text) if text else math.nan
    except ValueError:
        raise ScenarioError(f'{name}: row {row}: {clip(repr(text))} is not a number') from None


def _even(
    name: str, used: dict[str, FloatArray], units: Mapping[str, str], notes: list[str]
) -> Recording:
    """Return the channels on even times; resampled linearly, with a note, where they are not."""
    times = used.pop('t')
    steps = np.diff(times)
    if not (steps > 0.0).all():
        row = int(np.argmin(steps > 0.0)) + 3
        raise ScenarioError(f'{name}: row {row}: the time does not increase')
    if not used:
        raise ScenarioError(f'{name}: no column but the time is known{_hint(notes)}')
    period = float((times[-1] - times[0]) / len(steps))
    even = times[0] + period * np.arange(len(times))
    if np.abs(times - even).max() > UNEVEN * period + 1e-9:
        period = float(np.median(steps))
        count = int((times[-1] - times[0]) / period * (1.0 + 1e-12)) + 1
        even = times[0] + period * np.arange(count)
        used = {key: np.interp(even, times, values) for key, values in used.items()}
        notes.append(f'the times are uneven: resampled linearly every {period:.6g} s')
        largest = int(np.argmax(steps))
        if steps[largest] > GAP_STEPS * period:
            begin = times[largest] - times[0]
            notes.append(
                f'a gap of {steps[largest]:.4g} s, {begin:.4g} s after the start, is filled with '
                'a straight line: cut the recording there if the arm moved'
            )
    return Recording(name, period, used, dict(units), tuple(notes))


def _hint(notes: list[str]) -> str:
    columns = [note.split()[1] for note in notes if note.startswith('column ')]
    known = [
        f'{stem}{"" if stem in _UNNUMBERED else "1"}_{unit}'.rstrip('_')
        for stem, allowed in _UNITS.items()
        for unit in allowed
    ]
    return suggestion(columns[0], known) if columns else ''


def read_run(path: Path) -> Recording:
    """
    Read a run or a bag: joint angles, torques, strains, tip.

    The columns are those of ``trajectory.csv``; strains are the readings of the strain gauges, or,
    in a run without them, the true end deflections, m.
    """
    from flexarm_ros.analysis.report.runs import load_run, RunError

    try:
        run = load_run(path)
    except RunError as error:
        raise ScenarioError(str(error)) from None
    columns = run.columns
    gauge = run.scenario.get(GAUGE)
    strain, kind = ('delta', 'end') if gauge is None else ('strain', str(gauge['output']))
    names = {
        **{f'theta{n}': f'theta{n}' for n in (1, 2)},
        **{f'theta{n}_rate': f'dtheta{n}' for n in (1, 2)},
        **{f'tau{n}': f'tau{n}' for n in (1, 2)},
        **{f'strain{n}': f'{strain}{n}' for n in (1, 2)},
        **{f'tip_{axis}': f'tip_{axis}' for axis in 'xy'},
    }
    # A bag of another recorder has no scenario, from which the tip follows.
    names = {
        channel: column for channel, column in names.items() if np.isfinite(columns[column]).any()
    }
    if not names:
        raise ScenarioError(f'{path}: no joint states, torques or deflections of an arm')
    whole = np.isfinite(np.stack([columns[column] for column in names.values()])).all(axis=0)
    rows = len(columns['t']) if bool(np.all(whole)) else int(np.argmin(whole))
    if rows < LEAST_ROWS:
        raise ScenarioError(f'{path}: {rows} complete ticks; at least {LEAST_ROWS} are needed')
    used = {'t': columns['t'][:rows]}
    used.update({channel: columns[column][:rows] for channel, column in names.items()})
    units = {channel: kind for channel in names if channel.startswith('strain')}
    return _even(clip(str(path), PATH_WIDTH), used, units, [])


def moved(recording: Recording, delays: Mapping[str, float]) -> Recording:
    """
    Return a recording with its channels shifted to the time of measurement.

    ``delays``: channel -> age of its samples, s.  Linear between samples; past the end
    the last value is repeated.
    """
    channels = dict(recording.channels)
    times = recording.times
    for name, delay in delays.items():
        if delay and name in channels:
            channels[name] = np.interp(times + delay, times, channels[name])
    return replace(recording, channels=channels)
