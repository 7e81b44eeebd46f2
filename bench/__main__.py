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
``python -m bench``: measure everything, print the table, write docs/performance.md.

``python -m bench PART...`` measures these parts only and prints them; the document stays as it is,
since its figures are those of one run.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path
import sys
import time

from bench.table import machine, Part, summary
from flexarm_ros.scenario.table import put_between

PARTS = (
    'distributed', 'helics', 'realtime', 'loop', 'parts', 'models', 'sweeps', 'recording',
    'growth',
)  # fmt: skip
PAGE = Path('docs/performance.md')


def main(words: list[str]) -> int:
    """Measure the parts named (all without one)."""
    unknown = [word for word in words if word not in PARTS]
    if unknown:
        print(f'bench: no part {unknown[0]!r}: {", ".join(PARTS)}', file=sys.stderr)
        return 2
    found, begin, where = [], time.monotonic(), machine()
    for name in words or PARTS:
        print(f'bench: {name}, {time.monotonic() - begin:.0f} s so far', file=sys.stderr)
        measure: Callable[[], Part] = import_module(f'bench.{name}').measure
        found.append(measure())
    took = time.monotonic() - begin
    print(f'{where}\n\n{summary(found)}\n')
    for part in found:
        print(*part.text, sep='\n\n', end='\n\n')
    if words:
        return 0
    blocks = {part.name: '\n\n'.join(part.text) for part in found}
    blocks['machine'] = f'{where} All of it in one run of {took / 60:.0f} minutes.'
    blocks['summary'] = summary(found)
    PAGE.write_text(filled(PAGE.read_text(encoding='utf-8'), blocks), encoding='utf-8')
    print(f'bench: {took:.0f} s; wrote {PAGE}', file=sys.stderr)
    return 0


def filled(page: str, blocks: dict[str, str]) -> str:
    """
    Return ``page`` with the text between each pair of markers replaced.

    Raises ValueError where a block has no place in it.
    """
    for name, text in blocks.items():
        page = put_between(
            page, f'<!-- bench:{name} -->', f'<!-- /bench:{name} -->', f'\n{text}\n'
        )
    return page


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
