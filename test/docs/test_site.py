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

"""The documentation's site: it builds, needs no network, and shows what it should."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import re
import subprocess
import sys

import flexarm_ros
from flexarm_ros.cli import build_parser
import pytest
from report_browser import Browser, find_chromium
from repository import ROOT

pytest.importorskip('sphinx', reason="no Sphinx here; pip install 'flexarm_ros[docs]'")

RESOURCE = re.compile(r'<(?:script|link|img|iframe|source)\b[^>]*?\b(?:src|href)=\"([^\"]+)\"')
STYLED = re.compile(r"@import\s+[\"']([^\"']+)|url\(\s*[\"']?([^\"')]+)")
CHROMIUM = find_chromium()


@pytest.fixture(scope='module')
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp('site')
    built = subprocess.run(
        [sys.executable, '-m', 'sphinx', '-q', '-E', '-W', '--keep-going', '-d', out / 'trees',
         ROOT / 'docs', out / 'html'],
        capture_output=True, text=True, timeout=600,
    )  # fmt: skip
    assert built.returncode == 0, built.stderr
    return out / 'html'


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    if CHROMIUM is None:
        pytest.skip('no Chromium here; as root: apt-get install chromium')
    opened = Browser(CHROMIUM, tmp_path_factory.mktemp('profile'))
    yield opened
    opened.close()


def test_pages_load_nothing_from_elsewhere(site: Path) -> None:
    pages = sorted(site.rglob('*.html'))
    assert len(pages) > 15
    for page in pages:
        for address in RESOURCE.findall(page.read_text('utf-8')):
            assert address.startswith('data:') or '//' not in address, (page, address[:80])
    for style in site.rglob('*.css'):
        for first, second in STYLED.findall(style.read_text('utf-8')):
            address = first or second
            assert address.startswith('data:') or '//' not in address, (style, address)


def test_formulas_are_mathml(site: Path) -> None:
    model = (site / 'model.html').read_text('utf-8')
    assert model.count('<math') > 30
    assert '\\frac' not in re.sub(r'<annotation.*?</annotation>', '', model, flags=re.DOTALL)
    assert 'mathjax.js' not in model.lower()


def test_the_reference_has_every_name_and_every_command(site: Path) -> None:
    names = (site / 'reference' / 'api.html').read_text('utf-8')
    assert 'TypeAliasForwardRef' not in names
    for name in flexarm_ros.__all__:
        assert f'id="flexarm_ros.{name}"' in names, name
    commands = (site / 'reference' / 'commands.html').read_text('utf-8')
    listed = re.findall(r'^ {4}(\w+)', build_parser([]).format_help(), re.MULTILINE)
    assert len(listed) > 8
    for command in listed:
        assert f'usage: flexarm {command}' in commands
    assert 'flexural_rigidity' in (site / 'reference' / 'parameters.html').read_text('utf-8')


@pytest.mark.parametrize(
    'name',
    [
        'index',
        'tutorial',
        'model',
        'protocol',
        'howto/notebook',
        'howto/notebook_tour',
        'reference/api',
    ],
)
def test_a_page_opens_offline_and_on_a_phone(browser: Browser, site: Path, name: str) -> None:
    page = (site / f'{name}.html').resolve().as_uri()
    browser.events.clear()
    for width, mobile in ((1280, False), (390, True)):
        browser.size(width, 900, mobile)
        browser.call('Page.navigate', url=page)
        browser.until("document.readyState === 'complete'")
        assert browser.js('document.documentElement.scrollWidth') <= width
    assert browser.problems() == []
    assert [url for url in browser.requests() if not url.startswith(('file:', 'data:'))] == []
    assert browser.js('[...document.images].every((i) => i.complete && i.naturalWidth > 0)')


@pytest.mark.parametrize(
    ('term', 'pages'),
    [('latency', 3), ('bode', 1), ('jitter', 1), ('friction', 1), ('citation', 1)],
)
def test_searching_works_without_a_server(
    browser: Browser, site: Path, term: str, pages: int
) -> None:
    browser.events.clear()
    address = (site / 'search.html').resolve().as_uri()
    browser.call('Page.navigate', url=f'{address}?q={term}')
    browser.until(f"document.querySelectorAll('#search-results li').length >= {pages}")
    assert browser.problems() == []
