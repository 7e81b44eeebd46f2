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
Two machines for a test: network namespaces with a link between them, good or bad.

A good link is a veth pair.  A bad one is the same pair with ``tc netem``, where the kernel has
that queue; elsewhere two TAP devices and a thread of the test that carries the frames from one to
the other, late, and loses some (drawn with a fixed seed).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import fcntl
import heapq
import itertools
import os
import random
import select
import shutil
import struct
import subprocess
import threading
import time

import pytest

ADDRESSES = ('192.0.2.1/30', '192.0.2.2/30')
"""Of TEST-NET-1: nobody's."""

_TUNSETIFF, _IFF_TAP, _IFF_NO_PI = 0x400454CA, 0x0002, 0x1000


def ip(*words: str) -> subprocess.CompletedProcess[str]:
    """Run ``ip``."""
    return subprocess.run(['ip', *words], capture_output=True, text=True, check=False)


def need_namespaces() -> None:
    """Skip the test where no namespace can be made."""
    if shutil.which('ip') is None:
        pytest.skip('no `ip` here: install iproute2 to test two machines')
    if os.geteuid() != 0:
        pytest.skip('not root: network namespaces need it')


class Relay:
    """Carries Ethernet frames between two TAP devices."""

    def __init__(self, names: tuple[str, str], loss: float, delay_s: float) -> None:
        self._loss, self._delay = loss, delay_s
        self._dice = random.Random(1)
        self._ends = [_open_tap(name) for name in names]
        self._stop = threading.Event()
        self.carried = self.lost = 0
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to carry."""
        self._thread.start()

    def close(self) -> None:
        """Stop, and remove the devices."""
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join(5.0)
        for end in self._ends:
            os.close(end)

    def _run(self) -> None:
        late: list[tuple[float, int, int, bytes]] = []
        number = itertools.count()
        while not self._stop.is_set():
            left = late[0][0] - time.monotonic() if late else 0.05
            readable, _, _ = select.select(self._ends, [], [], max(0.0, min(left, 0.05)))
            for end in readable:
                frame = os.read(end, 65536)
                if self._dice.random() < self._loss:
                    self.lost += 1
                    continue
                other = self._ends[1 - self._ends.index(end)]
                due = time.monotonic() + self._delay
                heapq.heappush(late, (due, next(number), other, frame))
            while late and late[0][0] <= time.monotonic():
                _, _, other, frame = heapq.heappop(late)
                os.write(other, frame)
                self.carried += 1


def _open_tap(name: str) -> int:
    try:
        descriptor = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
    except OSError as error:
        pytest.skip(f'neither tc netem nor /dev/net/tun here: {error.strerror}')
    try:
        flags = struct.pack('16sH22x', name.encode(), _IFF_TAP | _IFF_NO_PI)
        fcntl.ioctl(descriptor, _TUNSETIFF, flags)
    except OSError as error:
        os.close(descriptor)
        pytest.skip(f'neither tc netem nor TAP devices here: {error.strerror}')
    return descriptor


class Machines:
    """Two network namespaces and the link between them."""

    def __init__(self) -> None:
        self.names = tuple(f'flexarm{os.getpid()}{end}' for end in 'ab')
        self.links = tuple(f'fa{os.getpid()}{end}' for end in 'ab')
        self.kind = 'veth'
        self.relay: Relay | None = None

    def command(self, machine: int) -> list[str]:
        """Return the words that put a command on a machine."""
        return ['ip', 'netns', 'exec', self.names[machine]]

    def cut(self) -> None:
        """Take the link away."""
        assert ip('-n', self.names[0], 'link', 'set', self.links[0], 'down').returncode == 0


@contextmanager
def two_machines(loss: float = 0.0, delay_s: float = 0.0) -> Iterator[Machines]:
    """Make two machines; skips the test where this cannot be done."""
    need_namespaces()
    made = Machines()
    with ExitStack() as stack:
        for name in made.names:
            done = ip('netns', 'add', name)
            if done.returncode != 0:
                pytest.skip(f'no network namespaces here: {done.stderr.strip()}')
            stack.callback(ip, 'netns', 'del', name)
        _veth(made)
        if loss or delay_s:
            _spoil(made, stack, loss, delay_s)
        for name, link, address in zip(made.names, made.links, ADDRESSES, strict=True):
            for words in (
                ('addr', 'add', address, 'dev', link),
                ('link', 'set', link, 'up'),
                ('link', 'set', 'lo', 'up'),
                ('route', 'add', '224.0.0.0/4', 'dev', link),
            ):
                done = ip('-n', name, *words)
                assert done.returncode == 0, done.stderr
        if made.relay is not None:
            made.relay.start()
        yield made


def _veth(made: Machines) -> None:
    done = ip(
        'link', 'add', made.links[0], 'netns', made.names[0], 'type', 'veth',
        'peer', 'name', made.links[1], 'netns', made.names[1],
    )  # fmt: skip
    if done.returncode != 0:
        pytest.skip(f'no veth devices here: {done.stderr.strip()}')


def _spoil(made: Machines, stack: ExitStack, loss: float, delay_s: float) -> None:
    """Make the link lose and delay what it carries."""
    words = ['netem', 'loss', f'{loss * 100:g}%', 'delay', f'{delay_s * 1000:g}ms']
    for name, link in zip(made.names, made.links, strict=True):
        if shutil.which('tc') is None:
            break
        done = subprocess.run(
            [*made.command(made.names.index(name)), 'tc', 'qdisc', 'add', 'dev', link, 'root',
             *words], capture_output=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            break
    else:
        made.kind = 'veth with tc netem'
        return
    assert ip('-n', made.names[0], 'link', 'del', made.links[0]).returncode == 0
    made.relay = Relay(made.links, loss, delay_s)
    stack.callback(made.relay.close)
    for name, link in zip(made.names, made.links, strict=True):
        assert ip('link', 'set', link, 'netns', name).returncode == 0
    made.kind = 'TAP devices and a relay'
