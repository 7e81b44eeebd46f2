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

"""Tables in Markdown pages, from tables in docs/data."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
import csv
from itertools import groupby
from pathlib import Path

from flexarm_ros.scenario.table import put_between

DOCS = Path(__file__).resolve().parent.parent / 'docs'
DATA = DOCS / 'data'
NAMES = {'pd': 'PD', 'fls': 'FLS'}

Table = list[dict[str, str]]
Lines = list[str]


def read(name: str, **equal: str) -> Table:
    """Return the rows of a table whose columns have the given texts."""
    with (DATA / f'stability_{name}.csv').open(newline='', encoding='utf-8') as file:
        return [row for row in csv.DictReader(file) if all(row[k] == v for k, v in equal.items())]


def put(page: Path, tables: dict[str, Lines]) -> None:
    """Put tables into a page, each between ``<!-- table NAME -->`` and ``<!-- end NAME -->``."""
    text = page.read_text('utf-8')
    for name, lines in tables.items():
        marks = f'<!-- table {name} -->', f'<!-- end {name} -->'
        try:
            text = put_between(text, *marks, '\n'.join(lines))
        except ValueError as error:
            raise SystemExit(f'{page}: no marks of table {name}: {error}') from None
    page.write_text(text, 'utf-8')


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Lines:
    """Return a table in Markdown."""
    lines = ['| ' + ' | '.join(head) + ' |', '|' + '---|' * len(head)]
    return [*lines, *('| ' + ' | '.join(row) + ' |' for row in rows)]


def number(value: str | float | None, digits: int = 3) -> str:
    """Return a number with some digits, ``-`` for what is not known."""
    return f'{float(value):.{digits}g}' if value not in (None, '') else '-'


def delay(value: str) -> str:
    """Return a boundary in ms; empty: beyond what was searched."""
    return f'{float(value):.3g}' if value else '> 60'


def fixed(value: str, digits: int = 2) -> str:
    """Return a length with fixed digits, ``-`` for an unstable run."""
    return f'{float(value):.{digits}f}' if value else '-'


def law(row: dict[str, str]) -> str:
    """Return the law's short name."""
    return NAMES[(row.get('law') or row['scenario'].removesuffix('_tip'))]


def grouped(rows: Table, *names: str) -> Iterator[tuple[tuple[str, ...], Table]]:
    """Return neighbouring rows that agree in some columns."""
    for key, group in groupby(rows, lambda row: tuple(row[name] for name in names)):
        yield key, list(group)
