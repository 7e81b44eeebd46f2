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

"""Data for the page's script: packed rows of each run, and the fuzzy logic system."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

from flexarm_ros.analysis.figures.style import Style, styles
from flexarm_ros.analysis.report.runs import labels, law_name, ReportedRun
from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.run.results.columns import axis_label, COLUMNS
import numpy as np
from numpy.typing import NDArray

ROW_BUDGET = 48_000
"""Total rows in a page: three complete runs of 16 s at 1 kHz, about 2 MB."""

LEAST_ROWS = 600
"""Least rows of each run, whatever the number of runs."""

MOST_SWITCHES = 200
"""Most direction switches of a run that a page marks."""

PACKED = tuple(name for name in COLUMNS if name not in ('dtheta1', 'dtheta2'))
"""Columns of ``trajectory.csv`` that the page needs, beside those of optional parts."""

ERRORS = {
    'error': ('tracking error, m', 'error, m'),
    'tip_error': ('error of the true tip, m', 'tip error, m'),
}
"""
Further columns with their labels, long and short.

The page could compute them from the packed ones only to 1e-7 of the path.
"""

STEPS = 2**24 - 2
"""Steps between least and largest value of a packed column; the next code means nan."""


def page_data(runs: Sequence[ReportedRun]) -> dict[str, Any]:
    """
    Return the data of a page as JSON-compatible objects.

    ``pool`` holds each different column once (such as equal references of several runs);
    ``runs`` refers to it by index.  ``labels``: long and short label of each column.
    """
    pool: dict[tuple[float, float, str], int] = {}
    budget = max(LEAST_ROWS, ROW_BUDGET // max(1, len(runs)))
    entries = []
    for run, label, style in zip(runs, labels(runs), styles(runs), strict=True):
        kept = select_rows(run, budget)
        optional = run.optional()
        held = {**optional, **{name: run.columns[name] for name in PACKED}}
        held |= zip(ERRORS, (run.error(), run.tip_error()), strict=True)
        columns = {}
        for name, values in held.items():
            columns[name] = pool.setdefault(pack(values[kept]), len(pool))
        entries.append(
            {
                'label': label,
                'name': run.name,
                'law': law_name(run.law),
                **look(style),
                'rows': len(kept),
                'total': run.rows,
                'sensor': run.location,
                'lengths': list(run.lengths),
                'switches': run.switches()[:MOST_SWITCHES],
                'columns': columns,
                'optional': list(optional),
            }
        )
    return {
        'runs': entries,
        'pool': [{'low': low, 'span': span, 'data': data} for low, span, data in pool],
        'steps': STEPS,
        'labels': {
            **ERRORS,
            **{name: (axis_label(name), axis_label(name, symbol=True)) for name in PACKED},
        },
    }


def look(style: Style) -> dict[str, Any]:
    """Return a style with the names of the page: variable of the colour, SVG dashes, width, px."""
    width = round(1.25 * style.width, 3)
    return {
        'color': style.hue if style.shade == 'base' else f'{style.hue}-{style.shade}',
        'dash': ' '.join(f'{length * width:.3g}' for length in style.dashes),
        'width': width,
    }


def pack(values: FloatArray) -> tuple[float, float, str]:
    """
    Return least value, span and base64 text of 24-bit codes of ``(n,)`` values.

    A value is ``low + code / STEPS * span``, at most half a step (3e-8 of the span) off;
    the code ``STEPS + 1`` stands for not-a-number.
    """
    known = values[np.isfinite(values)]
    low = float(known.min()) if len(known) else 0.0
    span = float(known.max()) - low if len(known) else 0.0
    if not np.isfinite(span):  # the difference of the two ends overflows
        return pack(np.where(np.abs(values) < 1e300, values, np.nan))
    scaled = (values - low) / span * STEPS if span > 0.0 else values * 0.0
    codes = np.where(np.isfinite(scaled), np.rint(scaled), STEPS + 1).astype('<u4')
    octets = codes.view(np.uint8).reshape(-1, 4)[:, :3]
    return low, span, base64.b64encode(octets.tobytes()).decode('ascii')


def select_rows(run: ReportedRun, budget: int) -> NDArray[np.int64]:
    """
    Return the rows that a page shows, in order, at most ``budget`` of them.

    All of them if they fit.  Otherwise time is cut into equal parts, and of each part the
    first row stays and those with the least and the largest value of every column, so that
    no transient's peak is lost; every row shown is one that was recorded.
    """
    if run.rows <= budget:
        return np.arange(run.rows)
    shown = [run.columns[name] for name in PACKED[1:]] + [run.error(), run.tip_error()]
    table = np.stack([*shown, *run.optional().values()])
    parts = budget
    while True:
        kept = _extremes(table, parts)
        if len(kept) <= budget or parts <= 1:
            return kept[:budget]
        parts = min(parts - 1, int(parts * max(0.5, 0.98 * budget / len(kept))))


def _extremes(table: FloatArray, parts: int) -> NDArray[np.int64]:
    rows = table.shape[1]
    edges = np.unique(np.linspace(0, rows, parts + 1).astype(np.int64))
    starts = edges[:-1]
    kept: list[NDArray[np.int64]] = [starts, np.array([rows - 1])]
    part_of = np.repeat(np.arange(len(starts)), np.diff(edges))
    for values in table:
        for signed in (values, -values):
            known = np.where(np.isnan(signed), np.inf, signed)
            least = np.minimum.reduceat(known, starts)
            hits = np.flatnonzero(known == least[part_of])
            _, first = np.unique(part_of[hits], return_index=True)
            kept.append(hits[first])
    return np.unique(np.concatenate(kept))
