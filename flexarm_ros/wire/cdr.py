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
Fixed-layout CDR codecs of the messages of a run.

Every message of a run has the same names, frames and array lengths at every tick, so its CDR
image differs only in the stamp and in a few sequences of float64.  A codec builds that image once
and then only copies numbers: about a microsecond per message, against tens for a general
serializer.

Layout: OMG CDR version 1, little endian, after the four bytes of the encapsulation header
(00 01 00 00), as sent by ROS 2 middleware.  Alignment counts from the end of that header.
Padding is written as zeros.  Other serializers (such as Fast CDR below rclpy) leave old memory
content in the padding and may append bytes, so decoding ignores the padding and anything after
the message.

Numbers pass unchanged, including NaN and infinities; the receiver has to check them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import accumulate
from operator import itemgetter
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
ByteArray = NDArray[np.uint8]

HEADER = b'\x00\x01\x00\x00'
_NS = 1_000_000_000
_STAMP_OFFSET = 4
_STAMP_END = 12


class _Image:
    """Builds a CDR image: constant bytes, padding and slots for float64 runs."""

    def __init__(self) -> None:
        self.data = bytearray(HEADER)
        self.fixed = bytearray(b'\x01' * len(HEADER))  # 1: must match, 0: padding or a slot
        self.runs: list[tuple[int, int]] = []  # (offset, number of float64)

    def align(self, size: int) -> None:
        gap = -(len(self.data) - len(HEADER)) % size
        self.data += bytes(gap)
        self.fixed += bytes(gap)

    def constant(self, code: str, value: float) -> None:
        raw = struct.pack('<' + code, value)
        self.align(len(raw))
        self.data += raw
        self.fixed += b'\x01' * len(raw)

    def text(self, value: str) -> None:
        raw = value.encode() + b'\x00'
        self.constant('I', len(raw))
        self.data += raw
        self.fixed += b'\x01' * len(raw)

    def stamp(self) -> None:
        self.data += bytes(_STAMP_END - _STAMP_OFFSET)
        self.fixed += bytes(_STAMP_END - _STAMP_OFFSET)

    def slots(self, count: int) -> None:
        """Add a run of ``count`` float64 (aligned by the first of them)."""
        if count:
            self.align(8)
            self.runs.append((len(self.data), count))
            self.data += bytes(8 * count)
            self.fixed += bytes(8 * count)

    def sequence(self, count: int) -> None:
        """Add a ``float64[]`` of ``count`` values; an empty one has only its length."""
        self.constant('I', count)
        self.slots(count)


class Codec:
    """
    One message type with one fixed layout.

    ``type_name`` is the ROS 2 type, ``fields`` names the values in order
    (``position.shoulder``, ``pose.position.x``, ...), ``size`` is the length
    of an encoded message in bytes.
    """

    def __init__(self, type_name: str, fields: Sequence[str], image: _Image) -> None:
        self.type_name = type_name
        self.fields = tuple(fields)
        self.size = len(image.data)
        self.template = bytes(image.data)
        self.runs = tuple(image.runs)
        """Offset in bytes and length of each run of float64."""
        *self._starts, slots = accumulate((count for _, count in image.runs), initial=0)
        if slots != len(self.fields):
            raise ValueError(f'{type_name}: {slots} slots for {len(self.fields)} fields')
        self._compile(image)
        self._constant = np.frombuffer(self.template, np.uint8)
        self.fixed = np.frombuffer(bytes(0xFF * byte for byte in image.fixed), np.uint8)
        """Mask of the constant bytes, which every message of this layout has."""
        runs = {f'run{i}': (f'({count},)<f8', at) for i, (at, count) in enumerate(self.runs)}
        parts = {'sec': ('<i4', _STAMP_OFFSET), 'nanosec': ('<u4', _STAMP_OFFSET + 4), **runs}
        self.record = np.dtype({
            'names': list(parts), 'formats': [form for form, _ in parts.values()],
            'offsets': [at for _, at in parts.values()], 'itemsize': self.size,
        })  # fmt: skip

    def _compile(self, image: _Image) -> None:
        """
        Create the `struct.Struct` of the message and the index of its items.

        Items are the constant spans, sec and nanosec, and the fields.  Padding is not an item:
        it is packed as zeros and skipped when unpacking.
        """
        self._spans = _spans(image.fixed)
        items = [(start, end, f'{end - start}s') for start, end in self._spans]
        items.append((_STAMP_OFFSET, _STAMP_END, 'iI'))
        items += [(at, at + 8 * count, f'{count}d') for at, count in image.runs]
        form, kinds, last = '<', '', 0
        for start, end, code in sorted(items):
            form += f'{start - last}x{code}'
            kinds += {'s': 'c', 'I': 'ss', 'd': 'v' * ((end - start) // 8)}[code[-1]]
            last = end
        self._struct = struct.Struct(f'{form}{self.size - last}x')
        places = {kind: [i for i, k in enumerate(kinds) if k == kind] for kind in 'csv'}
        self._pick_constants, self._pick_values = _pick(places['c']), _pick(places['v'])
        self._sec, self._nanosec = places['s']
        self._constants = self._pick_constants(self._struct.unpack(self.template))
        order = np.argsort(places['c'] + places['s'] + places['v'])
        self._order = _pick(order.tolist())

    def encode(self, stamp_ns: int, *values: float) -> bytes:
        """Return the message with this stamp and ``values`` in order of ``fields``."""
        if len(values) != len(self.fields):
            raise ValueError(f'{self.type_name}: {len(values)} values for {len(self.fields)}')
        items = (*self._constants, *divmod(stamp_ns, _NS), *values)
        return self._struct.pack(*self._order(items))

    def decode(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """Return ``(stamp_ns, values)``; ValueError if the layout differs."""
        if len(data) < self.size:
            raise ValueError(f'{self.type_name}: {len(data)} bytes, at least {self.size} needed')
        items = self._struct.unpack_from(data)
        if self._pick_constants(items) != self._constants:
            raise ValueError(f'{self.type_name}: another layout at byte {self._differs_at(data)}')
        return items[self._sec] * _NS + items[self._nanosec], self._pick_values(items)

    def _differs_at(self, data: bytes) -> int:
        """Return the start of the first constant span that differs."""
        return next(a for a, b in self._spans if data[a:b] != self.template[a:b])

    def decode_any(self, data: bytes) -> tuple[int, tuple[float, ...]]:
        """
        As :meth:`decode`, for any valid layout that holds the fields.

        Slower (tens of microseconds), for messages that :meth:`decode` rejects: big endian,
        another order of names, further joints, other frames.  Raises ValueError if the bytes
        are not such a message or a field is missing.
        """
        try:
            return self.decode(data)
        except ValueError:
            from flexarm_ros.wire import generic_decode

            return generic_decode.values(self.type_name, data, self.fields)

    def prepare_any(self) -> None:
        """Import now (0.1 s) what `decode_any` needs for the first message of another layout."""
        from flexarm_ros.wire import generic_decode

        generic_decode.values(self.type_name, self.template, self.fields)

    def fill(self, records: NDArray[np.void], stamps: IntArray, values: FloatArray) -> None:
        """
        Set the stamps ``(n,)``, ns, and the values ``(n, fields)`` of many messages, as `encode`.

        ``records`` ``(n,)`` are of the type ``record`` and hold the bytes of ``template``.
        """
        records['sec'] = seconds = stamps // _NS
        records['nanosec'] = stamps - seconds * _NS
        for i, ((_, count), start) in enumerate(zip(self.runs, self._starts, strict=True)):
            records[f'run{i}'] = values[:, start : start + count]

    def decode_block(self, messages: Sequence[bytes]) -> tuple[IntArray, FloatArray]:
        """
        Decode many messages.

        Returns stamps, shape ``(n,)``, ns, and values, shape ``(n, fields)``.
        Messages of another layout are decoded one by one by :meth:`decode_any`.
        """
        count = len(messages)
        whole = b''.join(messages)
        if len(whole) == count * self.size and set(map(len, messages)) <= {self.size}:
            rows = np.frombuffer(whole, np.uint8).reshape(count, self.size)
            if not ((rows ^ self._constant) & self.fixed).any():
                return self._fields_of(np.frombuffer(whole, self.record))
        stamps, values = np.empty(count, np.int64), np.empty((count, len(self.fields)))
        for i, data in enumerate(messages):
            stamps[i], values[i] = self.decode_any(data)
        return stamps, values

    def _fields_of(self, records: NDArray[np.void]) -> tuple[IntArray, FloatArray]:
        """Return stamps and values of messages as records of `_record`."""
        values = np.empty((len(records), len(self.fields)))
        for i, start in enumerate(self._starts):
            run = records[f'run{i}']
            end = start + run.shape[1]
            values[:, start:end] = run
        return records['sec'].astype(np.int64) * _NS + records['nanosec'], values


def _pick(places: Sequence[int]) -> Callable[[tuple[Any, ...]], tuple[Any, ...]]:
    """Return a function that takes the items at these indices as a tuple."""
    if len(places) > 1:
        return itemgetter(*places)
    return itemgetter(slice(places[0], places[0] + 1) if places else slice(0))


def _spans(fixed: bytearray) -> list[tuple[int, int]]:
    """Return the ``(start, end)`` of each run of ones."""
    edges = np.flatnonzero(np.diff(np.frombuffer(b'\x00' + bytes(fixed) + b'\x00', np.int8)))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


class JointStateCodec(Codec):
    """
    ``sensor_msgs/msg/JointState`` with these names and this frame.

    Values: the arrays named in ``fields`` (of ``position``, ``velocity``,
    ``effort``) in sequence, each as long as ``names``; the other
    arrays are empty.
    """

    def __init__(
        self,
        names: Sequence[str],
        frame_id: str,
        fields: Sequence[str] = ('position', 'velocity'),
    ) -> None:
        image = _Image()
        image.stamp()
        image.text(frame_id)
        image.constant('I', len(names))
        for name in names:
            image.text(name)
        labels = []
        for array in ('position', 'velocity', 'effort'):
            image.sequence(len(names) if array in fields else 0)
            labels += [f'{array}.{name}' for name in names if array in fields]
        super().__init__('sensor_msgs/msg/JointState', labels, image)
        self.names = tuple(names)


class OdometryCodec(Codec):
    """
    ``nav_msgs/msg/Odometry`` of a point in the plane.

    Values: x, y (m), vx, vy (m/s).  Orientation is the identity.  The
    covariance of position has ``position_variance`` (m^2) for x and y and is
    otherwise 0.
    """

    def __init__(self, frame_id: str, child_frame_id: str, position_variance: float = 0.0) -> None:
        image = _Image()
        image.stamp()
        image.text(frame_id)
        image.text(child_frame_id)
        image.slots(2)
        for value in (0.0, 0.0, 0.0, 0.0, 1.0):  # z, then the quaternion x y z w
            image.constant('d', value)
        for i in range(36):
            image.constant('d', position_variance if i in (0, 7) else 0.0)
        image.slots(2)
        for _ in range(4 + 36):  # linear z, angular x y z, covariance
            image.constant('d', 0.0)
        labels = ('pose.position.x', 'pose.position.y', 'twist.linear.x', 'twist.linear.y')
        super().__init__('nav_msgs/msg/Odometry', labels, image)


class WrenchCodec(Codec):
    """``geometry_msgs/msg/WrenchStamped``: fx, fy (N) in the plane, no torque."""

    def __init__(self, frame_id: str) -> None:
        image = _Image()
        image.stamp()
        image.text(frame_id)
        image.slots(2)
        for _ in range(4):  # force z, torque
            image.constant('d', 0.0)
        labels = ('wrench.force.x', 'wrench.force.y')
        super().__init__('geometry_msgs/msg/WrenchStamped', labels, image)


class MassCodec(Codec):
    """``geometry_msgs/msg/InertiaStamped``: a mass (kg) at the frame's origin, no inertia."""

    def __init__(self, frame_id: str) -> None:
        image = _Image()
        image.stamp()
        image.text(frame_id)
        image.slots(1)
        for _ in range(3 + 6):  # centre of mass, tensor of inertia
            image.constant('d', 0.0)
        super().__init__('geometry_msgs/msg/InertiaStamped', ('inertia.m',), image)


class ImuCodec(Codec):
    """
    ``sensor_msgs/msg/Imu``: rate of turn about z (rad/s), acceleration along x, y (m/s^2).

    There is no orientation: element 0 of its covariance is -1, as the message definition requires.
    The other covariances have the variances of the measured axes, and are 0 (unknown) where these
    are 0.
    """

    def __init__(self, frame_id: str, gyro_variance: float, accel_variance: float) -> None:
        image = _Image()
        image.stamp()
        image.text(frame_id)
        for value in (0.0, 0.0, 0.0, 1.0, -1.0, *(0.0,) * 8):
            image.constant('d', value)
        for _ in range(2):  # rates of turn about x, y
            image.constant('d', 0.0)
        image.slots(1)
        for i in range(9):
            image.constant('d', gyro_variance if i == 8 else 0.0)
        image.slots(2)
        image.constant('d', 0.0)
        for i in range(9):
            image.constant('d', accel_variance if i in (0, 4) else 0.0)
        labels = ('angular_velocity.z', 'linear_acceleration.x', 'linear_acceleration.y')
        super().__init__('sensor_msgs/msg/Imu', labels, image)


class ClockCodec(Codec):
    """``rosgraph_msgs/msg/Clock``: only a stamp."""

    def __init__(self) -> None:
        image = _Image()
        image.stamp()
        super().__init__('rosgraph_msgs/msg/Clock', (), image)
