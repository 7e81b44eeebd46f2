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
Tables of the report page as HTML: metrics, claims, scenario, provenance.

All text from files is escaped by ``escape``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from html import escape
from typing import Any

from flexarm_ros.analysis.report.claims import Claim, Claims
from flexarm_ros.analysis.report.runs import labels, number, ReportedRun
from flexarm_ros.core.parameters.sections import keys, SECTIONS
from flexarm_ros.core.run.results.metric_list import NUMBERS

MOST_SWITCHES = 12
"""Maximum number of direction switches whose overshoots are listed."""

LONGEST = 300
"""Most characters of a text from a file that a page shows."""

EDGES = {'holds': 'good', 'in part': 'part', 'does not hold': 'bad'}


def text(value: Any) -> str:
    """Return any value from a file as HTML text of limited length."""
    shown = value if isinstance(value, str) else repr(value)
    return escape(shown if len(shown) <= LONGEST else shown[: LONGEST - 1] + '…')


def _breakable(name: str) -> str:
    """Return a run's name as HTML with line breaks allowed after underscores only."""
    return text(name).replace('_', '_<wbr>')


def _scroll(table: str, label: str) -> str:
    region = f'tabindex="0" role="region" aria-label="{escape(label)}"'
    return f'<div class="scroll" {region}>{table}</div>'


def _run_heads(runs: Sequence[ReportedRun]) -> str:
    return ''.join(
        f'<th scope="col">{text(label)}<span class="name">{_breakable(run.name)}</span></th>'
        for run, label in zip(runs, labels(runs), strict=True)
    )


def metrics_table(runs: Sequence[ReportedRun]) -> str:
    """Return the metrics of all runs, one column each."""
    rows = [_row('Outcome', '', [_outcome(run) for run in runs])]
    if any(run.external for run in runs):
        named = [text(', '.join(run.external)) or 'none' for run in runs]
        rows.append(_row('External nodes', '', named))
    for metric in NUMBERS:
        name = metric.title[0].upper() + metric.title[1:]
        values = [run.summary.get(metric.name) for run in runs]
        if any(isinstance(value, list) for value in values):
            rows += _list_rows(name, metric.unit, values)
        else:
            rows.append(_row(name, metric.unit, [_number(value) for value in values]))
    head = f'<thead><tr><th scope="col">Metric</th>{_run_heads(runs)}</tr></thead>'
    table = f'<table class="numbers sticky">{head}<tbody>{"".join(rows)}</tbody></table>'
    return _scroll(table, 'Metrics') + (
        '<p class="note">Errors are distances from the undelayed reference: of the rigid '
        'kinematics of the joint angles or, for the bent tip, of the true tip. Overshoot is the '
        'largest distance past the corner, along the old direction, in the second after the '
        'switch. –: no value.</p>'
    )


def _row(name: str, unit: str, cells: Sequence[str]) -> str:
    shown = f' <span class="unit">{unit}</span>' if unit else ''
    held = ''.join(f'<td>{cell}</td>' for cell in cells)
    return f'<tr><th scope="row">{escape(name)}{shown}</th>{held}</tr>'


def _list_rows(name: str, unit: str, values: Sequence[Any]) -> list[str]:
    lists = [value if isinstance(value, list) else [] for value in values]
    length = min(MOST_SWITCHES, max(map(len, lists)))
    shown = [[_number(items[i]) if i < len(items) else '–' for items in lists]
             for i in range(length)]  # fmt: skip
    known = max((i for i, row in enumerate(shown, 1) if set(row) != {'–'}), default=0)
    rows = [_row(f'{name}, switch {i}', unit, row) for i, row in enumerate(shown[:known], 1)]
    if known < length:  # one row for all unknown values
        later = f', switch {known + 1} and later' if known + 1 < length else f', switch {length}'
        rows.append(_row(name + (later if known else ''), unit, shown[known]))
    return rows


def _number(value: Any) -> str:
    known = number(value)
    if known is None:
        return '–'
    if isinstance(value, int):
        return str(value)
    return f'{known:#.4g}' if 1e-4 < abs(known) < 1e4 else f'{known:.4g}'


def _outcome(run: ReportedRun) -> str:
    problem = run.summary.get('problem')
    why = f'<br>{text(problem)}' if isinstance(problem, str) and problem else ''
    if run.stable is True:
        return f'<span class="good">stable</span>{why}'
    if run.stable is False:
        return f'<span class="bad">unstable</span>{why}'
    return f'<span class="part">not finished</span>{why}'


def claims_section(claims: Claims) -> str:
    """Return the section on the paper's claims, empty if no claim can be decided."""
    if not claims.tested:
        return ''
    parts = ''.join(_claim(claim) for claim in claims.tested)
    notes = list(claims.remarks)
    if claims.untested:
        notes.append(f'Not decided by these runs: {"; ".join(claims.untested)}.')
    remarks = ''.join(f'<p class="note">{escape(note)}</p>' for note in notes)
    return (
        '<section aria-labelledby="h-claims"><h2 id="h-claims">The paper’s claims</h2>'
        f'{parts}{remarks}'
        '<p class="note">Click on a claim to see its comparisons, which are those of '
        '<code>flexarm suite paper</code>. overshoot[0] is that at the first switch. A claim '
        'holds in part if only some of its comparisons hold.</p></section>'
    )


def _claim(claim: Claim) -> str:
    edge = EDGES[claim.verdict]
    verdict = 'holds in part' if claim.verdict == 'in part' else claim.verdict
    part = len(claim.outcomes)
    count = (
        ''
        if part == claim.checks
        else f' as far as these runs show ({part} of {claim.checks} comparisons)'
    )
    held = sum(bool(outcome.holds) for outcome in claim.outcomes)
    items = ''.join(
        f'<li><span class="{"good" if outcome.holds else "bad"}">'
        f'{"yes" if outcome.holds else "no"}</span> {text(outcome.text)}</li>'
        for outcome in claim.outcomes
    )
    return (
        f'<details class="claim {edge}-edge"><summary>{text(claim.text)}: '
        f'<strong class="{edge}">{verdict}</strong>{count} '
        f'<span class="count">({held} of {part} hold)</span></summary><ul>{items}</ul></details>'
    )


def scenario_table(runs: Sequence[ReportedRun]) -> str:
    """Return the resolved parameters: those that differ between the runs first."""
    keys: dict[tuple[str, str], None] = {}
    for run in runs:
        for section, held in run.scenario.items():
            keys.update(dict.fromkeys((section, key) for key in held))
    if not keys:
        return '<p>The summaries of the runs have no scenario.</p>'
    rows = []
    for section, key in keys:
        name = key if section == '/**' else f'{section}.{key}'
        cells = [
            _parameter(run.value(section, key)) if key in run.scenario.get(section, ()) else '–'
            for run in runs
        ]
        rows.append((text(name) + _unit(section, key), cells))
    return _facts(runs, rows, 'Parameter')


def _facts(runs: Sequence[ReportedRun], rows: Sequence[tuple[str, list[str]]], what: str) -> str:
    """Return tables of HTML cells: differing ones, one column per run, then the common ones."""
    tables = []
    differing = [(name, cells) for name, cells in rows if len(set(cells)) > 1]
    if differing:
        body = ''.join(
            f'<tr><th scope="row">{name}</th>{"".join(f"<td>{cell}</td>" for cell in cells)}</tr>'
            for name, cells in differing
        )
        head = f'<thead><tr><th scope="col">{what}</th>{_run_heads(runs)}</tr></thead>'
        table = f'<table class="facts sticky">{head}<tbody>{body}</tbody></table>'
        tables.append(f'<h3>Different</h3>{_scroll(table, f"{what}, different")}')
    body = ''.join(
        f'<tr><th scope="row">{name}</th><td>{cells[0]}</td></tr>'
        for name, cells in rows
        if len(set(cells)) == 1
    )
    if body:
        head = f'<thead><tr><th scope="col">{what}</th><th scope="col">Value</th></tr></thead>'
        table = f'<table class="facts">{head}<tbody>{body}</tbody></table>'
        scroll = _scroll(table, f'{what}, equal')
        if len(runs) > 1:
            scroll = f'<details><summary>Equal in all runs</summary>{scroll}</details>'
        tables.append(scroll)
    return ''.join(tables)


def _parameter(value: Any) -> str:
    if value is None:
        return 'default'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return text(', '.join(str(item) for item in value[:50]))
    return text(str(value)) if isinstance(value, (str, int, float)) else text(value)


def _unit(section: str, key: str) -> str:
    known = keys(section).get(key) if section in SECTIONS else None
    unit = known[1].unit if known else ''
    return f' <span class="unit">{escape(unit)}</span>' if unit else ''


def provenance_table(runs: Sequence[ReportedRun]) -> str:
    """Return the directory, scenario name and versions of each run."""
    names = dict.fromkeys(name for run in runs for name in _versions(run))
    facts: list[tuple[str, Callable[[ReportedRun], Any]]] = [
        ('directory', lambda run: str(run.directory)),
        ('scenario', lambda run: run.summary.get('name') or '–'),
        ('rows', lambda run: run.rows),
    ]
    rows = [(name, [text(value(run)) for run in runs]) for name, value in facts]
    for name in names:
        rows.append((text(name), [text(_versions(run).get(name, '–')) for run in runs]))
    return _facts(runs, rows, 'Fact')


def _versions(run: ReportedRun) -> dict[str, Any]:
    versions = run.summary.get('versions')
    return versions if isinstance(versions, dict) else {}
