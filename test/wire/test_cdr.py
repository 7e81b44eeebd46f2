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

"""Message codecs against rclpy and against rosbags' type store."""

from __future__ import annotations

import contextlib
import math
import struct
import subprocess
import sys
from typing import Any

from flexarm_ros.core.parameters.sections import PlantParameters, RunConfig, TipSensorParameters
from flexarm_ros.wire.cdr import ClockCodec, Codec, JointStateCodec, OdometryCodec
from flexarm_ros.wire.generic_decode import typestore
from flexarm_ros.wire.topics import COMMAND, per_tick_topics
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from repository import ROOT

CODECS: list[Codec] = [
    *(topic.codec for topic in per_tick_topics(RunConfig())),
    *(topic.codec for topic in per_tick_topics(RunConfig(plant=PlantParameters(modes=6)))),
    per_tick_topics(RunConfig(tip_sensor=TipSensorParameters(noise_std=0.01)))[3].codec,
    JointStateCodec(('a', 'bc', 'def', 'ghij', ''), 'x', ('position', 'velocity', 'effort')),
    JointStateCodec((), '', ()),
    OdometryCodec('', 'c' * 9),
]
SPECIAL = [0.0, -0.0, 1e-310, 5e-324, math.pi, -1e308, math.inf, -math.inf, math.nan]


def numbers(count: int, shift: int = 0) -> list[float]:
    return [SPECIAL[(i + shift) % len(SPECIAL)] + i for i in range(count)]


def same(one: Any, other: Any) -> bool:
    return np.array(one, float).tobytes() == np.array(other, float).tobytes()


@pytest.mark.parametrize('codec', CODECS)
def test_bytes_are_those_of_the_type_store(codec: Codec) -> None:
    values = numbers(len(codec.fields))
    data = codec.encode(1_234_567_890_123, *values)
    message = typestore().deserialize_cdr(data, codec.type_name)
    assert bytes(typestore().serialize_cdr(message, codec.type_name)) == data
    stamped: Any = message
    stamp = stamped.clock if isinstance(codec, ClockCodec) else stamped.header.stamp
    assert (stamp.sec, stamp.nanosec) == (1234, 567_890_123)
    assert len(data) == codec.size


@pytest.mark.parametrize('codec', CODECS)
def test_rclpy_reads_and_writes_the_same(codec: Codec) -> None:
    """Fast CDR leaves padding undefined and may append bytes; all else must be equal."""
    serialization = pytest.importorskip('rclpy.serialization')
    from importlib import import_module

    package, _, name = codec.type_name.split('/')
    kind = getattr(import_module(f'{package}.msg'), name)
    values = numbers(len(codec.fields), 3)
    data = codec.encode(5_000_000_007, *values)
    theirs = serialization.serialize_message(serialization.deserialize_message(data, kind))
    stamp, read = codec.decode(theirs)
    assert stamp == 5_000_000_007
    assert same(read, values)
    differing = [i for i in range(codec.size) if data[i] != theirs[i]]
    probe = codec.encode(0, *numbers(len(codec.fields), 1))
    fixed = {i for start, end in codec._spans for i in range(start, end)}
    assert not fixed & set(differing)
    assert all(probe[i] == 0 and data[i] == 0 for i in differing)


@pytest.mark.parametrize('codec', CODECS)
def test_round_trip(codec: Codec) -> None:
    values = numbers(len(codec.fields), 5)
    stamp, read = codec.decode(codec.encode(987_654_321_000, *values))
    assert stamp == 987_654_321_000
    assert same(read, values)


@pytest.mark.parametrize('codec', CODECS)
def test_block_is_message_by_message(codec: Codec) -> None:
    stamps = np.array([0, 1, 999_999_999, 1_000_000_000, 2**31 * 10**9 - 1], np.int64)
    values = np.array([numbers(len(codec.fields), i) for i in range(len(stamps))]).reshape(
        len(stamps), len(codec.fields)
    )
    whole = bytearray(codec.template * len(stamps))
    codec.fill(np.frombuffer(whole, codec.record), stamps, values)
    messages = [bytes(whole[i : i + codec.size]) for i in range(0, len(whole), codec.size)]
    assert messages == [
        codec.encode(int(s), *v) for s, v in zip(stamps, values.tolist(), strict=True)
    ]
    read_stamps, read_values = codec.decode_block(messages)
    assert read_stamps.tolist() == stamps.tolist()
    assert same(read_values, values)
    empty_stamps, empty_values = codec.decode_block([])
    assert empty_stamps.shape == (0,)
    assert empty_values.shape == (0, len(codec.fields))


def test_block_with_a_foreign_message_in_it() -> None:
    codec = JointStateCodec(('shoulder', 'elbow'), 'base', ('effort',))
    other = JointStateCodec(('elbow', 'x', 'shoulder'), '', ('effort',))
    stamps, values = codec.decode_block(
        [codec.encode(1, 1.0, 2.0), other.encode(2, 3.0, 9.0, 4.0), codec.encode(3, 5.0, 6.0)]
    )
    assert stamps.tolist() == [1, 2, 3]
    assert values.tolist() == [[1.0, 2.0], [4.0, 3.0], [5.0, 6.0]]


def test_foreign_layouts() -> None:
    """Order of names, further joints, other frame, big endian, surplus bytes."""
    codec = per_tick_topics(RunConfig())[COMMAND].codec
    data = codec.encode(7_000_000_001, 1.5, -2.5)
    assert codec.decode(data + b'junk' * 2) == (7_000_000_001, (1.5, -2.5))
    other = JointStateCodec(('elbow', 'wrist', 'shoulder'), 'world', ('velocity', 'effort'))
    foreign = other.encode(7_000_000_001, 0.0, 0.0, 0.0, -2.5, 9.0, 1.5)
    with pytest.raises(ValueError, match='another layout'):
        codec.decode(foreign)
    assert codec.decode_any(foreign) == (7_000_000_001, (1.5, -2.5))
    assert codec.decode_any(foreign + b'\xff' * 8) == (7_000_000_001, (1.5, -2.5))
    nameless = JointStateCodec((), 'base').encode(7_000_000_001)
    with pytest.raises(ValueError, match=r"JointState names \[\]: 'shoulder' needed once"):
        codec.decode_any(nameless)
    store = typestore()
    message = store.deserialize_cdr(foreign, codec.type_name)
    big = bytes(store.serialize_cdr(message, codec.type_name, little_endian=False))
    assert big[1] == 0
    assert codec.decode_any(big) == (7_000_000_001, (1.5, -2.5))


PREPARED = """
import sys
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.wire.cdr import JointStateCodec
from flexarm_ros.wire.topics import per_tick_topics

for topic in per_tick_topics(RunConfig()):
    topic.codec.prepare_any()
before = set(sys.modules)
command = next(t for t in per_tick_topics(RunConfig()) if t.name == 'joint_command')
names = command.codec.names[::-1]
foreign = JointStateCodec(names, 'world', ('effort',)).encode(7, 1.5, -2.5)
assert command.codec.decode_any(foreign) == (7, (-2.5, 1.5))
print(sorted(set(sys.modules) - before))
"""
"""Prints what the first message of another layout imports after the preparation for it."""


def test_what_another_layout_takes_is_loaded_beforehand() -> None:
    done = subprocess.run(
        [sys.executable, '-c', PREPARED], capture_output=True, text=True, check=False, cwd=ROOT
    )
    assert (done.returncode, done.stdout) == (0, '[]\n'), done.stderr


@pytest.mark.parametrize(
    ('names', 'fields'),
    [
        (('elbow',), ('effort',)),
        (('shoulder', 'elbow'), ('position',)),
        (('shoulder', 'elbow', 'shoulder'), ('effort',)),
        ((), ()),
    ],
)
def test_foreign_message_without_what_is_needed(
    names: tuple[str, ...], fields: tuple[str, ...]
) -> None:
    codec = per_tick_topics(RunConfig())[COMMAND].codec
    other = JointStateCodec(names, 'base', fields)
    with pytest.raises(ValueError, match='JointState'):
        codec.decode_any(other.encode(0, *numbers(len(other.fields))))


@settings(max_examples=300, deadline=None)
@given(data=st.binary(max_size=200), pick=st.integers(0, len(CODECS) - 1))
def test_any_bytes_decode_or_raise_value_error(data: bytes, pick: int) -> None:
    for candidate in (data, b'\x00\x01\x00\x00' + data, b'\x00\x00\x00\x00' + data):
        with contextlib.suppress(ValueError):
            CODECS[pick].decode_any(candidate)


@settings(max_examples=200, deadline=None)
@given(place=st.integers(0, 83), bit=st.integers(0, 7), length=st.integers(0, 84))
def test_damaged_commands(place: int, bit: int, length: int) -> None:
    codec = per_tick_topics(RunConfig())[COMMAND].codec
    data = bytearray(codec.encode(1, 1.0, 2.0))
    data[place] ^= 1 << bit
    for candidate in (bytes(data), bytes(data[:length])):
        try:
            _, values = codec.decode_any(candidate)
        except ValueError:
            continue
        assert len(values) == 2


def test_wrong_number_of_values() -> None:
    codec = OdometryCodec('base', 'tip')
    with pytest.raises(ValueError, match='3 values for 4'):
        codec.encode(0, 1.0, 2.0, 3.0)


def test_variance_is_in_the_covariance() -> None:
    codec = per_tick_topics(RunConfig(tip_sensor=TipSensorParameters(noise_std=0.5)))[3].codec
    message: Any = typestore().deserialize_cdr(codec.encode(0, 1, 2, 3, 4), codec.type_name)
    covariance = np.zeros((6, 6))
    covariance[0, 0] = covariance[1, 1] = 0.25
    assert message.pose.covariance.tolist() == covariance.ravel().tolist()
    assert message.pose.pose.orientation.w == 1.0
    assert (message.header.frame_id, message.child_frame_id) == ('base', 'tip_sensor')
    assert struct.calcsize('<d') * 72 < codec.size
