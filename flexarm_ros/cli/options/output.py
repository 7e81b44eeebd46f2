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

"""Shared by the commands that run a scenario: the output directory and the final table."""

from __future__ import annotations

from pathlib import Path
import sys
from typing import Any

from flexarm_ros.cli import UsageError
from flexarm_ros.core.run.results.metric_list import METRICS
from flexarm_ros.scenario.errors import clip


def check_utf8(option: str, text: str) -> None:
    """Raise UsageError for a path that is not UTF-8, as ROS parameters and JSON require."""
    try:
        text.encode()
    except UnicodeEncodeError:
        raise UsageError(
            f'{option}{clip(text, 200)}: not UTF-8, or the locale is not (try LC_ALL=C.UTF-8)'
        ) from None


def new_directory(
    out: Path | None, name: str, below: Path = Path('runs'), option: str = '--out '
) -> Path:
    """
    Return the directory of a new run: ``out``, or ``runs/NAME``, ``runs/NAME-2``, ...

    A default one is created at once, so that concurrent runs get different directories.
    Raises UsageError, prefixed by ``option``, if ``out`` is not empty.
    """
    check_utf8('', name)
    if out is not None:
        check_utf8(option, str(out.absolute()))
        try:
            taken = out.exists() and (not out.is_dir() or any(out.iterdir()))
        except (OSError, ValueError) as error:
            raise UsageError(f'{option}{clip(str(out), 200)}: {error}') from None
        if taken:
            raise UsageError(f'{option}{clip(str(out), 200)}: exists already, not overwritten')
        return out
    number = 1
    while True:
        path = below / (name if number == 1 else f'{name}-{number}')
        try:
            path.mkdir(parents=True)
        except FileExistsError:
            if below.exists() and not below.is_dir():
                raise UsageError(f'{below}: not a directory; give --out DIR') from None
            number += 1
        else:
            return path


def skips(path: Path, command: str) -> bool:
    """Whether ``path`` is a report or a sweep and not a run; prints that it is skipped."""
    from flexarm_ros.analysis.report.page import PAGE
    from flexarm_ros.analysis.sweep.store import IDENTITY

    for kind, file in (('report', PAGE), ('sweep', IDENTITY)):
        if (path / file).is_file():
            print(f'flexarm {command}: {path}: skipped, a {kind}', file=sys.stderr)
            return True
    return False


def show_outcome(directory: Path, summary: dict[str, Any], pictures: bool = False) -> None:
    """
    Print a run's metrics and the location of its files, then draw the figures if asked.

    None are drawn of a run that failed; an unstable run is no failure here.
    """
    rows = [('result', headline(summary))]
    if summary.get('external'):
        rows.append(('external', ', '.join(summary['external'])))
    rows += [
        (metric.title, f'{shown} {metric.unit}')
        for metric in METRICS
        if (shown := format_metric(summary.get(metric.name))) not in ('', '-')
    ]
    for label, path in (
        ('bag', directory / 'bag'),
        ('rows', directory / 'trajectory.csv'),
        ('summary', directory / 'summary.json'),
    ):
        if path.exists():
            rows.append((label, str(path)))
    width = max(len(label) for label, _ in rows)
    for label, text in rows:
        print(f'{label:<{width}}  {text}')
    sys.stdout.flush()  # drawing takes seconds
    for path in _draw(directory) if pictures and summary.get('stable') is not None else []:
        print(f'{"picture":<{width}}  {path}')


def headline(summary: dict[str, Any]) -> str:
    """Return the outcome of a run in one line."""
    ticks, problem = summary.get('ticks'), str(summary.get('problem') or 'no reason known')
    if summary.get('stable'):
        state = 'stable'
    elif summary.get('stable') is False:
        state = problem.replace('unstable', 'UNSTABLE', 1)
    else:
        state = f'not finished: {problem}'
    speed = ''
    if summary.get('wall_s') is not None and summary.get('rtf') is not None:
        speed = f' in {summary["wall_s"]:.3g} s, {summary["rtf"]:.3g} times real time'
    return f'{state}; {ticks if ticks is not None else "no"} ticks{speed}'


def format_metric(value: Any) -> str:
    """
    Return a metric with five digits, ``-`` if unknown, empty for no values.

    Unknown values at the end of a list are shown as one ``-``.
    """
    if isinstance(value, list):
        shown = [format_metric(item) for item in value]
        known = max((i for i, text in enumerate(shown, 1) if text != '-'), default=0)
        return ' '.join(shown[: known + 1])
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f'{value:.5g}'
    return '-'


def _draw(directory: Path) -> list[Path]:
    try:
        from flexarm_ros.analysis.figures.runs import write_figures
    except ImportError as error:
        print(f'no pictures: {error}', file=sys.stderr)
        return []
    try:
        return list(write_figures([directory], directory / 'pictures'))
    except Exception as error:  # a failed figure must not fail the run
        print(f'no pictures: {type(error).__name__}: {clip(str(error), 200)}', file=sys.stderr)
        return []
