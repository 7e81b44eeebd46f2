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

"""The tables in the reference are those that the declarations give."""

from __future__ import annotations

from pathlib import Path
import re

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import PaceParameters, SECTIONS, specs
from flexarm_ros.core.run.parts import columns, PARTS
from flexarm_ros.core.run.results.columns import ROW_COLUMNS
from flexarm_ros.core.run.results.metric_list import NUMBERS
from flexarm_ros.scenario import table
import pytest
from repository import ROOT

PAGES = [ROOT / 'docs' / 'reference' / name for name in ('parameters.md', 'outputs.md')]


def test_every_parameter_has_a_row_of_three_cells() -> None:
    lines = table.markdown().splitlines()
    rows = [line for line in lines if line.startswith('| `')]
    sections = [('/**', SECTIONS['/**']), ('/**', PaceParameters), *SECTIONS.items()]
    names = list(dict.fromkeys((section, key) for section, cls in sections for key in specs(cls)))
    assert [row.split(' | ')[0].removeprefix('| ').strip('`') for row in rows] == [
        key for _, key in names
    ]
    assert all(row.replace('\\|', '').count('|') == 4 for row in rows)
    assert [line for line in lines if line.startswith('## ')] == [f'## {s}' for s in SECTIONS]


def test_a_column_and_a_metric_have_a_row_of_three_cells() -> None:
    for text, entries in ((table.columns(), ROW_COLUMNS), (table.metrics(), NUMBERS)):
        rows = text.splitlines()[2:]
        assert [row.split('`')[1] for row in rows] == [entry.name for entry in entries]
        assert all(row.count('|') == 4 for row in rows)
        assert all(entry.meaning for entry in entries)


@pytest.mark.parametrize('name', table.TABLES)
def test_a_table_goes_between_its_marks(name: str) -> None:
    begin, end = f'<!-- {name} -->', f'<!-- /{name} -->'
    text = f'a\n{begin}\nold\n{end}\nb\n'
    filled = table.with_tables(text)
    assert filled == f'a\n{begin}\n{table.TABLES[name]()}{end}\nb\n'
    assert table.with_tables(filled) == filled
    for wrong in ('a\n', f'a\n{begin}\n', f'a\n{end}\n'):
        with pytest.raises(ValueError, match='no lines'):
            table.with_tables(wrong)


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.stem)
def test_a_page_has_the_tables_of_now(page: Path) -> None:
    text = page.read_text('utf-8')
    assert table.with_tables(text) == text, f'run: python -m flexarm_ros.scenario.table {page}'


def test_the_columns_of_optional_parts_are_on_the_page_of_rigs() -> None:
    page = (ROOT / 'docs' / 'howto' / 'your_own_rig.md').read_text('utf-8')
    rows = [line.strip('|').split('|') for line in page.splitlines() if line.startswith('| `')]
    found = {
        (topic.strip().strip('`'), name)
        for topic, _, names in (row for row in rows if len(row) == 3)
        for name in re.findall('`([^`]+)`', names)
    }
    config = scenario.from_dict({
        **{part.NAME: {} for part in PARTS if part.Parameters is not None},
        'disturbance': {'payload_live': True},
    })  # fmt: skip
    assert found == {(column.topic, column.name) for column in columns(config)}


def test_what_is_left_out_is_resolved_as_it_is_taken() -> None:
    from flexarm_ros.core.run.loop import ClosedLoop

    for name, modes in (('fls_tip', 3), ('fls_full', 6), ('fls_full', 5), ('fls_full', 3)):
        config = scenario.load(name, [f'plant.modes={modes}'])
        loop = ClosedLoop(config)
        assert scenario.resolved(config)['plant']['substeps'] == loop.plant.substeps > 1
    config = scenario.load('fls_tip', ['plant.modes=3'])
    found = scenario.resolved(config)
    loop = ClosedLoop(config)
    assert found['plant']['substeps'] == loop.plant.substeps
    assert found['plant']['initial_position'] == loop.plant.q[:2].tolist()
    assert found['plant']['initial_velocity'] == [0.0, 0.0]
    assert found['plant']['deflection_limit'] == [5.0, 5.0]
    assert scenario.from_dict(found).plant.substeps == loop.plant.substeps
    hold = scenario.resolved(scenario.load('fls_tip', ['trajectory.kind=hold']))
    assert hold['trajectory']['hold_position'] == [-6.3, -6.3]
