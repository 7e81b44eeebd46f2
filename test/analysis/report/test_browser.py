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

"""The report in a browser: no error, no request, and controls that do what they say."""

from __future__ import annotations

from collections.abc import Iterator
import json
import math
from pathlib import Path

from flexarm_ros.analysis.palette import color, HUES
from flexarm_ros.analysis.report.page import write_report
import pytest
from report_browser import Browser, find_chromium
from report_cases import edit_summary, fly

CHROMIUM = find_chromium()
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason='no Chromium here; as root: apt-get install chromium'
)

SHORT = ('duration=2.0', 'trajectory.side_time=0.5', 'trajectory.side=1.0')
EVIL = '</script><script>window.hacked=1</script><img src=x onerror=window.hacked=1>'
CASES = ('fls_collocated', 'fls_tip', 'fls_tip_corrected')
TIME = "parseFloat(document.getElementById('clock').textContent)"
RUN_CURVES = "document.querySelectorAll('#paths path.series:not(.reference)').length"
FIRST = '#series .chart:first-child svg'


@pytest.fixture(scope='module')
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert CHROMIUM is not None
    opened = Browser(CHROMIUM, tmp_path_factory.mktemp('profile'))
    yield opened
    opened.close()


@pytest.fixture(scope='module')
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp('pages')
    runs = {case: fly(root / case, case, *SHORT) for case in CASES}
    runs['unstable'] = fly(root / 'unstable', 'pd_tip_physical')
    evil = fly(root / f'evil{EVIL.replace("/", "")}', 'fls_tip', *SHORT)
    rig = fly(root / 'rig', 'fls_tip', *SHORT, 'strain_gauge.gain=[0.001,1.0]', 'imu.rate=0.0')
    edit_summary(evil, lambda s: s['scenario']['plant'].update({'basis': EVIL, EVIL: EVIL}))
    return {
        'three': write_report([runs[case] for case in CASES], root / 'three'),
        'unstable': write_report([runs['unstable'], runs['fls_tip']], root / 'both'),
        'evil': write_report([evil, runs['fls_tip']], root / 'evil'),
        'parts': write_report([rig, runs['fls_tip']], root / 'parts'),
        'paper': write_report([fly(root / 'paper', 'fls_tip')], root / 'claims'),
    }


@pytest.fixture
def page(browser: Browser, pages: dict[str, Path]) -> Iterator[Browser]:
    """Open the report of three runs, 1280 pixels wide; whatever goes wrong fails the test."""
    browser.events.clear()
    browser.size(1280, 900)
    browser.media(prefers_color_scheme='light')
    browser.load(pages['three'])
    yield browser
    assert browser.problems() == []


def labels(page: Browser, axis: str, chart: str) -> list[float]:
    """Return the numbers at an axis of a chart; ``axis`` is x or y."""
    anchor = {'x': 'middle', 'y': 'end'}[axis]
    texts = page.js(
        f"[...document.querySelectorAll('{chart} text[text-anchor={anchor}]')]"
        '.map((t) => t.textContent)'
    )
    numbers = [text.replace('−', '-') for text in texts if text[-1].isdigit()]
    return [float(text) for text in numbers]


def span(page: Browser, axis: str, chart: str) -> float:
    values = labels(page, axis, chart)
    return max(values) - min(values)


def seek(page: Browser, time: float) -> None:
    page.js(
        f"(() => {{ const s = document.getElementById('scrub'); s.value = {time};"
        "s.dispatchEvent(new Event('input')); })()"
    )


@pytest.mark.parametrize('name', ['three', 'unstable', 'evil'])
def test_a_page_loads_without_error_or_request(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    browser.events.clear()
    browser.load(pages[name])
    browser.until("document.querySelectorAll('#series svg .frame').length >= 6")
    browser.frame()
    assert browser.problems() == []
    asked = [url for url in browser.requests() if not url.startswith('data:')]
    assert asked == [pages[name].resolve().as_uri()]
    assert browser.js('typeof window.hacked') == 'undefined'


def test_hostile_texts_are_shown_as_they_are(browser: Browser, pages: dict[str, Path]) -> None:
    browser.load(pages['evil'])
    assert EVIL in browser.js("document.querySelector('main').textContent")
    assert 'evil<script>' not in browser.js("document.body.innerHTML.replaceAll('&lt;', '[')")
    assert browser.js("document.querySelectorAll('img, main script').length") == 0


def test_the_policy_stops_a_script_that_would_get_in(
    browser: Browser, pages: dict[str, Path]
) -> None:
    browser.load(pages['three'])
    browser.js(
        "(() => { const s = document.createElement('script'); s.textContent = 'window.hacked = 1';"
        "document.body.appendChild(s); const i = document.createElement('img');"
        "i.setAttribute('onerror', 'window.hacked = 1'); i.src = 'http://127.0.0.1:9/x';"
        'document.body.appendChild(i); })()'
    )
    browser.frame()
    assert browser.js('typeof window.hacked') == 'undefined'


def test_play_moves_the_arm_and_pause_stops_it(page: Browser) -> None:
    arm = "document.querySelector('#paths .arm').getAttribute('d')"
    before = page.js(arm)
    page.click('#play')
    assert page.js("document.getElementById('play').textContent") == '⏸ Pause'
    page.until(f'{TIME} > 0.1')
    page.click('#play')
    stopped = page.js(TIME)
    assert page.js(arm) != before
    for _ in range(5):
        page.frame()
    assert page.js(TIME) == stopped
    assert page.js("document.getElementById('play').getAttribute('aria-pressed')") == 'false'


def test_playing_ends_at_the_end_and_starts_over(page: Browser) -> None:
    page.js("(() => { document.getElementById('speed').value = '4'; })()")
    seek(page, 1.9)
    page.click('#play')
    page.until("document.getElementById('play').getAttribute('aria-pressed') === 'false'")
    assert page.js(TIME) == pytest.approx(1.999, abs=1e-3)
    page.click('#play')
    page.until(f'{TIME} < 1.5 && {TIME} > 0')
    page.click('#play')
    page.click('#start')
    assert page.js(TIME) == 0.0


def test_speed_is_simulated_time_over_wall_time(page: Browser) -> None:
    page.js("(() => { document.getElementById('speed').value = '0.25'; })()")
    page.js('(() => { window.began = performance.now(); })()')
    page.click('#play')
    page.until(f'{TIME} > 0.2')
    page.click('#play')
    wall = page.js('(performance.now() - window.began) / 1000')
    assert page.js(TIME) <= 0.25 * wall + 0.01


def test_the_slider_sets_time_cursor_and_values(page: Browser, pages: dict[str, Path]) -> None:
    seek(page, 1.25)
    assert page.js("document.getElementById('now').textContent") == 't = 1.250 s'
    cursor = page.js(
        "[...document.querySelectorAll('#series .chart:not([hidden]) .cursor')]"
        ".map((c) => c.getAttribute('x1'))"
    )
    assert len(cursor) == 7 and len(set(cursor)) == 1
    row = (pages['three'].parent.parent / 'fls_tip' / 'trajectory.csv').read_text('ascii')
    cells = row.splitlines()[1251].split(',')
    shown = page.js(
        "document.querySelectorAll('#values tbody tr')[2].querySelectorAll('td')[1].textContent"
    )
    assert float(shown.replace('−', '-')) == pytest.approx(float(cells[5]), abs=6e-5)


def test_the_arm_ends_where_elbow_and_tip_were_recorded(
    page: Browser, pages: dict[str, Path]
) -> None:
    page.js("document.querySelectorAll('#runs input').forEach((b, i) => { if (i) b.click(); })")
    seek(page, 0.7)
    rows = (pages['three'].parent.parent / CASES[0] / 'trajectory.csv').read_text('ascii')
    cells = [float(cell) for cell in rows.splitlines()[701].split(',')]
    # Base and elbow, which are far apart, give the scale of the picture.
    base = page.js(
        "['cx', 'cy'].map((n) => +document.querySelector('#paths .base').getAttribute(n))"
    )
    d = page.js("document.querySelector('#paths .arm').getAttribute('d')")
    points = [tuple(map(float, part.split())) for part in d[1:].split('L')]
    elbow, tip = points[24], points[48]
    scale = math.dist(elbow, base) / math.hypot(cells[7], cells[8])
    assert points[0] == pytest.approx(base, abs=0.1)
    for point, (x, y) in ((elbow, cells[7:9]), (tip, cells[9:11])):
        assert point == pytest.approx((base[0] + scale * x, base[1] - scale * y), abs=0.6)


def test_zoom_buttons_and_whole(page: Browser) -> None:
    whole = span(page, 'x', '#paths')
    page.click('#path-in')
    page.click('#path-in')
    assert span(page, 'x', '#paths') < 0.6 * whole
    page.click('#path-out')
    page.click('#path-reset')
    assert span(page, 'x', '#paths') == whole


def test_time_buttons_zoom_all_series_together(page: Browser) -> None:
    charts = [f'#series .chart:nth-child({i})' for i in (1, 3, 7)]
    seek(page, 1.0)
    page.click('#time-in')
    page.click('#time-in')
    near = [labels(page, 'x', chart) for chart in charts]
    assert near[0] == near[1] == near[2]
    assert near[0][0] > 0.4 and near[0][-1] < 1.6
    page.click('#time-right')
    assert labels(page, 'x', charts[1])[-1] > near[0][-1]
    page.click('#time-left')
    assert labels(page, 'x', charts[1]) == near[0]
    page.click('#time-out')
    page.click('#time-reset')
    assert labels(page, 'x', charts[2])[0] == 0.0


def test_switch_buttons_go_to_the_corner(page: Browser) -> None:
    whole = span(page, 'x', '#paths')
    page.click('#corners button:nth-child(2)')
    assert page.js(TIME) == pytest.approx(1.0)
    assert span(page, 'x', '#paths') < 0.5 * whole
    x, y = labels(page, 'x', '#paths'), labels(page, 'y', '#paths')
    assert min(x) < 0.5 < max(x) + 0.2 and min(y) - 0.2 < 0.5 < max(y) + 0.2
    assert labels(page, 'x', '#series .chart:nth-child(2)')[0] >= 0.5


def test_a_run_can_be_hidden(page: Browser) -> None:
    assert page.js(RUN_CURVES) == 3
    page.click('#runs label:nth-child(2) input')
    assert page.js(RUN_CURVES) == 2
    assert page.js("document.querySelectorAll('#paths .arm').length") == 2
    page.click('#runs label:nth-child(2) input')
    assert page.js(RUN_CURVES) == 3


def test_tip_and_arm_can_be_shown_and_hidden(page: Browser) -> None:
    page.click('#show-tip')
    assert page.js("document.querySelectorAll('#paths path.thin').length") == 3
    page.click('#show-arm')
    assert page.js("document.querySelectorAll('#paths .arm').length") == 0


def test_dragging_zooms_and_a_double_click_resets(page: Browser) -> None:
    before = labels(page, 'x', '#series .chart:nth-child(1)')
    page.drag(FIRST, (0.4, 0.4), (0.6, 0.6))
    after = labels(page, 'x', '#series .chart:nth-child(4)')
    assert after[-1] - after[0] < 0.5 * (before[-1] - before[0])
    page.click(FIRST, count=2)
    assert labels(page, 'x', '#series .chart:nth-child(4)') == before
    whole = span(page, 'x', '#paths')
    page.drag('#paths svg', (0.3, 0.3), (0.5, 0.5))
    assert span(page, 'x', '#paths') < 0.5 * whole


def test_a_click_sets_the_time(page: Browser) -> None:
    page.click(FIRST, 0.5, 0.4)
    assert page.js(TIME) == pytest.approx(1.0, abs=0.05)


def test_hovering_shows_each_run_s_value(page: Browser) -> None:
    page.hover(FIRST, 0.5, 0.4)
    box = '#series .chart:first-child .tip-box'
    page.until(f"!document.querySelector('{box}').hidden")
    text = page.js(f"document.querySelector('{box}').innerText")
    assert text.startswith('t = ') and text.count('FLS') == 3
    page.hover('h1', 0.5, 0.5)
    page.until(f"document.querySelector('{box}').hidden")


def test_keys_step_zoom_and_play(page: Browser) -> None:
    page.js("document.querySelector('#series .chart').focus({preventScroll: true})")
    page.key('ArrowRight', modifiers=8)
    moved = page.js(TIME)
    assert moved == pytest.approx(0.1, abs=1e-3)
    page.key('ArrowLeft')
    assert page.js(TIME) == pytest.approx(moved - 0.01, abs=1e-3)
    seek(page, 1.0)
    before = labels(page, 'x', '#series .chart:nth-child(1)')
    page.key('+', '+')
    assert span(page, 'x', '#series .chart:nth-child(1)') < before[-1] - before[0]
    page.key('0', '0')
    assert labels(page, 'x', '#series .chart:nth-child(1)') == before
    page.key(' ', ' ')
    page.until(f'{TIME} > 1.05')
    page.key(' ', ' ')
    assert page.js("document.getElementById('play').getAttribute('aria-pressed')") == 'false'


def test_every_control_can_be_reached_and_has_a_name(page: Browser) -> None:
    controls = page.js(
        "[...document.querySelectorAll('button, input, select, [tabindex]')].map((e) => ["
        "e.tabIndex, (e.getAttribute('aria-label') || e.textContent || '').trim()"
        " || (e.labels && e.labels[0] ? e.labels[0].textContent.trim() : ''), e.outerHTML])"
    )
    assert len(controls) > 25
    for index, name, source in controls:
        assert index == 0 and name, source


def test_series_can_be_chosen(page: Browser) -> None:
    titles = (
        "[...document.querySelectorAll('#series .chart:not([hidden]) .title')]"
        '.map((t) => t.textContent)'
    )
    assert 'Gain λ' in page.js(titles)
    choose = "(() => {{ const s = document.getElementById('which'); s.value = '{}';"
    choose += "s.dispatchEvent(new Event('change')); }})()"
    page.js(choose.format('angles'))
    page.until("document.querySelectorAll('#series .chart:not([hidden]) .frame').length === 4")
    assert page.js(titles)[0] == 'Joint angle θ₁, rad'
    page.js(choose.format('all'))
    page.until("document.querySelectorAll('#series .chart:not([hidden]) .frame').length === 11")


def test_optional_parts_have_series_with_units(page: Browser, pages: dict[str, Path]) -> None:
    """Only runs with such a section have a curve; where there is none, no choice either."""
    assert page.js("document.getElementById('which-parts').hidden")
    page.load(pages['parts'])
    assert not page.js("document.getElementById('which-parts').hidden")
    page.js(
        "(() => { const s = document.getElementById('which'); s.value = 'parts';"
        "s.dispatchEvent(new Event('change')); })()"
    )
    drawn = '#series .chart:not([hidden])'
    page.until(f"document.querySelectorAll('{drawn} .frame').length === 5")
    titles = f"[...document.querySelectorAll('{drawn} .title')].map((t) => t.textContent)"
    assert page.js(titles) == [
        'strain1, m/m', 'strain2, 1/m', 'imu_gyro_z, rad/s', 'imu_accel_x, m/s^2',
        'imu_accel_y, m/s^2',
    ]  # fmt: skip
    assert page.js(f"document.querySelectorAll('{drawn} path.series').length") == 5


def test_the_surface_turns_and_shows_its_middle(page: Browser) -> None:
    faces = "document.querySelector('#surface .face').getAttribute('d')"
    shown = "[...document.querySelectorAll('#surface text')].map((t) => t.textContent).join()"
    first = page.js(faces)
    page.click('#surface-left')
    second = page.js(faces)
    page.drag('#surface svg', (0.5, 0.5), (0.7, 0.5))
    third = page.js(faces)
    page.js("document.querySelector('.surface').focus()")
    page.key('ArrowUp')
    assert len({first, second, third, page.js(faces)}) == 4
    assert 'λ from 0.167' in page.js(shown) and '±5 m' in page.js(shown)
    page.js(
        "(() => { const s = document.getElementById('surface-range'); s.value = '1';"
        "s.dispatchEvent(new Event('change')); })()"
    )
    assert '±1 m' in page.js(shown)


def test_theme_follows_the_reader_and_the_button(page: Browser) -> None:
    color = 'getComputedStyle(document.body).backgroundColor'
    light = page.js(color)
    page.media(prefers_color_scheme='dark')
    dark = page.js(color)
    assert light == 'rgb(255, 255, 255)' and dark != light
    page.click('#theme')
    assert (page.js(color), page.js("document.getElementById('theme').textContent")) == (
        light, 'Theme: light'
    )  # fmt: skip
    page.click('#theme')
    page.media(prefers_color_scheme='light')
    assert page.js(color) == dark


def test_the_contents_lead_to_the_sections(page: Browser) -> None:
    listed = page.js("[...document.querySelectorAll('.contents a')].map((a) => a.hash.slice(1))")
    there = page.js("[...document.querySelectorAll('section > h2')].map((h) => h.id)")
    assert listed == there and 'h-motion' in listed


def test_a_claim_shows_its_comparisons_by_a_click(page: Browser, pages: dict[str, Path]) -> None:
    page.load(pages['paper'])
    shown = "document.querySelector('.claim ul').checkVisibility()"
    assert not page.js(shown)
    page.click('.claim summary')
    assert page.js(shown)
    page.click('.claim summary')
    page.js("window.dispatchEvent(new Event('beforeprint'))")
    assert page.js(shown)  # on paper too
    page.js("window.dispatchEvent(new Event('afterprint'))")
    assert not page.js(shown)


def test_a_table_that_is_cut_off_says_so(page: Browser) -> None:
    cues = "[...document.querySelectorAll('.cue')].map((c) => !c.hidden)"
    assert not any(page.js(cues))
    page.size(360, 740, mobile=True)
    page.until(f'{cues}[0]')
    page.js("document.querySelector('.scroll').scrollLeft = 9999")
    page.until(f'!{cues}[0]')


def test_runs_of_a_law_have_its_hue(page: Browser) -> None:
    strokes = page.js(
        "[...document.querySelectorAll('#runs line')].map((l) => getComputedStyle(l).stroke)"
    )
    wanted = [color('fls', shade) for shade in ('soft', 'base', 'strong')]
    assert strokes == [f'rgb({", ".join(map(str, bytes.fromhex(w[1:])))})' for w in wanted]


@pytest.mark.parametrize('name', ['three', 'unstable', 'evil'])
def test_a_phone_s_width_holds_the_page(
    browser: Browser, pages: dict[str, Path], name: str
) -> None:
    browser.size(360, 740, mobile=True)
    browser.load(pages[name])
    browser.until("document.querySelectorAll('#series svg .frame').length >= 6")
    assert browser.js('document.documentElement.scrollWidth') <= 360
    small = browser.js(
        "[...document.querySelectorAll('button')].filter((b) => b.offsetHeight && b.offsetHeight"
        ' < 30).length'
    )
    assert small == 0
    widths = browser.js(
        "[...document.querySelectorAll('svg[role=img]')].map((s) =>"
        ' s.getBoundingClientRect().right)'
    )
    assert max(widths) <= 360


def test_a_page_prints(page: Browser) -> None:
    assert page.js("document.querySelector('.transport').offsetHeight") > 0
    printed = page.pdf()
    assert printed.startswith(b'%PDF') and len(printed) > 50_000
    page.call('Emulation.setEmulatedMedia', media='print')
    hidden = page.js(
        "['.transport', '#theme', '.bar'].map((s) => getComputedStyle("
        'document.querySelector(s)).display)'
    )
    assert hidden == ['none'] * 3
    page.call('Emulation.setEmulatedMedia', media='')
    page.until(f'{RUN_CURVES} === 3')


def test_contrast_of_texts_and_curves(page: Browser) -> None:
    """WCAG 2.1: 4.5 to 1 for text, 3 to 1 for what a picture is made of."""
    texts = ['fg', 'soft', 'good', 'bad', 'part', 'accent']
    curves = [hue + shade for hue in HUES for shade in ('', '-soft', '-strong')]
    names = texts + curves
    for theme in ('light', 'dark'):
        page.media(prefers_color_scheme=theme)
        values = page.js(
            f'{json.dumps(["bg", "panel", *names])}.map((n) =>'
            "getComputedStyle(document.documentElement).getPropertyValue('--' + n).trim())"
        )
        colors = dict(zip(['bg', 'panel', *names], values, strict=True))
        for ground in ('bg', 'panel'):
            for name in names:
                least = 3.0 if name in curves else 4.5
                assert contrast(colors[name], colors[ground]) >= least, (theme, name, ground)


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colours ``#rrggbb``."""
    lights = []
    for text in (first, second):
        parts = [part / 255.0 for part in bytes.fromhex(text[1:])]
        linear = [p / 12.92 if p <= 0.03928 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
        lights.append(0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2])
    return (max(lights) + 0.05) / (min(lights) + 0.05)
