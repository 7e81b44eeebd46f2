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
The tables in docs/reference of what is declared in the code: parameters, columns, metrics.

``python -m flexarm_ros.scenario.table`` prints those of parameters, one table a section.  With
names of files it inserts each table where a file has its two marks, as ``<!-- metrics -->`` and
``<!-- /metrics -->``.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
import sys
from typing import Any

from flexarm_ros.core.parameters.sections import PaceParameters, SECTIONS
from flexarm_ros.core.parameters.spec import short, Spec, specs
from flexarm_ros.core.run.results.columns import ROW_COLUMNS, RowColumn
from flexarm_ros.core.run.results.metric_list import Metric, NUMBERS

_CLASSES = (*SECTIONS.items(), ('/**', PaceParameters))


def markdown() -> str:
    """Return a heading and a table of each section's parameters as Markdown."""
    tables = []
    for section in dict.fromkeys(['/**', *SECTIONS]):
        classes = [cls for name, cls in _CLASSES if name == section]
        rows = [row(key, *entry) for cls in classes for key, entry in specs(cls).items()]
        head = f'## {section}\n\n| key | default | meaning |\n|---|---|---|\n'
        tables.append(head + '\n'.join(rows) + '\n')
    return '\n'.join(tables)


def columns() -> str:
    """Return the table of the columns that ``trajectory.csv`` has in every run as Markdown."""
    return _described(ROW_COLUMNS)


def metrics() -> str:
    """Return the table of the numbers in ``summary.json`` as Markdown."""
    return _described(NUMBERS)


def _described(entries: Iterable[RowColumn | Metric]) -> str:
    rows = [f'| `{entry.name}` | {entry.unit} | {entry.meaning} |' for entry in entries]
    return '\n'.join(('| name | unit | meaning |', '|---|---|---|', *rows, ''))


def row(key: str, _: Any, spec: Spec, default: Any) -> str:
    """Return the row of a parameter: key, default, and its meaning, unit and range."""
    unit = f' ({spec.unit})' if spec.unit else ''
    notes = [
        f'allowed: {allowed_text(spec)}',
        f'paper: {spec.paper}' if spec.paper else '',
        'may change while running' if spec.live else '',
    ]
    meaning = f'{spec.doc}{unit}. *{"; ".join(note for note in notes if note)}*'
    cells = (f'`{key}`', default_text(default), meaning)
    return '| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |'


def default_text(default: Any) -> str:
    """Return a default as written in a scenario; empty if there is none."""
    if default is None:
        return ''
    if isinstance(default, tuple):
        return '[' + ', '.join(repr(value) for value in default) + ']'
    if isinstance(default, bool):
        return str(default).lower()
    return str(default)


def allowed_text(spec: Spec) -> str:
    """Return the values that a parameter accepts: choices, or type and range."""
    if spec.choices:
        return ', '.join(f'`{choice}`' for choice in spec.choices)
    kind = {'float': '', 'int': 'integer', 'bool': 'true, false', 'str': 'text',
            'float2': 'two values', 'floats': 'values'}[spec.kind]  # fmt: skip
    bounds = ''
    if spec.low is not None and spec.high is not None:
        bounds = f'{"above " if spec.low_open else ""}{short(spec.low)} to {short(spec.high)}'
    elif spec.low is not None:
        bounds = f'{"above" if spec.low_open else "at least"} {short(spec.low)}'
    elif spec.high is not None:
        bounds = f'at most {short(spec.high)}'
    return ', '.join(part for part in (kind, bounds) if part)


TABLES = {'parameters': markdown, 'columns': columns, 'metrics': metrics}
"""Name in the marks -> the table."""


def with_tables(text: str) -> str:
    """
    Return a document's text with the current tables between their marks.

    Raises ValueError if it has the marks of none.
    """
    marks = {name: (f'<!-- {name} -->', f'<!-- /{name} -->') for name in TABLES}
    found = [name for name, ends in marks.items() if any(end in text for end in ends)]
    if not found:
        raise ValueError(f'no lines <!-- NAME --> and <!-- /NAME --> of {", ".join(TABLES)}')
    for name in found:
        text = put_between(text, *marks[name], TABLES[name]().rstrip('\n'))
    return text


def put_between(text: str, begin: str, end: str, block: str) -> str:
    """
    Return ``text`` with ``block``, on lines of its own, in the place of the text between marks.

    Raises ValueError if a mark is missing, or the first one occurs twice.
    """
    head, opened, rest = text.partition(begin)
    _, closed, tail = rest.partition(end)
    if not opened or not closed or begin in tail:
        raise ValueError(f'no lines {begin} and {end}, once each')
    return f'{head}{begin}\n{block}\n{end}{tail}'


def main() -> None:
    """Print the tables of parameters, or insert the tables into the given files."""
    if len(sys.argv) < 2:
        print(markdown(), end='')
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(with_tables(path.read_text('utf-8')), encoding='utf-8')


if __name__ == '__main__':
    main()
