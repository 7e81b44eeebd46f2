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

"""The pages with the results against their tables, and the tables against the code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
import re

from flexarm_ros.scenario.suites import suite
import pytest
from validation import fls_pages, paper_tables, stability_check, stability_pages, tables
from validation.paper_variants import at_the_tip, judge, Variant, VARIANTS


def test_the_pages_show_what_the_tables_hold(tmp_path: Path) -> None:
    rows = paper_tables.read_csv(paper_tables.TABLE)
    writers: dict[Path, Callable[[Path], object]] = {
        stability_pages.PAGE: stability_pages.write,
        fls_pages.PAGE: fls_pages.write,
        paper_tables.PAGE: lambda page: paper_tables.write_page(rows, page),
    }
    for page, write in writers.items():
        text = page.read_text('utf-8')
        copy = tmp_path / page.name
        # Emptied first: a table that nobody writes any more would be seen.
        copy.write_text(re.sub(r'(<!-- table \w+ -->\n).*?(?=<!-- end)', r'\1', text, flags=re.S))
        write(copy)
        assert copy.read_text('utf-8') == text


def test_a_page_without_the_marks_is_refused(tmp_path: Path) -> None:
    page = tmp_path / 'page.md'
    page.write_text('<!-- table one -->\n', 'utf-8')
    with pytest.raises(SystemExit, match='no marks of table one'):
        tables.put(page, {'one': ['x']})
    assert page.read_text('utf-8') == '<!-- table one -->\n'


@pytest.mark.parametrize(
    ('name', 'wanted'),
    [
        ('map', {'scenario': 'pd_tip', 'tip_sensor.location': '9.0',
                 'tip_sensor.latency': '0.0312', 'tip_sensor.measurand': 'rigid',
                 'controller.velocity_source': 'feedback'}),
        ('hub', {'scenario': 'fls_tip', 'plant.hub_inertia': '6.0',
                 'tip_sensor.latency': '0.001238', 'controller.velocity_source': 'feedback'}),
        ('hub_elastic', {'scenario': 'fls_tip', 'plant.hub_inertia': '20.0',
                         'tip_sensor.latency': '0.0'}),
        ('growth', {'law': 'fls', 'location_m': '9'}),
    ],
)  # fmt: skip
def test_a_row_is_what_the_code_makes_today(name: str, wanted: dict[str, str]) -> None:
    rows = list(enumerate(stability_check.read(name)))
    number, row = next(x for x in rows if wanted.items() <= x[1].items())
    assert stability_check.differences((name, number, row)) == []
    changed = {**row, list(row)[-1]: '1.5'}
    assert len(stability_check.differences((name, number, changed))) == 1


def runs(**changes: float | bool | None) -> dict[str, dict[str, object]]:
    """Return the ten cases, all alike but for what is said of ``fls_tip``."""
    cases = [case.name for case in suite.load('paper').cases]
    made: dict[str, dict[str, object]] = {
        case: {'stable': True, 'unstable_tick': None, 'rms_error': 0.2, 'max_error': 0.9,
               'overshoot': [0.8, 0.6, 0.7]}
        for case in cases
    }  # fmt: skip
    made['fls_tip'].update(changes)
    return made


def test_a_claim_about_a_run_that_diverged_is_not_known() -> None:
    variant = Variant('x', '', '')
    stable = judge(variant, runs()).verdicts
    assert stable['f'] == ('holds', 10, 10)
    assert stable['c'] == ('does not hold', 0, 3)
    # What a run had measured before it diverged is no evidence.
    diverged = judge(variant, runs(stable=False, unstable_tick=3)).verdicts
    assert diverged['f'] == ('in part', 9, 10)
    assert diverged['c'][0] == diverged['e'][0] == 'not known'
    assert diverged['b'] == stable['b']


def test_true_tip_asks_for_the_tip_s_own_metrics() -> None:
    claim = at_the_tip(suite.load('paper').claims[0])
    assert claim.checks[0].text == 'pd_collocated.tip_overshoot[0] > 0.3'
    assert claim.checks[-1].text == 'fls_mid.tip_overshoot[2] < 0.75 * pd_mid.tip_overshoot[2]'


def test_corrected_cases_get_the_delay_as_the_trajectory_s_too() -> None:
    physical = next(v for v in VARIANTS if v.name == 'physical')
    assert physical.overrides('pd_collocated') == ()
    assert physical.overrides('pd_mid') == ('tip_sensor.latency=0.0234',)
    assert physical.overrides('fls_tip_corrected') == (
        'tip_sensor.latency=0.0312', 'trajectory.delay=0.0312'
    )  # fmt: skip
