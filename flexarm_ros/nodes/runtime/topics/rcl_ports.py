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
The addresses of rcl's functions and endpoints, for `flexarm_ros.wire.rcl_calls`.

This module and that one depend on the structures of rcl's C interface.  With a version of rclpy
for which they are not known to be right, `make_link` returns None, and nodes take every message in
Python.
"""

from __future__ import annotations

import ctypes
from functools import cache
from importlib.metadata import PackageNotFoundError, version
import os
import sys
from types import SimpleNamespace
from typing import Any, Protocol
import weakref

from flexarm_ros.core.numerics.records import Records
from flexarm_ros.wire.rcl_calls import BUFFER, CAPACITY, GID, LENGTH, LINK, PORT, take_rows
import numba
import numpy as np

_KNOWN = ('7.', '9.')
"""Versions of rclpy (Jazzy, Kilted) with the structures of `flexarm_ros.wire.rcl_calls`."""

_config: Any = numba.config
_UNNUMBERED = -1
"""Sequence number where the middleware has none (UINT64_MAX)."""

_FUNCTIONS = {
    'librcl.so': {
        'take': 'rcl_take_serialized_message',
        'publish': 'rcl_publish_serialized_message',
        'clear': 'rcl_wait_set_clear',
        'add': 'rcl_wait_set_add_subscription',
        'wait': 'rcl_wait',
    },
    'librcutils.so': {'reset_error': 'rcutils_reset_error'},
    'libc.so.6': {'copy': 'memcpy', 'clock': 'clock_gettime'},
}
_FIRST_CAPACITY = 1024
_MOST_ROWS = 256


class Target(Protocol):
    """Where the bytes of a message are."""

    size: int
    address: int


class _Array(ctypes.Structure):
    """``rcutils_uint8_array_t``."""

    _fields_ = (
        ('buffer', ctypes.c_void_p), ('length', ctypes.c_size_t), ('capacity', ctypes.c_size_t),
        ('allocator', ctypes.c_void_p * 5),
    )  # fmt: skip


class _Allocator(ctypes.Structure):
    """``rcutils_allocator_t``."""

    _fields_ = (('words', ctypes.c_void_p * 5),)


def _library(name: str) -> ctypes.CDLL:
    """Return a library that rclpy has loaded; OSError if it has not."""
    return ctypes.CDLL(name, mode=os.RTLD_NOLOAD | os.RTLD_NOW)


@cache
def _functions() -> dict[str, int]:
    """Return the addresses of the functions by their names in `LINK`; empty if unknown."""
    try:
        known = version('rclpy').startswith(_KNOWN)
        if not known or _config.DISABLE_JIT or sys.platform != 'linux' or sys.maxsize < 2**32:
            return {}
        return {
            name: _address(getattr(_library(library), symbol))
            for library, symbols in _FUNCTIONS.items()
            for name, symbol in symbols.items()
        }
    except (PackageNotFoundError, OSError, AttributeError):
        return {}


def _address(function: Any) -> int:
    return ctypes.cast(function, ctypes.c_void_p).value or 0


def known() -> bool:
    """Whether compiled code can call rcl here."""
    return bool(_functions())


def make_link(wait_set: int, timeout_ns: int) -> Records | None:
    """Return a `LINK` for the wait set at this address; None where the interface is unknown."""
    found = _functions()
    if not found:
        return None
    link = np.zeros(1, LINK)
    for name, address in found.items():
        link[name] = address
    link['wait_set'], link['timeout'] = wait_set, timeout_ns
    return link


def open_input(port: Records, handle: Any, buffer: Target, owner: object) -> None:
    """
    Let a port, an array of one, take from rclpy's ``handle`` of a subscription to ``buffer``.

    The message of rcl, which enlarges it where it must, is released with ``owner``.
    """
    rcutils = _library('librcutils.so')
    rcutils.rcutils_get_default_allocator.restype = _Allocator
    allocator = rcutils.rcutils_get_default_allocator()
    array = _Array.from_buffer(port['message'])
    rcutils.rcutils_uint8_array_init(
        ctypes.byref(array), ctypes.c_size_t(_FIRST_CAPACITY), ctypes.byref(allocator)
    )
    port['endpoint'], port['size'], port['target'] = handle.pointer, buffer.size, buffer.address
    weakref.finalize(owner, rcutils.rcutils_uint8_array_fini, ctypes.byref(array))


def open_output(port: Records, handle: Any, buffer: Target) -> None:
    """Let a port, an array of one, publish what is in ``buffer`` by rclpy's ``handle``."""
    port['endpoint'] = handle.pointer
    port['message'][0, [BUFFER, LENGTH, CAPACITY]] = buffer.address, buffer.size, buffer.size


class BlockReader:
    """Takes many messages of one size from the subscription ``handle`` in one call."""

    def __init__(self, handle: Any, size: int) -> None:
        self.port, self._link = np.zeros(1, PORT), make_link(0, 0)
        self._rows = np.empty((_MOST_ROWS, size), np.uint8)
        rows: Target = SimpleNamespace(size=size, address=0)
        open_input(self.port, handle, rows, self)

    def take(self, most: int) -> list[bytes]:
        """Return the messages that have arrived, at most ``most`` and `_MOST_ROWS`."""
        size, rows = self._rows.shape[1], self._rows[:most]
        data = rows[: take_rows(self._link, self.port, rows)].tobytes()
        return [data[at : at + size] for at in range(0, len(data), size)]


def message_of(port: Records, gid: bool) -> tuple[bytes, dict[str, Any]]:
    """Return the message in a port with its info, as rclpy returns them; ``gid``: with its GID."""
    words = port['message'][0]
    info = _info(port['info'][0].tobytes(), gid)
    return ctypes.string_at(int(words[BUFFER]), int(words[LENGTH])), info


def _info(data: bytes, gid: bool) -> dict[str, Any]:
    """Return an ``rmw_message_info_t`` as rclpy does."""
    source, received, number, reception = np.frombuffer(data, np.int64, 4).tolist()
    info = {
        'source_timestamp': source,
        'received_timestamp': received,
        'publication_sequence_number': None if number == _UNNUMBERED else number,
        'reception_sequence_number': None if reception == _UNNUMBERED else reception,
    }
    return {**info, 'publisher_gid': {'data': data[8 * GID :][:16]}} if gid else info
