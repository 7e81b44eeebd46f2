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
A process that imports the package once, then forks each process that a test asks for.

``python -m starttemplate FD``: the descriptor is a socket to `quickstart`, whose requests are
answered with the process id.  A fork is not the template's child, but that of the test's process.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import gc
from importlib import import_module
from itertools import pairwise
import json
import os
import socket
import sys
from typing import Any, NoReturn

from flexarm_ros import scenario
from flexarm_ros.cli import COMMANDS
from flexarm_ros.core.run.warmup import warm_up
from flexarm_ros.core.warned import allow_warnings
from flexarm_ros.launcher.fork.server import _fork, become
from flexarm_ros.nodes.classes import MODULES
from flexarm_ros.scenario.plugins import registry as plugins

COMMON = ('run', 'simulate', 'replay', 'verify')
LARGEST = 1 << 20


def serve(client: socket.socket) -> None:
    """Answer requests until the test's process has ended."""
    while True:
        data, descriptors, _, _ = socket.recv_fds(client, LARGEST, 253)
        if not data:
            return
        request = json.loads(data)
        read, write = os.pipe()
        between = _fork({})
        if between == 0:
            pid = _fork({})
            if pid == 0:
                client.close()
                take_place(request, descriptors)
            os.write(write, str(pid).encode())
            os._exit(0)
        os.waitpid(between, 0)
        client.send(os.read(read, 20))
        for descriptor in (read, write, *descriptors):
            os.close(descriptor)


def take_place(request: Mapping[str, Any], descriptors: Sequence[int]) -> NoReturn:
    """Run as the command of ``request`` would, with its files, environment and directory."""
    place_files(dict(zip(request['files'], descriptors, strict=True)))
    os.environ.clear()
    os.environ.update(request['environment'])
    os.chdir(request['directory'])
    places = os.environ.get('PYTHONPATH', '').split(os.pathsep)
    sys.path[:1] = [request['directory'], *(p for p in places if p and p not in sys.path)]
    plugins.installed_laws.cache_clear()
    plugins.installed_parts.cache_clear()
    become(request['command'])


def place_files(files: Mapping[int, int]) -> None:
    """Give each descriptor its number, and close all others."""
    above = max(files) + 1
    high = {number: os.dup(held) for number, held in files.items()}
    while min(high.values()) < above:
        high = {number: os.dup(held) for number, held in high.items()}
    for number, held in high.items():
        os.dup2(held, number)
    for first, last in pairwise([-1, *sorted(files), os.sysconf('SC_OPEN_MAX')]):
        if first + 1 < last:  # an empty range would be all
            os.closerange(first + 1, last)


def main() -> None:
    """Import what the processes of the tests do, and serve."""
    allow_warnings()
    for name in (*MODULES, *(f'flexarm_ros.cli.{COMMANDS[word][0]}' for word in COMMON)):
        import_module(name)
    warm_up(scenario.load('fls_tip', []))
    gc.collect()
    gc.freeze()
    serve(socket.socket(fileno=int(sys.argv[1])))


if __name__ == '__main__':
    main()
