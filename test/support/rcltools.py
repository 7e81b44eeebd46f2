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

"""rcl's functions for compiled code, over queues of a test instead of a middleware."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
import ctypes
from typing import Any

from flexarm_ros.nodes.runtime.topics import rcl_ports
from flexarm_ros.wire.rcl_calls import BUFFER, CAPACITY, GID, LENGTH, NUMBER
import pytest
import rclpy

Taken = tuple[bytes, dict[str, Any]]

TAKE_FAILED = 401
"""RCL_RET_SUBSCRIPTION_TAKE_FAILED: no message."""
_NO_NUMBER = -1


class Endpoint:
    """
    One publisher or subscription, in the place of its handle.

    ``left``: messages to be taken, as rclpy returns them; ``published``: what has been published,
    ``refusals``: how often that is to fail first.
    """

    def __init__(self, rcl: Rcl, messages: Iterable[Taken] = ()) -> None:
        self.left, self.published, self.refusals = deque(messages), list[bytes](), 0
        self.pointer = len(rcl.endpoints) + 1
        rcl.endpoints[self.pointer] = self

    def take_message(self, *_: Any) -> Taken | None:
        return self.left.popleft() if self.left else None

    def get_publisher_count(self) -> int:
        return 1


class Rcl:
    """Stands in for rcl; ``waits``: the endpoints that have been waited for."""

    address = 0
    """Of a wait set, as that of a `Waiter`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        assert rclpy  # its libraries are loaded
        rcl_ports._functions.cache_clear()
        self.endpoints: dict[int, Endpoint] = {}
        self.waits: list[Endpoint] = []
        self.on_wait: Callable[[], None] = lambda: None
        word = ctypes.c_int64
        self._kept = {
            'take': ctypes.CFUNCTYPE(ctypes.c_int, word, word, word, word)(self._take),
            'publish': ctypes.CFUNCTYPE(ctypes.c_int, word, word, word)(self._publish),
            'add': ctypes.CFUNCTYPE(ctypes.c_int, word, word, word)(self._add),
            'wait': ctypes.CFUNCTYPE(ctypes.c_int, word, word)(self._wait),
            'clear': ctypes.CFUNCTYPE(ctypes.c_int, word)(lambda _: 0),
            'reset_error': ctypes.CFUNCTYPE(ctypes.c_int, word)(lambda _: 0),
        }
        own = {name: rcl_ports._address(function) for name, function in self._kept.items()}
        functions = {**rcl_ports._functions(), **own}
        monkeypatch.setattr(rcl_ports, '_functions', lambda: functions)

    def _take(self, endpoint: int, message: int, info: int, _: int) -> int:
        taken = self.endpoints[endpoint].take_message()
        if taken is None:
            return TAKE_FAILED
        data, said = taken
        words = (ctypes.c_int64 * 8).from_address(message)
        if len(data) > words[CAPACITY]:
            resize = rcl_ports._library('librcutils.so').rcutils_uint8_array_resize
            resize(ctypes.c_void_p(message), ctypes.c_size_t(len(data)))
        ctypes.memmove(words[BUFFER], data, len(data))
        words[LENGTH] = len(data)
        told = (ctypes.c_int64 * 8).from_address(info)
        number = said.get('publication_sequence_number')
        told[NUMBER] = _NO_NUMBER if number is None else number
        sender = said.get('publisher_gid', {'data': bytes(16)})['data'][:16]
        ctypes.memmove(info + 8 * GID, sender, len(sender))
        return 0

    def _publish(self, endpoint: int, message: int, _: int) -> int:
        there = self.endpoints[endpoint]
        if there.refusals:
            there.refusals -= 1
            return 1
        words = (ctypes.c_int64 * 8).from_address(message)
        there.published.append(ctypes.string_at(words[BUFFER], words[LENGTH]))
        return 0

    def _add(self, _: int, endpoint: int, __: int) -> int:
        self.waits.append(self.endpoints[endpoint])
        return 0

    def _wait(self, _: int, __: int) -> int:
        self.on_wait()
        return 0
