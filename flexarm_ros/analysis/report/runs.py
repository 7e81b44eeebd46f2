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

"""A run's output directory as data: its rows, its summary, and its label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.core.arm.kinematics import round_off
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.results.columns import COLUMNS, units
import numpy as np

COLLOCATED = 'collocated'
NONCOLLOCATED = 'noncollocated (NMP)'
CORRECTED = 'NMP corrected'

EXTERNAL = 'external'
"""Law name of an external controller."""

LARGEST = 1e60
"""Larger values count as not finite: squares and scales of figures would overflow."""

TURN = np.cos(np.radians(5.0))
"""Cosine of the smallest change of the reference's direction that counts as a switch."""


class RunError(Exception):
    """A directory is not a run, or its files cannot be read; one line for the user."""


@dataclass(frozen=True)
class ReportedRun:
    """
    One run read from its directory.

    ``columns`` maps each name in ``trajectory.csv``, ``COLUMNS`` first, to an array of shape
    ``(rows,)``, with nan for values that are not finite.  ``summary`` is the content of
    ``summary.json``, ``scenario`` its resolved parameters as ``{section: {key: value}}``.
    """

    directory: Path
    columns: Mapping[str, FloatArray]
    summary: Mapping[str, Any]
    scenario: Mapping[str, Mapping[str, Any]]

    @property
    def name(self) -> str:
        """Return the name of the directory."""
        return self.directory.name or str(self.directory)

    @property
    def rows(self) -> int:
        """Return the number of recorded ticks."""
        return len(self.columns['t'])

    @property
    def law(self) -> str:
        """Return ``controller.law``, `EXTERNAL`, or an empty text if unknown."""
        if 'controller' in self.external:
            return EXTERNAL
        value = self.value('controller', 'law')
        return value if isinstance(value, str) else ''

    @property
    def external(self) -> tuple[str, ...]:
        """Return the roles of external nodes."""
        roles = self.summary.get('external')
        return tuple(map(str, roles)) if isinstance(roles, list) else ()

    @property
    def role(self) -> str:
        """Return which of the paper's three cases this is, empty for a law without feedback."""
        feedback = self.value('controller', 'feedback')
        if self.law in ('open_loop', EXTERNAL) or feedback not in ('encoder', 'tip_sensor'):
            return ''
        if feedback == 'encoder':
            return COLLOCATED
        delay = number(self.value('trajectory', 'delay'))
        return CORRECTED if delay is not None and delay > 0.0 else NONCOLLOCATED

    @property
    def location(self) -> float | None:
        """Return the location of the position sensor in the loop, m, None without one."""
        if self.role in ('', COLLOCATED):
            return None
        return number(self.value('tip_sensor', 'location'))

    @property
    def lengths(self) -> tuple[float, float]:
        """Return the links' lengths with rigid parts, m; the paper's if the scenario has none."""
        first, second = self._pair('length') or (4.5, 4.5)
        for key in ('hub_radius', 'end_offset'):
            more = self._pair(key) or (0.0, 0.0)
            first, second = first + more[0], second + more[1]
        return first, second

    def _pair(self, key: str) -> tuple[float, float] | None:
        value = self.value('plant', key)
        known = [number(item) for item in value] if isinstance(value, (list, tuple)) else []
        first, second = known if len(known) == 2 else (None, None)
        return None if first is None or second is None else (first, second)

    @property
    def stable(self) -> bool | None:
        """Return the summary's verdict, ``None`` without one."""
        value = self.summary.get('stable')
        return value if isinstance(value, bool) else None

    def value(self, section: str, key: str) -> Any:
        """Return a parameter of the scenario, ``None`` if unknown."""
        return self.scenario.get(section, {}).get(key)

    @property
    def config(self) -> RunConfig | None:
        """Return the scenario, ``None`` if it is invalid here, as without a plug-in of the run."""
        # A summary has no section of an external node whose keys no other part reads.
        sections: dict[str, Any] = {role: {} for role in self.external}
        sections |= {name: {**keys} for name, keys in self.scenario.items()}
        try:
            return scenario.from_dict(sections)
        except (scenario.ScenarioError, TypeError, ValueError):
            return None

    def units(self) -> dict[str, str]:
        """Return the declared units by column; see `columns.units`."""
        return units(self.config)

    def optional(self) -> dict[str, FloatArray]:
        """
        Return the columns of optional parts that have values: name with unit -> ``(rows,)``.

        The parts declare the units; a column that none of them declares has none.
        """
        declared = self.units()
        return {
            ', '.join(filter(None, (name, declared.get(name)))): values
            for name, values in self.columns.items()
            if name not in COLUMNS and np.isfinite(values).any()
        }

    def switches(self) -> list[float]:
        """Return the times, s, at which the reference changes its direction of motion."""
        x, y = self.columns['ref_x'], self.columns['ref_y']
        dx, dy = np.diff(x), np.diff(y)
        length = np.nan_to_num(np.hypot(dx, dy))
        moving = np.flatnonzero(length > 1e-9 * max(1.0, float(np.max(length, initial=0.0))))
        if len(moving) < 2:
            return []
        ux, uy = dx[moving] / length[moving], dy[moving] / length[moving]
        turns = np.flatnonzero(ux[1:] * ux[:-1] + uy[1:] * uy[:-1] < TURN)
        return [float(self.columns['t'][row]) for row in moving[turns + 1]]

    def error(self) -> FloatArray:
        """Return the distance of the rigid end effector from the undelayed reference, m."""
        return self._distance('rigid')

    def tip_error(self) -> FloatArray:
        """Return the distance of the true tip from the undelayed reference, m."""
        return self._distance('tip')

    def _distance(self, point: str) -> FloatArray:
        """Return the distance of a point from the reference, m; 0 if within rounding."""
        c = self.columns
        x, y = c['ref_x'], c['ref_y']
        found = np.hypot(c[f'{point}_x'] - x, c[f'{point}_y'] - y)
        return np.where(found <= round_off(self.lengths, np.hypot(x, y)), 0.0, found)


def number(value: Any) -> float | None:
    """Return a finite number as a float, ``None`` for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    try:
        result = float(value)
    except OverflowError:
        return None
    return result if np.isfinite(result) else None


def load_run(
    path: Path, given: RunConfig | None = None, namespace: str | None = None
) -> ReportedRun:
    """
    Return the run in ``path``: its output directory, or the bag or a file in it.

    If a directory lacks ``trajectory.csv`` or ``summary.json``, its bag is read; ``given`` and
    ``namespace`` are for bags of other recorders (see ``BagReader``).  Raises ``RunError`` if
    ``path`` is not a run, or a file of it cannot be read.
    """
    directory = _directory(Path(path))
    if directory is not None:
        summary = _read_summary(directory / 'summary.json')
        columns = _read_rows(directory / 'trajectory.csv')
    else:
        columns, summary, directory = _from_bag(Path(path), given, namespace)
    columns = {name: without_extremes(values) for name, values in columns.items()}
    return ReportedRun(directory, columns, summary, _sections(summary.get('scenario')))


def _directory(path: Path) -> Path | None:
    """Return the output directory that ``path`` is or lies in, if it has its files."""
    try:
        resolved = path.resolve()
        for candidate in (resolved, *list(resolved.parents)[:2]):
            if (candidate / 'trajectory.csv').is_file() and (candidate / 'summary.json').is_file():
                return candidate
            if candidate.is_dir() and candidate.name != 'bag':
                return None
    except (OSError, RuntimeError, ValueError) as error:
        raise RunError(f'{str(path)!r} is not a run: {error}') from None
    return None


def load_runs(runs: Sequence[Path | ReportedRun]) -> list[ReportedRun]:
    """Return the runs, loading those given as paths."""
    return [run if isinstance(run, ReportedRun) else load_run(run) for run in runs]


def _from_bag(
    path: Path, given: RunConfig | None, namespace: str | None
) -> tuple[Mapping[str, FloatArray], Mapping[str, Any], Path]:
    """Return columns and summary of a bag, and its output directory."""
    from flexarm_ros.analysis.report.bag import read_bag
    from flexarm_ros.bag.errors import BagError

    try:
        columns, summary, bag = read_bag(path, given, namespace)
    except BagError as error:
        files = 'no trajectory.csv with summary.json'
        raise RunError(f'{path} is not a run: {files}, and no bag: {error}') from None
    bag = bag.resolve()
    parent = bag if bag.is_dir() else bag.parent
    return columns, summary, parent.parent if parent.name == 'bag' else parent


def without_extremes(values: FloatArray) -> FloatArray:
    """Return values with nan for those beyond the range of figures."""
    return np.where(np.abs(values) < LARGEST, values, np.nan)


def _read_summary(path: Path) -> Mapping[str, Any]:
    try:
        summary = json.loads(path.read_text('utf-8'))
    except (OSError, ValueError, RecursionError) as error:
        raise RunError(f'{path} cannot be read: {error}') from None
    if not isinstance(summary, dict):
        raise RunError(f'{path} cannot be read: it is not a JSON object')
    return summary


def _sections(scenario: Any) -> Mapping[str, Mapping[str, Any]]:
    """Return ``{section: {key: value}}``, with or without the ``ros__parameters`` level."""
    if not isinstance(scenario, dict):
        return {}
    found: dict[str, Mapping[str, Any]] = {}
    for section, keys in scenario.items():
        if isinstance(keys, dict):
            inner = keys.get('ros__parameters')
            found[section] = inner if isinstance(inner, dict) else keys
    return found


def _read_rows(path: Path) -> Mapping[str, FloatArray]:
    """Return the columns of a trajectory; a truncated last row is left out."""
    try:
        with path.open(encoding='utf-8', newline='') as file:
            header = file.readline().strip().split(',')
            missing = [name for name in COLUMNS if name not in header]
            if missing:
                raise RunError(f'{path} cannot be read: it has no column {missing[0]}')
            table = _table(file.read().splitlines(), len(header))
    except (OSError, ValueError) as error:
        raise RunError(f'{path} cannot be read: {error}') from None
    return {name: table[:, place] for place, name in enumerate(header)}


def _table(lines: list[str], width: int) -> FloatArray:
    if lines and lines[-1].count(',') != width - 1:
        del lines[-1]
    table = np.empty((len(lines), width))
    for row, line in enumerate(lines):
        values = [float(text) if text else np.nan for text in line.split(',')]
        if len(values) != width:
            raise ValueError(f'row {row + 1} has {len(values)} values, the header {width}')
        table[row] = values
    return table


LAW_NAMES = {
    'pd': 'PD', 'fls': 'FLS', 'open_loop': 'Open loop', EXTERNAL: 'External controller'
}  # fmt: skip


def law_name(law: str) -> str:
    """Return the display name of a control law."""
    return LAW_NAMES.get(law, law.upper() if len(law) <= 4 else law) or 'Unknown law'


def labels(runs: Sequence[ReportedRun], short: bool = False) -> list[str]:
    """
    Return one distinct text per run: the case, then the differences between equal cases.

    ``short`` leaves out the law and the sensor location, for figures that state them elsewhere.
    """
    texts = [_base_label(run, short) for run in runs]
    for text in {text for text in texts if texts.count(text) > 1}:
        same = [i for i, other in enumerate(texts) if other == text]
        for i, note in zip(same, _differences([runs[i] for i in same]), strict=True):
            texts[i] = f'{text}, {note}' if note else text
    for text in {text for text in texts if texts.count(text) > 1}:
        same = [i for i, other in enumerate(texts) if other == text]
        names = [runs[i].name for i in same]
        for order, i in enumerate(same):
            mark = names[order] if names.count(names[order]) == 1 else str(order + 1)
            texts[i] = f'{text}, {mark}'
    return texts


def _base_label(run: ReportedRun, short: bool) -> str:
    parts = [run.role or law_name(run.law)] if short else [law_name(run.law), run.role]
    if run.location is not None and not short:
        parts.append(f'sensor at {run.location:g} m')
    return ', '.join(filter(None, (*parts, external_parts(run))))


def external_parts(run: ReportedRun) -> str:
    """Return the external nodes other than the controller, empty if there are none."""
    others = [role.replace('_', ' ') for role in run.external if role != 'controller']
    return f'external {" and ".join(others)}' if others else ''


def _differences(runs: Sequence[ReportedRun]) -> list[str]:
    """Return for each run its values of the (at most two) parameters that differ."""
    keys: dict[tuple[str, str], None] = {}
    for run in runs:
        for section, held in run.scenario.items():
            keys.update(dict.fromkeys((section, key) for key in held))
    differing = [
        (section, key)
        for section, key in keys
        if section != 'recorder'
        and len({json.dumps(run.value(section, key), sort_keys=True) for run in runs}) > 1
    ]
    return [
        ', '.join(f'{key} {_brief(run.value(section, key))}' for section, key in differing[:2])
        for run in runs
    ]


def _brief(value: Any) -> str:
    if isinstance(value, list):
        return '/'.join(_brief(item) for item in value[:3])
    if isinstance(value, float):
        return f'{value:g}'
    text = 'default' if value is None else str(value)
    return text if len(text) <= 24 else text[:23] + '…'
