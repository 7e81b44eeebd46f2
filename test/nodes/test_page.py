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

"""The live page: what the server allows, and what a browser shows and sends."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import http.client
import json
from pathlib import Path
import subprocess
import sys
from typing import Any

from flexarm_ros import scenario
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.simulation import simulate
from flexarm_ros.nodes.view.commands import found
from flexarm_ros.nodes.view.page import is_loopback, PageError, PageServer
from flexarm_ros.nodes.view.page_data import described, FRAMES, recording
from nodetools import wait_for
import pytest
from report_browser import Browser, find_chromium
from repository import ROOT

SIZES = [(1440, False), (390, True)]


def open_browser(profile: Path) -> Browser:
    program = find_chromium()
    if program is None:
        pytest.skip('no Chromium here')
    return Browser(program, profile)


@pytest.fixture  # no browser of another test may be among what a test of nodes has left running
def browser(tmp_path: Path) -> Iterator[Browser]:
    browser = open_browser(tmp_path / 'profile')
    yield browser
    browser.close()


@pytest.fixture(scope='module')
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    run = tmp_path_factory.mktemp('runs') / 'run'
    overrides = ['duration=2.0', 'tip_sensor.latency=0.002', 'controller.ks=10.0']
    simulate(scenario.load('fls_tip', overrides), run, 'fls_tip')
    return run


@pytest.fixture
def sent() -> list[Mapping[str, Any]]:
    """Return the commands that a page has sent."""
    return []


@pytest.fixture
def server(sent: list[Mapping[str, Any]]) -> Iterator[PageServer]:
    """Serve a page to which a test feeds frames; a command `fail` is refused."""

    def command(given: Mapping[str, Any]) -> str:
        sent.append(given)
        return 'it does not' if given.get('action') == 'reset' else ''

    page = PageServer('127.0.0.1', 0, command)
    yield page
    page.close()


def frame(t: float, state: str = 'running') -> dict[str, Any]:
    return {
        't': t, 'line': [[0, 0], [4, 1], [5, 3 + t]], 'elbow': 1, 'sensed': [5, 3],
        'reference': [5, 3.1], 'age': 0.002, 'state': state, 'tip_error': 0.1 * t,
        'delta1': t, 'delta2': -t, 'tau1': 10 * t, 'tau2': 1, 'lambda': 0.2,
    }  # fmt: skip


def answer(
    page: PageServer, method: str = 'GET', path: str = '/', body: str = '', **headers: str
) -> tuple[int, str]:
    host, port = page.address.split('/')[2].split(':')
    connection = http.client.HTTPConnection(host, int(port), timeout=20)
    connection.request(method, path, body, {k.replace('_', '-'): v for k, v in headers.items()})
    response = connection.getresponse()
    return response.status, response.read().decode()


def opened(browser: Browser, address: str, width: int = 1440, mobile: bool = False) -> None:
    browser.call('Page.navigate', url='about:blank')  # the page of the test before has ended
    browser.until("document.URL === 'about:blank' && document.readyState === 'complete'")
    browser.frame()
    browser.events.clear()
    browser.size(width, 1000, mobile)
    browser.call('Page.navigate', url=address)
    browser.until("document.readyState === 'complete'")


def test_the_share_of_lost_measurements_is_that_of_the_scenario(tmp_path: Path) -> None:
    overrides = ['duration=3.0', 'tip_sensor.dropout=0.25', 'controller.ks=5.0']
    simulate(scenario.load('fls_tip', overrides), tmp_path / 'run', 'fls_tip')
    shares = [frame['held'] for frame in recording(tmp_path / 'run')['frames']]
    assert sum(shares) / len(shares) == pytest.approx(0.25, abs=0.03)


def test_a_recording_without_losses_has_none(recorded: Path) -> None:
    shares = [frame['held'] for frame in recording(recorded)['frames']]
    assert all(share == 0.0 for share in shares[5:])


def test_strain_gauges_have_a_plot_where_a_run_has_them(
    browser: Browser, recorded: Path, tmp_path: Path
) -> None:
    config = scenario.load('pd_tip', ['duration=0.2', 'strain_gauge.output=angle'])
    simulate(config, tmp_path / 'run', 'pd_tip')
    titles = "[...document.querySelectorAll('.u-title')].map((t) => t.textContent)"
    shown = []
    for run in (tmp_path / 'run', recorded):
        data = recording(run)
        page = PageServer('127.0.0.1', 0, lambda _: '', data)
        page.feed.put('hello', data['hello'])
        try:
            opened(browser, page.address)
            browser.until("document.querySelectorAll('.u-title').length > 0")
            shown.append([text for text in browser.js(titles) if 'strain' in text])
        finally:
            page.close()
        assert ('strain1' in data['frames'][-1]) is (run != recorded)
    assert shown == [['strain gauges, rad'], []]


def test_the_server_answers_this_machine_only(server: PageServer) -> None:
    assert answer(server)[0] == 200
    assert answer(server, Host='localhost:80')[0] == 200
    assert answer(server, Host='evil.example')[0] == 403
    assert answer(server, path='/../page.py')[0] == 404
    assert answer(server, path='/recording.json')[0] == 404
    assert is_loopback('::1')
    assert not is_loopback('0.0.0.0')


def test_a_command_is_json(server: PageServer, sent: list[Mapping[str, Any]]) -> None:
    text = json.dumps({'action': 'pause'})
    assert answer(server, 'POST', '/command', text)[0] == 415
    json_type = 'application/json'
    assert answer(server, 'POST', '/command', text, Content_Type=json_type) == (
        200, '{"problem": ""}'
    )  # fmt: skip
    assert answer(server, 'POST', '/command', '[', Content_Type=json_type)[0] == 400
    assert answer(server, 'POST', '/command', ' ' * 20_000, Content_Type=json_type)[0] == 413
    assert answer(server, 'POST', '/other', text, Content_Type=json_type)[0] == 404
    assert sent == [{'action': 'pause'}]


def test_on_another_address_the_page_needs_its_token() -> None:
    page = PageServer('0.0.0.0', 0, lambda _: '')
    try:
        path = page.address.partition('0.0.0.0')[2].partition('/')[2]
        assert answer(page)[0] == 403
        assert answer(page, path='/?token=x')[0] == 403
        assert answer(page, path=f'/{path}')[0] == 200
        assert answer(page, path='/page.js', Cookie=f'flexarm_token={page.token}')[0] == 200
        assert (
            answer(page, Host='robot.example', Cookie=f'a=b; flexarm_token={page.token}')[0] == 200
        )
    finally:
        page.close()


def test_a_port_in_use_is_named(server: PageServer) -> None:
    port = int(server.address.rpartition(':')[2])
    with pytest.raises(PageError, match=f'port {port} on 127.0.0.1'):
        PageServer('127.0.0.1', port, lambda _: '')


@pytest.mark.parametrize(('width', 'mobile'), SIZES)
def test_the_page_moves_with_the_frames(
    browser: Browser, server: PageServer, width: int, mobile: bool
) -> None:
    server.feed.put('hello', described(scenario.load('fls_tip', [])))
    opened(browser, server.address, width, mobile)
    for k in range(3):
        server.feed.put('frame', frame(0.1 * k))
        browser.until(f"document.getElementById('time').textContent === '{0.1 * k:.3f} s'")
    browser.until("document.getElementById('state').textContent === 'running'")
    browser.until("document.querySelectorAll('.uplot').length === 6")
    pixels = (
        "[...document.getElementById('arm').getContext('2d').getImageData("
        'document.getElementById("arm").width / 2 - 10, 0, 200, 300).data].some((v) => v > 0)'
    )
    browser.until(pixels)
    assert browser.js('document.documentElement.scrollWidth') <= width
    assert browser.problems() == []


def test_buttons_and_sliders_send_commands(
    browser: Browser, server: PageServer, sent: list[Mapping[str, Any]]
) -> None:
    server.feed.put('hello', described(scenario.load('fls_tip', [])))
    server.feed.put('frame', frame(0.5, 'paused'))
    opened(browser, server.address)
    browser.until("document.getElementById('play').textContent === 'Continue'")
    browser.js("document.getElementById('play').click()")
    browser.js("document.getElementById('step').click()")
    browser.js(
        "(() => { const s = document.getElementById('tip_sensor.latency'); s.value = '0.004';"
        "s.dispatchEvent(new Event('change')); })()"
    )
    browser.until("document.getElementById('notice').hidden")
    wait_for(lambda: len(sent) == 3, 20, 'three commands')
    assert {s['action'] for s in sent} == {'resume', 'step', 'set'}
    assert {'action': 'set', 'node': 'tip_sensor', 'key': 'latency', 'value': 0.004} in sent
    browser.js("document.getElementById('reset').click()")
    browser.until("document.getElementById('notice').textContent === 'it does not'")


def test_a_server_that_is_gone_and_back(browser: Browser, sent: list[Mapping[str, Any]]) -> None:
    page = PageServer('127.0.0.1', 0, lambda _: '')
    port = int(page.address.rpartition(':')[2])
    opened(browser, page.address)
    browser.until("document.getElementById('state').textContent === 'waiting for a run'")
    page.close()
    browser.until("document.getElementById('state').textContent === 'no server'")
    again = PageServer('127.0.0.1', port, lambda _: '')
    try:
        again.feed.put('frame', frame(7.0))
        browser.until("document.getElementById('time').textContent === '7.000 s'", 40.0)
    finally:
        again.close()


def test_two_pages_at_once_see_every_change(browser: Browser, server: PageServer) -> None:
    host, port = server.address.split('/')[2].split(':')
    other = http.client.HTTPConnection(host, int(port), timeout=20)
    other.request('GET', '/events')
    stream = other.getresponse()
    opened(browser, server.address)
    server.feed.put('frame', frame(1.5))
    browser.until("document.getElementById('time').textContent === '1.500 s'")
    assert stream.readline() == b'retry: 500\n'
    assert stream.readline() == b'\n'
    assert stream.readline() == b'event: frame\n'
    assert json.loads(stream.readline().removeprefix(b'data: '))['t'] == 1.5
    other.close()


def test_a_recorded_run_is_played_with_a_scrubber(browser: Browser, recorded: Path) -> None:
    data = recording(recorded)
    assert len(data['frames']) <= FRAMES
    last = data['frames'][-1]
    assert last['age'] == pytest.approx(0.002, abs=1e-9)
    page = PageServer('127.0.0.1', 0, lambda _: '', data)
    page.feed.put('hello', data['hello'])
    try:
        opened(browser, page.address)
        browser.until("parseFloat(document.getElementById('time').textContent) > 0.1")
        browser.js(
            "(() => { const s = document.getElementById('scrub'); s.value = s.max;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        browser.until(f"document.getElementById('time').textContent === '{last['t']:.3f} s'")
        hidden = "getComputedStyle(document.getElementById('sliders')).display === 'none'"
        assert browser.js(hidden)
        assert browser.problems() == []
    finally:
        page.close()


def test_ticks_of_an_axis_have_the_digits_of_its_step(
    browser: Browser, server: PageServer
) -> None:
    opened(browser, server.address)
    for value, step, text in (
        (0.005, 0.0025, '0.0050'), (-0.06, 0.02, '−0.06'), (-1e-4, 1e-4, '−1e−4'),
        (-1e-20, 1e-4, '0'), (7.5, 2.5, '7.5'), (300.0, 100.0, '300'),
    ):  # fmt: skip
        assert browser.js(f'tickText({value!r}, {step!r})') == text


def test_a_command_waits_until_its_node_is_heard_of() -> None:
    heard = iter(['', '', '/tip_sensor'])
    assert found(lambda role: next(heard), 'tip_sensor') == '/tip_sensor'
    asked: list[str] = []
    assert not found(lambda role: asked.append(role) or '', 'nobody')
    assert asked == ['nobody']


@pytest.mark.nodes
def test_a_slider_reaches_the_node_and_is_recorded(tmp_path: Path, ros_domain: int) -> None:
    browser, run = open_browser(tmp_path / 'profile'), tmp_path / 'run'
    process = subprocess.Popen(
        [sys.executable, '-m', 'flexarm_ros.cli', 'run', 'fls_tip', '--view', '--port', '0',
         '--set', 'duration=60', '--domain', str(ros_domain), '--no-pictures', '--out', run],
        stderr=subprocess.PIPE, text=True, cwd=ROOT,
    )  # fmt: skip
    try:
        assert process.stderr is not None
        lines = iter(process.stderr.readline, '')
        address = next(line.split()[1] for line in lines if line.startswith('page: '))
        opened(browser, address)
        browser.until("parseFloat(document.getElementById('time').textContent) > 0.02", 60.0)
        browser.js(
            "(() => { const s = document.getElementById('tip_sensor.latency'); s.value = '0.0013';"
            "s.dispatchEvent(new Event('change')); })()"
        )
        moved = "document.getElementById('tip_sensor.latency.number').value === '0.0013'"
        browser.until(moved, 30.0)
        wait_for(lambda: 'tip_sensor' in notes(browser), 30, 'the change is told')
        browser.js("document.getElementById('play').click()")
        browser.until("document.getElementById('state').textContent === 'paused'", 30.0)
    finally:
        browser.close()
        process.terminate()
        process.communicate(timeout=60)
    changes = [(c.node, c.key, c.value) for c in BagReader(run).config.changes]
    assert changes == [('tip_sensor', 'latency', 0.0013)]


def notes(browser: Browser) -> str:
    """Return the live parameters that the page has been told of as changed."""
    return str(
        browser.js(
            'view.hello.parameters.filter((p) => p.value === 0.0013).map((p) => p.node).join()'
        )
    )
