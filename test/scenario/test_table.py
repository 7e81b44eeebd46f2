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

"""The tables of parameters in the documentation are those that the definitions give."""

from __future__ import annotations

from flexarm_ros import scenario
from flexarm_ros.core.parameters.sections import PaceParameters, SECTIONS, specs
from flexarm_ros.scenario import table
import pytest
from repository import ROOT

PAGE = ROOT / 'docs' / 'reference' / 'parameters.md'


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


def test_the_table_goes_between_its_marks() -> None:
    text = f'a\n{table.BEGIN}\nold\n{table.END}\nb\n'
    assert table.with_table(text) == f'a\n{table.BEGIN}\n{table.markdown()}{table.END}\nb\n'
    assert table.with_table(table.with_table(text)) == table.with_table(text)
    with pytest.raises(ValueError, match='no lines'):
        table.with_table('a\n')


def test_the_page_has_the_tables_of_now() -> None:
    text = PAGE.read_text('utf-8')
    assert table.with_table(text) == text, f'run: python -m flexarm_ros.scenario.table {PAGE}'


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
