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
"""``--view``: a viewer process beside a run."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import signal
import socket
import subprocess
import sys

from flexarm_ros.cli import UsageError
from flexarm_ros.nodes.runtime.parameters import own as nodes

OWN = nodes.OWN['viewer']
"""Parameters of the viewer, whose defaults are those of the options."""
_END_S = 10.0


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options ``--view`` and ``--port``."""
    parser.add_argument(
        '--view', action='store_true',
        help='serve a page that shows the run, in real time unless --rtf is given',
    )  # fmt: skip
    parser.add_argument(
        '--port', type=int, default=OWN['port'].default, choices=range(65536), metavar='P',
        help='port of the page (default %(default)s; 0: any free port)',
    )  # fmt: skip


def check_port(port: int) -> None:
    """Raise UsageError if the page cannot be served at ``port``."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(('127.0.0.1', port))
        except OSError as error:
            raise UsageError(f'--port {port}: {error.strerror}') from None


@contextmanager
def page_beside(
    domain: int, namespace: str, port: int, say: Callable[[str], None]
) -> Iterator[None]:
    """Serve the page of the run in that domain; print its address once it is served."""
    command = [
        sys.executable, '-m', 'flexarm_ros.cli', 'view', '--domain', str(domain),
        '--port', str(port), '--foxglove-port', '0',
    ]  # fmt: skip
    if namespace:
        command += ['--namespace', namespace]
    # A group of its own: Ctrl-C goes to the run, which ends the page when the nodes have left.
    viewer = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, start_new_session=True
    )  # fmt: skip
    assert viewer.stdout is not None
    try:
        for line in viewer.stdout:
            if line.startswith('page: '):
                say(line.rstrip())
                break
        yield
    finally:
        viewer.send_signal(signal.SIGINT)
        try:
            viewer.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            viewer.kill()
            viewer.communicate()
