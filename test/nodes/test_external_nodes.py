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

"""Runs with external nodes: named everywhere, and not taken for ours or for the paper's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import json
from pathlib import Path
from typing import Any

from bagtools import small_config, write_small
from flexarm_ros import scenario
from flexarm_ros.analysis.figures.runs import write_figures
from flexarm_ros.analysis.figures.style import panel_title, panels
from flexarm_ros.analysis.report.claims import evaluate
from flexarm_ros.analysis.report.page import render
from flexarm_ros.analysis.report.runs import labels, load_run
from flexarm_ros.bag.checks.compare import compare
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.recording import finish_run, prepare_directory
from flexarm_ros.cli.options.output import show_outcome
from flexarm_ros.cli.running.suite_table import print_result
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import roles
from flexarm_ros.launcher.junit import write_junit
from flexarm_ros.launcher.suite import CaseResult, judge
from flexarm_ros.nodes.runtime.joining.config_exchange import dump_sections, published_config
from flexarm_ros.scenario.suites import suite
import numpy as np
import pytest
from report_cases import leave_pictures_empty

CONFIG = small_config()


def flown(
    directory: Path, external: Sequence[str], config: RunConfig = CONFIG
) -> tuple[Path, dict[str, Any]]:
    """Return the directory of a run that says that some of its nodes were external."""
    write_small(directory / 'bag', config, Provenance.here('fls_tip', external))
    return directory, finish_run(directory, config, 'fls_tip')


def test_a_run_of_our_own_nodes_says_so(tmp_path: Path) -> None:
    directory, summary = flown(tmp_path / 'run', [])
    assert summary['external'] == []
    assert summary['scenario']['controller']['kp'] == 150.79
    assert np.isfinite(load_run(directory).columns['lambda']).all()


def test_an_external_controller_has_no_law_and_no_gains(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    directory, summary = flown(tmp_path / 'run', ['controller'])
    assert json.loads((directory / 'summary.json').read_text()) == json.loads(json.dumps(summary))
    assert summary['external'] == ['controller']
    assert 'controller' not in summary['scenario']
    run = load_run(directory)
    assert np.isnan(run.columns['lambda']).all()
    assert np.isfinite(run.columns['tau1']).all()
    assert (labels([run]), run.role) == (['External controller'], '')
    assert panel_title(panels([run])[0]) == 'External controller'
    page = render([run])
    assert 'External nodes' in page and 'External controller' in page
    assert not [word for word in ('150.79', 'controller.', 'h-claims') if word in page]
    show_outcome(directory, summary)
    assert capsys.readouterr().out.splitlines()[1].split() == ['external', 'controller']


def test_pictures_of_an_external_controller_are_not_the_paper_s(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    leave_pictures_empty(monkeypatch)
    ours, _ = flown(tmp_path / 'ours', [])
    theirs, _ = flown(tmp_path / 'theirs', ['controller'])
    names = {path.stem for path in write_figures([theirs], tmp_path / 'one')}
    assert names == {'paths', 'signals'}
    names = {path.stem for path in write_figures([ours, theirs], tmp_path / 'both')}
    assert {'signals_external', 'signals_fls_9m', 'fls'} <= names


@pytest.mark.parametrize('law', ['fls', 'lqg'])
def test_keys_that_only_an_external_node_would_read_are_not_shown(law: str) -> None:
    config = scenario.load('fls_tip', [f'controller.law={law}'])
    whole = scenario.to_dict(config)
    shown = scenario.to_dict(config, ['encoder', 'tip_sensor', 'trajectory'])
    assert 'encoder' not in shown
    read = {'location', 'more_locations', 'rate'} | ({'latency'} if law == 'lqg' else set())
    assert set(shown['tip_sensor']) == read
    assert set(whole['trajectory']) - set(shown['trajectory']) == {'delay'}
    assert shown['controller'] == whole['controller']
    assert scenario.to_dict(config, ['tip_sensor', 'tip_sensor', 'no such']).keys() == whole.keys()


def test_other_external_nodes_are_named_beside_our_law(tmp_path: Path) -> None:
    directory, _ = flown(tmp_path / 'run', ['encoder', 'tip_sensor'])
    run = load_run(directory)
    label = 'FLS, noncollocated (NMP), sensor at 9 m, external encoder and tip sensor'
    assert labels([run]) == [label]
    assert labels([run], short=True) == ['noncollocated (NMP), external encoder and tip sensor']


def test_an_external_trajectory_is_the_reference(tmp_path: Path) -> None:
    """Errors were those from the scenario's own path, which was not flown."""
    late = small_config('trajectory.delay=0.1')  # what it publishes is another path
    ours, scored = flown(tmp_path / 'ours', [], late)
    theirs, summary = flown(tmp_path / 'theirs', ['trajectory'], late)
    run = load_run(theirs)
    own, other = load_run(ours).columns['ref_y'], run.columns['ref_y']
    assert np.array_equal(other[100:], own[:-100])
    assert summary['max_error'] == pytest.approx(run.error().max())
    assert summary['max_error'] != scored['max_error']
    assert (summary['overshoot'], summary['max_overshoot']) == ([], None)


def test_a_comparison_names_external_nodes_and_no_gain_of_theirs(tmp_path: Path) -> None:
    ours, _ = flown(tmp_path / 'ours', [])
    theirs, _ = flown(tmp_path / 'theirs', ['controller'], small_config('controller.kp=1.0'))
    result = compare(ours, theirs)
    assert result.notes == ['external nodes in B: controller']
    assert result.parameters == []


def test_a_run_without_a_bag_names_the_nodes_that_it_was_to_have(tmp_path: Path) -> None:
    prepare_directory(tmp_path / 'run', CONFIG, 'fls_tip', ['controller'])
    told = json.loads((tmp_path / 'run' / 'summary.json').read_text())
    assert told['external'] == ['controller']
    summary = finish_run(tmp_path / 'run', CONFIG, 'fls_tip', external=['controller'])
    assert (summary['external'], summary['ticks']) == (['controller'], 0)


def test_the_paper_s_claims_are_about_our_own_nodes(tmp_path: Path) -> None:
    run = load_run(flown(tmp_path / 'run', ['encoder'])[0])
    claims = evaluate([run])
    assert claims.tested == ()
    assert claims.remarks == ('Left out: run was recorded with external nodes: encoder.',)


def test_a_suite_names_external_nodes_and_judges_no_claim_of_the_paper_by_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paper = suite.load('paper')
    metrics = {'stable': True, 'ticks': 16000, 'overshoot': [0.1] * 3, 'rms_error': 0.1,
               'max_overshoot': 0.1, 'max_error': 0.1, 'external': ['controller']}  # fmt: skip
    cases = [CaseResult(case, tmp_path, metrics) for case in paper.cases]
    result = judge(paper, cases)
    verdicts = {(verdict, failed) for _, verdict, failed, _ in result.claims}
    assert verdicts == {('not judged, external nodes: controller', False)}
    print_result(result)
    assert 'pass, external: controller' in capsys.readouterr().out
    write_junit(result, tmp_path / 'junit.xml')
    assert 'external: controller' in (tmp_path / 'junit.xml').read_text()
    mine = judge(replace(paper, paper=False), cases)
    assert not any('not judged' in verdict for _, verdict, _, _ in mine.claims)


def test_a_viewer_shows_no_gain_of_ours_beside_an_external_controller() -> None:
    from flexarm_ros.core.control import gain_of

    own = scenario.load('fls_tip')
    told = {role: (role, dump_sections(own, role)) for role in ('plant', 'controller')}
    assert gain_of(published_config(RunConfig(), told), 0.1, 0.1) > 1.0 / 6.0
    del told['controller']
    assert np.isnan(gain_of(published_config(own, told), 0.1, 0.1))


def test_a_viewer_knows_the_optional_parts_once_all_are_heard() -> None:
    gauges = ['controller.deflection_source=strain_gauge', 'strain_gauge.noise_std=0.01']
    own = scenario.load('fls_tip', [*gauges, 'imu.location=5.0'])
    told = {role: (role, dump_sections(own, role)) for role in roles(own)}
    assert published_config(RunConfig(), told) == own
    del told['imu']
    seen = published_config(RunConfig(), told)
    assert (seen.further, seen.controller.deflection_source) == ((), 'plant')
    assert seen.plant == own.plant
