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

"""The report as a file: one page, whole, offline, with nothing of a file's text let loose."""

from __future__ import annotations

import base64
from dataclasses import replace
import hashlib
from html.parser import HTMLParser
import json
from pathlib import Path
import re
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.analysis.report.page import render, write_report
from flexarm_ros.analysis.report.runs import load_run
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.cli import main
import pytest
from report_cases import cut_rows, edit_summary, fly

SHORT = ('duration=2.0', 'trajectory.side_time=0.5', 'trajectory.side=1.0')
EVIL = '</script><script>window.hacked=1</script><img src=x onerror=window.hacked=1>'


class Page(HTMLParser):
    """What a page is made of."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.held: dict[str, list[str]] = {'script': [], 'style': []}
        self.within = ''
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))
        if tag in self.held:
            self.within = tag
            self.held[tag].append('')

    def handle_endtag(self, tag: str) -> None:
        if tag == self.within:
            self.within = ''

    def handle_data(self, data: str) -> None:
        if self.within:
            self.held[self.within][-1] += data
        else:
            self.texts.append(data)

    @property
    def text(self) -> str:
        return ' '.join(' '.join(self.texts).split())


@pytest.fixture(scope='module')
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp('runs')
    for case in ('fls_collocated', 'fls_tip', 'pd_tip'):
        fly(root / case, case, *SHORT)
    fly(root / 'unstable', 'fls_tip_physical')
    return root


def page_of(*directories: Path) -> Page:
    return Page(render([load_run(directory) for directory in directories]))


def test_the_page_has_metrics_claims_scenario_and_versions(runs: Path, tmp_path: Path) -> None:
    cases = [fly(tmp_path / case, case) for case in ('fls_collocated', 'fls_tip')]
    text = page_of(*cases).text
    summary = json.loads((tmp_path / 'fls_tip' / 'summary.json').read_text('utf-8'))
    for shown in (
        f"{summary['rms_error']:#.4g}", f"{summary['overshoot'][2]:#.4g}",
        '(c) FLS: the delay raises the overshoot', 'tip_sensor.latency s', '0.001238',
        'control_period s', summary['versions']['numpy'], summary['versions']['commit'],
        'Every recorded tick is in this page.',
    ):  # fmt: skip
        assert shown in text
    changed = page_of(runs / 'fls_collocated', runs / 'fls_tip').text
    assert '(c) FLS' not in changed, 'a shorter path is no case of the paper'


def test_the_page_asks_nothing_of_the_network(runs: Path) -> None:
    text = render([load_run(runs / 'fls_tip')])
    page = Page(text)
    for tag, attributes in page.tags:
        assert tag not in ('iframe', 'object', 'embed', 'base', 'img', 'video', 'audio', 'form')
        for name, value in attributes.items():
            assert not name.startswith('on'), f'{tag} {name}'
            if name in ('src', 'href', 'action', 'srcset', 'poster'):
                assert value is not None and value.startswith(('#', 'data:')), f'{tag} {value}'
    # The only address in the page is a name: that of the SVG language.
    found = set(re.findall(r"\bhttps?://[^\s\"'<>]+", text))
    assert found <= {'http://www.w3.org/2000/svg'}
    assert not re.search(
        r'@import|url\((?!#)|fetch\(|XMLHttpRequest|WebSocket|importScripts', text
    )


def test_the_policy_allows_this_script_and_style_only(runs: Path) -> None:
    page = page_of(runs / 'fls_tip')
    (policy,) = (
        attributes['content'] or ''
        for tag, attributes in page.tags
        if tag == 'meta' and attributes.get('http-equiv') == 'Content-Security-Policy'
    )
    scripts = [a for tag, a in page.tags if tag == 'script']
    assert [a.get('type') for a in scripts] == ['application/json', None]
    for kind, text in (('script', page.held['script'][1]), ('style', page.held['style'][0])):
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert "default-src 'none'" in policy and 'unsafe' not in policy


def test_hostile_texts_stay_texts(runs: Path, tmp_path: Path) -> None:
    directory = fly(tmp_path / 'evil<script>alert(1)<', 'fls_tip', 'duration=0.1')  # fmt: skip

    def spoil(summary: dict[str, Any]) -> None:
        summary['name'] = summary['problem'] = EVIL
        summary['versions'][EVIL] = EVIL
        summary['scenario']['plant']['basis'] = EVIL
        summary['scenario']['plant'][EVIL] = [EVIL]
        summary['scenario'][EVIL] = {EVIL: EVIL}
        summary['scenario']['controller']['law'] = EVIL
        summary['rms_error'] = EVIL
        summary['overshoot'] = [EVIL]

    edit_summary(directory, spoil)
    page = page_of(runs / 'fls_tip', directory)
    kinds = {tag for tag, _ in page_of(runs / 'fls_tip', runs / 'unstable').tags}
    assert {tag for tag, _ in page.tags} <= kinds
    assert [tag for tag, _ in page.tags].count('script') == 2
    assert 'window.hacked=1' in page.text
    json.loads(page.held['script'][0])


@pytest.mark.parametrize('rows', [0, 1, 40])
def test_a_run_that_was_broken_off_has_a_page(runs: Path, tmp_path: Path, rows: int) -> None:
    directory = fly(tmp_path / 'cut', 'fls_tip', 'duration=0.1')
    cut_rows(directory, rows, '0.5')
    edit_summary(
        directory,
        lambda s: s.update(dict.fromkeys(s, None), scenario=s['scenario'], problem='no disk'),
    )
    text = page_of(directory, runs / 'fls_tip').text
    assert 'not finished no disk' in text


def test_an_unstable_run_has_a_page(runs: Path) -> None:
    page = page_of(runs / 'unstable')
    assert 'unstable unstable:' in page.text
    json.loads(page.held['script'][0], parse_constant=pytest.fail)


def test_the_command_writes_page_and_pictures(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'new' / 'report'
    assert main(['report', str(runs / 'pd_tip'), '--out', str(out)]) == 0
    printed = capsys.readouterr().out.split()
    assert printed[0] == str(out / 'report.html')
    assert sorted(printed) == sorted(map(str, out.iterdir()))
    stems = {path.name for path in out.iterdir()}
    assert {'paths.png', 'paths.svg', 'corners.png', 'signals.svg'} <= stems


def test_a_report_lies_beside_its_run_or_here(
    runs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(['report', '--no-pictures', str(runs / 'pd_tip' / 'trajectory.csv')]) == 0
    assert (runs / 'pd_tip' / 'report' / 'report.html').is_file()
    assert main(['report', '--no-pictures', str(runs / 'pd_tip'), str(runs / 'fls_tip')]) == 0
    assert (tmp_path / 'report' / 'report.html').is_file()


def test_reports_and_sweeps_among_runs_are_skipped(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, file in (('page', 'report.html'), ('sweep', 'sweep.json')):
        (tmp_path / name).mkdir()
        (tmp_path / name / file).touch()
    page, sweep = str(tmp_path / 'page'), str(tmp_path / 'sweep')
    words = ['report', '--no-pictures', '--out', str(tmp_path / 'out')]
    assert main([*words, page, str(runs / 'pd_tip'), sweep]) == 0
    assert capsys.readouterr().err.splitlines() == [
        f'flexarm report: {page}: skipped, a report',
        f'flexarm report: {sweep}: skipped, a sweep',
    ]
    assert main([*words, page]) == 2
    assert main([*words, page, sweep]) == 2


def test_unknown_overshoots_are_one_row_of_a_table(tmp_path: Path) -> None:
    """A run that was cut off in the first of seventy sides had a row for each of the rest."""
    run = load_run(fly(tmp_path / 'run', 'pd_tip', *SHORT))

    def rows(*overshoot: float | None) -> list[str]:
        text = render([replace(run, summary={**run.summary, 'overshoot': list(overshoot)})])
        return re.findall(r'"row">(Overshoot(?:, switch[^<]*?)?) <.*?<td>([^<]*)', text)

    assert rows(*[None] * 70) == [('Overshoot', '–')]
    assert rows(0.5, None, 0.25, *[None] * 67) == [
        ('Overshoot, switch 1', '0.5000'), ('Overshoot, switch 2', '–'),
        ('Overshoot, switch 3', '0.2500'), ('Overshoot, switch 4 and later', '–'),
    ]  # fmt: skip
    assert rows(0.5, None) == [('Overshoot, switch 1', '0.5000'), ('Overshoot, switch 2', '–')]


def test_a_bag_s_report_lies_beside_it(tmp_path: Path) -> None:
    simulate(scenario.load('pd_tip', [*SHORT, 'duration=0.2']), tmp_path / 'run', 'pd_tip')
    (tmp_path / 'run' / 'trajectory.csv').unlink()
    (bag,) = (tmp_path / 'run' / 'bag').glob('*.mcap')
    assert main(['report', '--no-pictures', str(bag)]) == 0
    assert 'pd_tip' in (tmp_path / 'run' / 'report' / 'report.html').read_text('utf-8')


def test_what_is_not_a_run_gives_status_2_and_one_line(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / 'out'
    for wrong in (tmp_path, tmp_path / 'nowhere'):
        words = ['report', str(runs / 'pd_tip'), str(wrong), '--out', str(out)]
        assert main(words) == 2
        error = capsys.readouterr().err
        assert str(wrong) in error and error.count('\n') == 1
    assert not out.exists()


def test_a_page_is_replaced_whole(runs: Path, tmp_path: Path) -> None:
    first = write_report([runs / 'pd_tip'], tmp_path).read_bytes()
    again = write_report([runs / 'pd_tip'], tmp_path).read_bytes()
    assert first == again
    assert [path.name for path in tmp_path.iterdir()] == ['report.html']
    assert first.endswith(b'</html>\n')
