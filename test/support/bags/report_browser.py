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
A headless Chromium driven over its DevTools pipe: what the report's tests look through.

The protocol is JSON objects ended by a zero byte, on the browser's file descriptors 3 and 4;
no driver program, no port and no further package is needed.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
from pathlib import Path
import select
import shutil
import signal
import subprocess
import time
from typing import Any

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable', 'chrome')
DEADLINE = 60.0


def find_chromium() -> str | None:
    """Return the path of a Chromium or Chrome, of ``$FLEXARM_CHROMIUM`` first."""
    given = os.environ.get('FLEXARM_CHROMIUM')
    return given or next((path for name in NAMES if (path := shutil.which(name))), None)


class Browser:
    """One page of one browser; events that came in are kept in ``events``."""

    def __init__(self, program: str, profile: Path) -> None:
        self.events: list[dict[str, Any]] = []
        self._number, self._buffer = 0, b''
        to_browser, self._to = os.pipe()
        self._from, from_browser = os.pipe()
        flags = (
            '--headless', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
            '--disable-background-networking', '--disable-component-update', '--disable-sync',
            '--disable-dev-shm-usage', '--hide-scrollbars', '--remote-debugging-pipe',
            f'--user-data-dir={profile}',
        )  # fmt: skip
        command = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        self._process = subprocess.Popen(
            ['/bin/bash', '-c', command, 'bash', program, *flags, 'about:blank'],
            pass_fds=(to_browser, from_browser), stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        os.close(to_browser)
        os.close(from_browser)
        self._session: str | None = None
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        attached = self.call('Target.attachToTarget', targetId=target, flatten=True)
        self._session = attached['sessionId']
        for domain in ('Page', 'Runtime', 'Log', 'Network'):
            self.call(f'{domain}.enable')

    def close(self) -> None:
        """End the browser and all of its processes."""
        os.close(self._to)
        os.close(self._from)
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(5.0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Send a command and return its result; RuntimeError if it fails."""
        self._number += 1
        message: dict[str, Any] = {'id': self._number, 'method': method, 'params': params}
        if self._session is not None:
            message['sessionId'] = self._session
        os.write(self._to, json.dumps(message).encode() + b'\0')
        end = time.monotonic() + DEADLINE
        while True:
            answer = self._receive(end)
            if answer.get('id') == self._number:
                if 'error' in answer:
                    raise RuntimeError(f'{method}: {answer["error"]["message"]}')
                return dict(answer['result'])
            self.events.append(answer)

    def _receive(self, end: float) -> dict[str, Any]:
        while b'\0' not in self._buffer:
            ready, _, _ = select.select([self._from], [], [], max(0.0, end - time.monotonic()))
            part = os.read(self._from, 1 << 20) if ready else b''
            if not part:
                raise RuntimeError('the browser does not answer')
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b'\0')
        return dict(json.loads(message))

    def js(self, expression: str) -> Any:
        """Return the value of a JavaScript expression in the page."""
        result = self.call('Runtime.evaluate', expression=expression, returnByValue=True)
        if 'exceptionDetails' in result:
            raise RuntimeError(str(result['exceptionDetails']))
        return result['result'].get('value')

    def until(self, condition: str, seconds: float = 20.0) -> None:
        """Wait until a JavaScript condition holds in the page."""
        end = time.monotonic() + seconds
        while not self.js(f'Boolean({condition})'):
            assert time.monotonic() < end, f'not within {seconds} s: {condition}'
            self.frame()

    def frame(self) -> None:
        """Wait until the page was drawn once more."""
        code = 'new Promise((done) => requestAnimationFrame(() => setTimeout(done)))'
        self.call('Runtime.evaluate', expression=code, awaitPromise=True)

    def load(self, page: Path) -> None:
        """Load a report and wait until its script has run and its pictures are drawn."""
        self.call('Page.navigate', url=page.resolve().as_uri())
        self.until("document.readyState === 'complete'")
        self.until("document.documentElement.dataset.ready === 'yes'")
        self.until("document.querySelector('#paths svg .frame')")

    def size(self, width: int, height: int, mobile: bool = False) -> None:
        """Set the size of the view, in CSS pixels."""
        self.call(
            'Emulation.setDeviceMetricsOverride',
            width=width, height=height, deviceScaleFactor=1, mobile=mobile,
        )  # fmt: skip
        self.frame()

    def place(self, selector: str, x: float = 0.5, y: float = 0.5) -> tuple[float, float]:
        """Scroll an element into view and return a point of it (parts of width and height)."""
        box = self.js(
            f'(() => {{ const e = document.querySelector({json.dumps(selector)});'
            "e.scrollIntoView({block: 'center', behavior: 'instant'});"
            'const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; })()'
        )
        return box[0] + x * box[2], box[1] + y * box[3]

    def click(self, selector: str, x: float = 0.5, y: float = 0.5, count: int = 1) -> None:
        """Click on an element with the mouse."""
        at = self.place(selector, x, y)
        for number in range(1, count + 1):
            self._mouse('mousePressed', at, number)
            self._mouse('mouseReleased', at, number)

    def drag(self, selector: str, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Drag with the mouse from one part of an element to another."""
        first, last = self.place(selector, *start), self.place(selector, *end)
        middle = ((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0)
        self._mouse('mousePressed', first, 1)
        self._mouse('mouseMoved', middle, 0)
        self._mouse('mouseMoved', last, 0)
        self._mouse('mouseReleased', last, 1)

    def hover(self, selector: str, x: float, y: float) -> None:
        """Move the mouse over a part of an element."""
        self._mouse('mouseMoved', self.place(selector, x, y), 0)

    def _mouse(self, kind: str, at: tuple[float, float], count: int) -> None:
        pressed = kind != 'mouseMoved' or count
        self.call(
            'Input.dispatchMouseEvent', type=kind, x=at[0], y=at[1], clickCount=count,
            button='left' if pressed else 'none', buttons=1 if kind == 'mousePressed' else 0,
        )  # fmt: skip

    def key(self, name: str, text: str = '', modifiers: int = 0) -> None:
        """Press a key; ``text`` is what it types."""
        shared = {'key': name, 'code': name, 'modifiers': modifiers}
        down = 'keyDown' if text else 'rawKeyDown'
        self.call('Input.dispatchKeyEvent', type=down, text=text, **shared)
        self.call('Input.dispatchKeyEvent', type='keyUp', **shared)

    def media(self, **features: str) -> None:
        """Set media features, ``prefers_color_scheme="dark"``."""
        held = [{'name': k.replace('_', '-'), 'value': v} for k, v in features.items()]
        self.call('Emulation.setEmulatedMedia', features=held)

    def pdf(self) -> bytes:
        """Print the page."""
        return base64.b64decode(self.call('Page.printToPDF', preferCSSPageSize=True)['data'])

    def problems(self) -> list[str]:
        """Return errors and warnings of the console, and uncaught exceptions."""
        found = []
        for event in self.events:
            method, params = event.get('method'), event.get('params', {})
            if method == 'Runtime.exceptionThrown':
                found.append(str(params['exceptionDetails']))
            elif method == 'Log.entryAdded' and params['entry']['level'] in ('error', 'warning'):
                found.append(params['entry']['text'])
            elif method == 'Runtime.consoleAPICalled' and params['type'] in ('error', 'warning'):
                found.append(str(params['args']))
        return found

    def requests(self) -> list[str]:
        """Return the addresses that the page asked for."""
        return [
            event['params']['request']['url']
            for event in self.events
            if event.get('method') == 'Network.requestWillBeSent'
        ]
