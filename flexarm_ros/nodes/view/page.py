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
The live page: an HTTP server with one page, a stream of frames, and commands.

``GET /events`` is a stream of server-sent events: ``hello`` (the arm, the parameters that may
change while running), ``frame`` (the arm at one instant), ``state`` (the phase of the run).
``GET /recording.json`` has all frames of a recorded run.  ``POST /command`` takes
``{"action": ..}``.  No ROS: what a command does is given.

The page has no accounts.  The server binds to the loopback address; on any other address each
request needs the token of the printed address.  The header ``Host`` is checked, so that a page
from elsewhere cannot reach the server by a name that it resolves to this machine, and a command
must be JSON, which no form of another site can send.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
import ipaddress
import json
import secrets
import socket
import threading
from typing import Any
from urllib.parse import parse_qs, urlsplit

from flexarm_ros.analysis.palette import style_sheet

Command = Callable[[Mapping[str, Any]], str]
"""Carries out a command; returns the error, empty on success."""

_CSS = 'text/css; charset=utf-8'
_FILES = {
    '/': ('page.html', 'text/html; charset=utf-8'),
    '/page.js': ('page.js', 'text/javascript; charset=utf-8'),
    '/page.css': ('page.css', _CSS),
    '/uplot.js': ('uplot/uPlot.iife.min.js', 'text/javascript; charset=utf-8'),
    '/uplot.css': ('uplot/uPlot.min.css', _CSS),
}
_POLICY = (
    "default-src 'self'; img-src 'self' data:; style-src 'self' 'unsafe-inline'; "
    "frame-ancestors 'none'"
)
_MOST_BYTES = 10_000
_KEEP_ALIVE_S = 5.0


class PageError(Exception):
    """The page cannot be served; one line."""


def is_loopback(host: str) -> bool:
    """Return whether an address, or ``localhost``, is of this machine only."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == 'localhost'


class Feed:
    """The newest frame and the description of the arm, for any number of readers."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._newest: dict[str, tuple[int, str]] = {}
        self._number = 0
        self.closed = False

    def put(self, event: str, value: Any) -> None:
        """Replace the newest value of an event by ``value``, anything that JSON can hold."""
        text = json.dumps(value, allow_nan=False)
        with self._changed:
            if event != 'frame' and self._newest.get(event, (0, ''))[1] == text:
                return
            self._number += 1
            self._newest[event] = self._number, text
            self._changed.notify_all()

    def close(self) -> None:
        """End all readers."""
        with self._changed:
            self.closed = True
            self._changed.notify_all()

    def after(self, seen: int) -> tuple[int, list[tuple[str, str]]]:
        """Wait for events later than number ``seen``; return the last number, and the events."""
        with self._changed:
            self._changed.wait_for(lambda: self.closed or self._number > seen, _KEEP_ALIVE_S)
            later = sorted(
                (number, event, text)
                for event, (number, text) in self._newest.items()
                if number > seen
            )
            return max(self._number, seen), [(event, text) for _, event, text in later]


class PageServer:
    """
    Serves the page at ``address``; raises PageError if the port is in use.

    ``port`` 0 takes a free one.  ``recording``: all frames of a recorded run, or None.
    """

    def __init__(
        self, host: str, port: int, command: Command, recording: Any | None = None
    ) -> None:
        self.feed, self.command = Feed(), command
        self.recording = None if recording is None else json.dumps(recording, allow_nan=False)
        self.token = '' if is_loopback(host) else secrets.token_urlsafe(16)
        self.loopback = is_loopback(host)
        outer = self

        class Handler(_Handler):
            page = outer

        try:
            self._server = _Server((host, port), Handler)
        except (OSError, OverflowError) as error:
            raise PageError(f'port {port} on {host}: {error}') from None
        port = self._server.server_address[1]
        query = f'/?token={self.token}' if self.token else ''
        self.address = f'http://{host}:{port}{query}'
        self._thread = threading.Thread(
            target=self._server.serve_forever, args=(0.05,), daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        """Stop the server and end its streams."""
        self.feed.close()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def handle_error(self, *_: Any) -> None:
        """Ignore a browser that has disconnected."""


class _Handler(BaseHTTPRequestHandler):
    page: PageServer
    protocol_version = 'HTTP/1.1'
    timeout = 30.0

    def log_message(self, *_: Any) -> None:
        """Print no line for each request."""

    def do_GET(self) -> None:
        """Serve a file, the recording or the stream."""
        path = self._allowed_path()
        if path in _FILES:
            name, kind = _FILES[path]
            content = (files('flexarm_ros.nodes.view') / 'assets' / name).read_bytes()
            self._send(HTTPStatus.OK, content, kind)
        elif path == '/palette.css':
            self._send(HTTPStatus.OK, style_sheet().encode(), _CSS)
        elif path == '/recording.json' and self.page.recording is not None:
            self._send(HTTPStatus.OK, self.page.recording.encode(), 'application/json')
        elif path == '/events':
            self._stream()
        elif path:
            self._send(HTTPStatus.NOT_FOUND, b'not found\n')

    def do_POST(self) -> None:
        """Carry out a command."""
        path = self._allowed_path()
        if not path:
            return
        if path != '/command':
            self._send(HTTPStatus.NOT_FOUND, b'not found\n')
            return
        length = self.headers.get('Content-Length', '')
        if self.headers.get_content_type() != 'application/json' or not length.isdecimal():
            self._send(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, b'a command is JSON\n')
            return
        if int(length) > _MOST_BYTES:
            self.close_connection = True
            self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, b'too long\n')
            return
        try:
            command = json.loads(self.rfile.read(int(length)))
        except (ValueError, RecursionError):
            command = None
        problem = self.page.command(command) if isinstance(command, dict) else 'not an object'
        status = HTTPStatus.BAD_REQUEST if problem else HTTPStatus.OK
        self._send(status, json.dumps({'problem': problem}).encode(), 'application/json')

    def _allowed_path(self) -> str:
        """Return the path of a request that may be answered; refuse others and return ''."""
        parts = urlsplit(self.path)
        host = urlsplit(f'//{self.headers.get("Host", "")}').hostname or ''
        if self.page.loopback and not is_loopback(host):
            self._send(HTTPStatus.FORBIDDEN, b'served to this machine only\n')
            return ''
        given = parse_qs(parts.query).get('token', [''])[0] or self._cookie()
        if self.page.token and not secrets.compare_digest(
            given.encode(), self.page.token.encode()
        ):
            self._send(HTTPStatus.FORBIDDEN, b'open the address with the token that was printed\n')
            return ''
        return parts.path

    def _cookie(self) -> str:
        pairs = (part.strip().partition('=') for part in self.headers.get('Cookie', '').split(';'))
        return next((value for name, _, value in pairs if name == 'flexarm_token'), '')

    def _send(
        self, status: HTTPStatus, content: bytes, kind: str = 'text/plain; charset=utf-8'
    ) -> None:
        self._head(status, kind, {'Content-Length': str(len(content))})
        self.wfile.write(content)

    def _head(self, status: HTTPStatus, kind: str, more: Mapping[str, str]) -> None:
        self.send_response(status)
        headers = {
            'Content-Type': kind,
            'Content-Security-Policy': _POLICY,
            'X-Content-Type-Options': 'nosniff',
            'Cache-Control': 'no-store',
            'Referrer-Policy': 'no-referrer',
            **more,
        }
        if self.page.token and status == HTTPStatus.OK:
            headers['Set-Cookie'] = (
                f'flexarm_token={self.page.token}; HttpOnly; SameSite=Strict; Path=/'
            )
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()

    def _stream(self) -> None:
        self.close_connection = True
        self.connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._head(HTTPStatus.OK, 'text/event-stream', {'Connection': 'close'})
        self.wfile.write(b'retry: 500\n\n')
        seen = 0
        while not self.page.feed.closed:
            seen, events = self.page.feed.after(seen)
            lines = [f'event: {event}\ndata: {text}\n\n' for event, text in events]
            self.wfile.write(''.join(lines or [': \n\n']).encode())  # a comment keeps it alive
