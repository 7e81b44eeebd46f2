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
The README's table of parameters, generated from their definitions.

``python -m flexarm_ros.scenario.table`` prints it; ``python -m flexarm_ros.scenario.table
README.md`` inserts it between the lines ``<!-- parameters -->`` and ``<!-- /parameters -->``.
"""

from __future__ import annotations

from pathlib import Path
import sys
from typing import Any

from flexarm_ros.core.parameters.sections import PaceParameters, SECTIONS
from flexarm_ros.core.parameters.spec import short, Spec, specs

BEGIN, END = '<!-- parameters -->', '<!-- /parameters -->'


def markdown() -> str:
    """Return the table of every parameter as Markdown."""
    lines = [
        '| parameter | meaning | unit | default | allowed | paper |',
        '|---|---|---|---|---|---|',
    ]
    for section, cls in (*SECTIONS.items(), ('/**', PaceParameters)):
        for key, (_, spec, default) in specs(cls).items():
            live = ' (may change while running)' if spec.live else ''
            cells = (
                f'`{section}.{key}`', spec.doc + live, spec.unit, default_text(default),
                allowed_text(spec), spec.paper,
            )  # fmt: skip
            lines.append('| ' + ' | '.join(cell.replace('|', '\\|') for cell in cells) + ' |')
    return '\n'.join(lines) + '\n'


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


def with_table(text: str) -> str:
    """
    Return a document's text with the current table between its two marks.

    Raises ValueError if the marks are missing.
    """
    return put_between(text, BEGIN, END, markdown().rstrip('\n'))


def put_between(text: str, begin: str, end: str, block: str) -> str:
    """
    Return ``text`` with ``block``, on lines of its own, in the place of what two marks enclose.

    Raises ValueError if a mark is missing, or the first one stands there twice.
    """
    head, opened, rest = text.partition(begin)
    _, closed, tail = rest.partition(end)
    if not opened or not closed or begin in tail:
        raise ValueError(f'no lines {begin} and {end}, once each')
    return f'{head}{begin}\n{block}\n{end}{tail}'


def main() -> None:
    """Print the table, or insert it into the given files."""
    if len(sys.argv) < 2:
        print(markdown(), end='')
    for name in sys.argv[1:]:
        path = Path(name)
        path.write_text(with_table(path.read_text('utf-8')), encoding='utf-8')


if __name__ == '__main__':
    main()
