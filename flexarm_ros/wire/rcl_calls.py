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
The C functions of rcl that compiled code calls: wait, take, publish.

rclpy calls the same functions of rcl, the C library below every ROS 2 client library.  A call from
compiled code needs no Python: no objects for a message and its info, no lock of the interpreter.
In a process of its own the code of a node is cold at every tick, and the Python between two
messages takes longer than the middleware.

Addresses
    Functions and endpoints are numbers in records, so that compiled code can be kept on disk, and
    that a test can put functions of its own in their place.
    `flexarm_ros.nodes.runtime.topics.rcl_ports` finds the addresses, for the versions of rcl that
    have the structures below.

Structures
    ``message`` is an ``rcutils_uint8_array_t``: buffer, length, capacity, and an allocator of five
    words.  ``info`` is an ``rmw_message_info_t``: two times, the sequence numbers of publication
    and reception, the publisher's GID (a pointer and 16 bytes) and one byte more.

Errors
    A call that fails is made again in Python, by rclpy, which raises what there is to tell.
"""

from __future__ import annotations

from typing import Any

from flexarm_ros.core.numerics.compiled import internal, unlocked
from flexarm_ros.core.numerics.records import Records
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
import numpy as np
from numpy.typing import NDArray

LINK = np.dtype(
    [
        *((name, np.int64) for name in ('take', 'publish', 'clear', 'add', 'wait')),
        *((name, np.int64) for name in ('reset_error', 'copy', 'clock')),
        ('wait_set', np.int64),  # rcl_wait_set_t with room for one subscription
        ('timeout', np.int64),  # longest wait for a message, ns
        ('now', np.int64, 2),  # s, ns: the answer of clock_gettime
        ('until', np.int64),  # time at which to return to Python, ns
        ('since', np.int64),  # time of the last progress, ns
        ('ticks', np.int64),  # calls of `progress` since the loop has begun
        ('longest', np.int64),  # longest time without progress, ns
        ('stop', np.int64),  # not 0: return to Python before the next tick
    ]
)
"""The functions by name, and what a loop over ticks needs besides its ports; one record."""

PORT = np.dtype(
    [
        ('endpoint', np.int64),  # rcl_subscription_t or rcl_publisher_t
        ('message', np.int64, 8),
        ('info', np.int64, 16),  # twice the size of the structure
        ('number', np.int64),  # sequence number of the last message
        ('sender', np.int64, 2),
        ('named', np.int64),  # whether messages name their sender
        ('last', np.int64),  # whether it arrives last: a take before a wait would fail
        ('size', np.int64),  # of the message, bytes
        ('target', np.int64),  # where its bytes are copied to
        ('state', np.int64),
    ]
)
"""An endpoint and its message; the ports of a node are an array."""

EMPTY, READ, OTHER = 0, 1, 2
"""State of a port: no message, the next one at ``target``, or another one in ``message``."""

BUFFER, LENGTH, CAPACITY = 0, 1, 2
"""Words of ``message``."""
NUMBER, GID = 2, 5
"""Words of ``info``: sequence number of publication, and the first of the two of the GID."""

_MESSAGE_AT: int = PORT.fields['message'][1]  # type: ignore[index]
_INFO_AT: int = PORT.fields['info'][1]  # type: ignore[index]
_NOW_AT: int = LINK.fields['now'][1]  # type: ignore[index]
_PORT_SIZE, _CLOCK_MONOTONIC, _NS = PORT.itemsize, 1, 1_000_000_000


@intrinsic  # type: ignore[untyped-decorator]
def _call(_: Any, address: Any, arguments: Any) -> Any:
    """Call the C function at ``address`` with a tuple of 64-bit integers; return its int."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        where, packed = values
        given = cgutils.unpack_tuple(builder, packed)
        function = ir.FunctionType(ir.IntType(32), [value.type for value in given])
        return builder.call(builder.inttoptr(where, function.as_pointer()), given)

    return types.int32(address, arguments), generate


@internal
def wait_for(link: Records, port: Any) -> None:
    """Sleep until a subscription has a message, for a limited time."""
    here = link[0]
    _call(here.clear, (here.wait_set,))
    _call(here.add, (here.wait_set, port.endpoint, 0))
    if _call(here.wait, (here.wait_set, here.timeout)):
        _call(here.reset_error, (0,))  # the time is over, or the take will fail as well


@internal
def take(link: Records, ports: Records, i: int) -> int:
    """
    Take the next message of port ``i`` and return the port's new state.

    `READ` if length, sequence number and sender are right.
    """
    here, port = link[0], ports[i]
    address = ports.ctypes.data + i * _PORT_SIZE
    if _call(here.take, (port.endpoint, address + _MESSAGE_AT, address + _INFO_AT, 0)):
        _call(here.reset_error, (0,))
        return EMPTY
    info, port.state = port.info, OTHER
    ours = not port.named or (info[GID] == port.sender[0] and info[GID + 1] == port.sender[1])
    if ours and info[NUMBER] == port.number + 1 and port.message[LENGTH] == port.size:
        _call(here.copy, (port.target, port.message[BUFFER], port.size))
        port.number, port.state = port.number + 1, READ
    return port.state


@internal
def collect(link: Records, ports: Records, count: int) -> bool:
    """Read the messages of a tick to the first ``count`` ports; False if one is not there."""
    for i in range(count):
        port = ports[i]
        found = EMPTY if port.last else take(link, ports, i)
        if found == EMPTY:
            wait_for(link, port)
            found = take(link, ports, i)
        if found != READ:
            return False
    return True


@internal
def accept(ports: Records, count: int) -> None:
    """Regard the messages of the first ``count`` ports as used."""
    for i in range(count):
        ports[i].state = EMPTY


@unlocked
def take_rows(link: Records, ports: Records, rows: NDArray[np.uint8]) -> int:
    """Take messages of port 0 to ``rows`` (n, size); return their number."""
    port, address = ports[0], rows.ctypes.data
    for i in range(len(rows)):
        port.target = address + i * port.size
        if take(link, ports, 0) != READ:
            return i
        port.state = EMPTY
    return len(rows)


def warm_up_blocks() -> None:
    """Compile `take_rows`, or load it from the cache."""
    take_rows(np.zeros(1, LINK), np.zeros(1, PORT), np.empty((0, 1), np.uint8))


@internal
def publish(link: Records, ports: Records, i: int) -> bool:
    """Publish the message of port ``i``; whether that has succeeded."""
    here = link[0]
    message = ports.ctypes.data + i * _PORT_SIZE + _MESSAGE_AT
    if _call(here.publish, (ports[i].endpoint, message, 0)):
        _call(here.reset_error, (0,))
        return False
    return True


@internal
def progress(link: Records) -> bool:
    """Note the time of a tick; whether a loop may begin the next one."""
    here = link[0]
    _call(here.clock, (_CLOCK_MONOTONIC, link.ctypes.data + _NOW_AT))
    now = here.now[0] * _NS + here.now[1]
    here.ticks += 1
    here.longest, here.since = max(here.longest, now - here.since), now
    return now < here.until and not here.stop
