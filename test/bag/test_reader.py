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

"""Bad bags: a typed error of one line, no traceback, no hang, no large memory."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
import io
import os
from pathlib import Path
import random
import resource
import struct
import subprocess
import sys
import tempfile
import zlib

from bagtools import read_all, small_config, small_messages, write_small
from flexarm_ros.bag.checks.verify import verify
from flexarm_ros.bag.definitions import definition
from flexarm_ros.bag.errors import (
    BagContentError,
    BagError,
    BagFormatError,
    BagLimitError,
)
from flexarm_ros.bag.mcap.mcapfile import MAGIC, McapFile, RECORD_INDEX
from flexarm_ros.bag.mcap.recover import recover
from flexarm_ros.bag.mcap.scan import MAX_CHUNK_DATA
from flexarm_ros.bag.metadata import read_counts
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.cli import main
from flexarm_ros.wire.topics import per_tick_topics
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import lz4.frame
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest
from repository import PATH
import zstandard

CONFIG = small_config(duration=0.1)
TOPICS = per_tick_topics(CONFIG)
FUZZ = settings(
    max_examples=40,
    deadline=5000,
    derandomize=True,
    report_multiple_bugs=False,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@cache
def sound_bytes() -> bytes:
    with tempfile.TemporaryDirectory() as directory:
        return write_small(Path(directory) / 'bag', CONFIG).read_bytes()


@pytest.fixture
def sound() -> bytes:
    return sound_bytes()


def test_all_forms_of_run(tmp_path: Path) -> None:
    (tmp_path / 'run').mkdir()
    file = write_small(tmp_path / 'run' / 'bag', CONFIG)
    for run in (tmp_path / 'run', tmp_path / 'run' / 'bag', file, str(file)):
        assert read_all(Path(run)) == 100
    (tmp_path / 'run' / 'bag' / 'other.mcap').write_bytes(b'')
    with pytest.raises(BagError, match=r'metadata.yaml does not name other.mcap'):
        BagReader(tmp_path / 'run')


@pytest.mark.parametrize(
    ('make', 'kind', 'match'),
    [
        (lambda p: p / 'absent', BagError, 'no such file'),
        (lambda p: p, BagError, 'no bag in it'),
        (lambda p: Path('/dev/zero'), BagError, 'no such file'),
        (lambda p: Path('x\0y'), BagError, 'x.*y'),
        (lambda p: Path('y' * 5000), BagError, 'yyy'),
    ],
)
def test_no_bag(
    make: Callable[[Path], Path], kind: type[BagError], match: str, tmp_path: Path
) -> None:
    with pytest.raises(kind, match=match):
        BagReader(make(tmp_path))


def test_not_mcap(tmp_path: Path) -> None:
    for content in (b'', b'text', bytes(1000), b'SQLite format 3\0' * 100):
        (tmp_path / 'x.mcap').write_bytes(content)
        with pytest.raises(BagFormatError, match='not an MCAP file'):
            BagReader(tmp_path / 'x.mcap')


def test_a_pipe_does_not_block(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'x.mcap')
    with pytest.raises(BagError):
        BagReader(tmp_path / 'x.mcap')


def test_bag_of_somebody_else(tmp_path: Path) -> None:
    with open(tmp_path / 'x.mcap', 'wb') as file:
        writer = Writer(file)
        writer.start('ros2')
        schema = writer.register_schema('std_msgs/msg/String', 'ros2msg', b'string data')
        channel = writer.register_channel('/chatter', 'cdr', schema)
        writer.add_message(channel, 5, b'\0\1\0\0', 5)
        writer.finish()
    with pytest.raises(BagContentError, match='no topic of a run in it, and no scenario'):
        BagReader(tmp_path / 'x.mcap')


def test_rewritten_by_another_tool(sound: bytes, tmp_path: Path) -> None:
    """Channels inside of chunks, attachments at the end, other ids: all in order."""
    from mcap.reader import make_reader

    reader = make_reader(io.BytesIO(sound))
    with open(tmp_path / 'x.mcap', 'wb') as file:
        writer = Writer(file, chunk_size=5000, compression=CompressionType.LZ4)
        writer.start('ros2', 'another tool')
        ids = {}
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            if channel.id not in ids:
                spare = writer.register_schema('spare', 'ros2msg', b'')
                writer.register_channel(f'/spare{channel.id}', 'cdr', spare)
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, 'cdr', kind)
            writer.add_message(
                ids[channel.id], message.log_time, message.data, message.publish_time,
                message.sequence,
            )  # fmt: skip
        for attachment in reader.iter_attachments():
            writer.add_attachment(0, 0, attachment.name, attachment.media_type, attachment.data)
        writer.finish()
    assert verify(tmp_path / 'x.mcap').same
    rescue = recover(tmp_path / 'x.mcap', tmp_path / 'new')
    assert rescue.status == 0
    assert verify(tmp_path / 'new').same


def altered_scenario(sound: bytes, old: bytes, new: bytes) -> bytes:
    """Replace text in the scenario's attachment and mend its length and checksum."""
    place = sound.index(b'scenario.yaml') - 29
    length = struct.unpack_from('<Q', sound, place + 1)[0]
    begin, end = place + 9, place + 9 + length
    body = sound[begin:end][:-4]
    start = body.index(b'/**:')
    text = body[start:].replace(old, new)
    assert text != body[start:]
    body = body[: start - 8] + struct.pack('<Q', len(text)) + text
    record = struct.pack('<BQ', 9, len(body) + 4) + body + struct.pack('<I', zlib.crc32(body))
    return sound[:place] + record + sound[end:]


@pytest.mark.parametrize(
    ('old', 'new', 'match'),
    [
        (b'control_period: 0.001', b'control_period: .nan', 'control_period'),
        (b'control_period: 0.001', b'control_period: 1e-10', 'control_period'),
        (b'duration: 0.1', b'duration: -1.0', 'duration'),
        (b'modes: 1', b'modes: 10000000', 'modes'),
        (b'kp: 150.79', b'kp: [1, 2]', 'kp'),
        (b'law: "fls"', b'law: "open_loop"\n    torque_file: "/etc/passwd"', 'torque'),
        (b'/**:', b'a: &a [x,x]\nb: &b [*a,*a]\n/**:', 'scenario'),
        (b'/**:', b'\xff\xfe', 'scenario'),
    ],
)
def test_hostile_scenarios(
    old: bytes, new: bytes, match: str, sound: bytes, tmp_path: Path
) -> None:
    (tmp_path / 'x.mcap').write_bytes(altered_scenario(sound, old, new))
    with pytest.raises(BagContentError, match=match) as caught:
        BagReader(tmp_path / 'x.mcap')
    assert '\n' not in str(caught.value)


def test_scenario_of_another_arm(sound: bytes, tmp_path: Path) -> None:
    """More modes than the messages have: told when they are decoded."""
    (tmp_path / 'x.mcap').write_bytes(altered_scenario(sound, b'modes: 1', b'modes: 3'))
    reader = BagReader(tmp_path / 'x.mcap')
    with pytest.raises(BagContentError, match='ticks 0 to 99'):
        list(reader.blocks())
    assert not verify(tmp_path / 'x.mcap').same


def file_with_chunk(directory: Path, body: bytes) -> Path:
    """Return a bag's file whose only chunk record has this content."""
    with BagWriter(directory, CONFIG) as writer:
        position = writer._file.size
    data = (directory / 'bag_0.mcap').read_bytes()[:position]
    path = directory / 'bag_0.mcap'
    path.write_bytes(data + struct.pack('<BQ', 6, len(body)) + body)
    return path


def chunk_body(size: int, name: bytes, packed: bytes) -> bytes:
    head = struct.pack('<QQQI', 10**9, 10**9, size, 0)
    return head + struct.pack('<I', len(name)) + name + struct.pack('<Q', len(packed)) + packed


def peak_memory(path: Path) -> int:
    """Return the growth of memory, MiB, of a process that reads, verifies and rescues."""
    code = (
        'import resource, sys, numpy\n'
        'from pathlib import Path\n'
        'from bagtools import read_all\n'
        'from flexarm_ros.bag.errors import BagError\n'
        'from flexarm_ros.bag.mcap.recover import recover\n'
        'before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n'
        'read_all(Path(sys.argv[1]))\n'
        "try: recover(sys.argv[1], sys.argv[1] + '.new')\n"
        'except BagError: pass\n'
        'print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) // 1024)\n'
    )
    answer = subprocess.run(
        [sys.executable, '-c', code, str(path)], check=True, capture_output=True, text=True,
        timeout=60, env={**os.environ, 'PYTHONPATH': PATH},
    )  # fmt: skip
    return int(answer.stdout)


@pytest.mark.parametrize('name', [b'zstd', b'lz4'])
@pytest.mark.parametrize('honest', [True, False])
def test_decompression_bomb(name: bytes, honest: bool, tmp_path: Path) -> None:
    """Two gigabytes of zeros in a few bytes: refused, with or without the true size."""
    size = 2 << 30
    if name == b'zstd':
        packer = zstandard.ZstdCompressor().compressobj()
        packed = b''.join(packer.compress(bytes(1 << 24)) for _ in range(128)) + packer.flush()
    else:
        frame = lz4.frame.LZ4FrameCompressor()
        packed = frame.begin()
        packed += b''.join(frame.compress(bytes(1 << 24)) for _ in range(128)) + frame.flush()
    said = size if honest else 1000
    path = file_with_chunk(tmp_path / 'bag', chunk_body(said, name, packed))
    reader = BagReader(path)
    if honest:
        with pytest.raises(BagLimitError, match=str(MAX_CHUNK_DATA)):
            list(reader.messages())
    else:
        assert list(reader.messages()) == []
        assert reader.damage is not None
    assert peak_memory(path) < 300


@pytest.mark.parametrize('length', [2**63, 2**40, 2**31, 200_000])
def test_lengths_beyond_the_file(length: int, tmp_path: Path) -> None:
    """A length field is never believed."""
    path = file_with_chunk(tmp_path / 'bag', b'')
    data = path.read_bytes()[:-9]
    for opcode in (1, 3, 4, 6, 9, 12):
        path.write_bytes(data + struct.pack('<BQ', opcode, length) + bytes(1000))
        reader = BagReader(path)
        assert list(reader.messages()) == []
        assert reader.damage is not None
    inner = struct.pack('<BQ', 5, length) + bytes(100)
    path.write_bytes(data)
    body = chunk_body(len(inner), b'', inner)
    path.write_bytes(data + struct.pack('<BQ', 6, len(body)) + body)
    assert list(BagReader(path).messages()) == []


def test_sparse_file_with_a_huge_record(tmp_path: Path) -> None:
    """Four gigabytes that a file really has are not read at one go."""
    path = file_with_chunk(tmp_path / 'bag', b'')
    data = path.read_bytes()[:-9]
    path.write_bytes(data + struct.pack('<BQ', 6, 4 << 30))
    os.truncate(path, (4 << 30) + 20_000)
    reader = BagReader(path)
    with pytest.raises(BagLimitError, match='record of 4294967296 bytes'):
        list(reader.messages())


@pytest.mark.parametrize(
    ('stamps', 'match'),
    [
        ([10**9 + 1], 'at no tick of the run'),
        ([10**9 - 10**6], 'at no tick of the run'),
        ([10**9 + 100 * 10**6], 'at no tick of the run'),
        ([2**64 - 1], 'at no tick of the run'),
        ([10**9, 10**9], 'tick 0 has two messages'),
        ([10**9 + 5 * 10**6, 10**9], 'tick 0 after tick 5'),
    ],
)
def test_messages_at_the_wrong_time(stamps: list[int], match: str, tmp_path: Path) -> None:
    directory = tmp_path / 'bag'
    directory.mkdir()
    file = McapFile(directory / 'x.mcap', 'none')
    ids = {t.type_name: file.add_schema(t.type_name, definition(t.type_name)[0]) for t in TOPICS}
    for topic in TOPICS:
        file.add_channel(topic.path, ids[topic.type_name], {})
    from flexarm_ros import scenario

    file.add_attachment('scenario.yaml', '', scenario.dump(CONFIG).encode(), 0)
    data = TOPICS[0].codec.encode(0)
    record = [struct.pack('<BQHIQQ', 5, 22 + len(data), 1, 1, s, s) + data for s in stamps]
    index = [(1, stamp, 43) for stamp in stamps]
    file.add_chunk(b''.join(record), np.array(index, RECORD_INDEX))
    file.finish()
    with pytest.raises(BagContentError, match=match):
        list(BagReader(directory).ticks())
    assert verify(directory).faults


def test_topic_missing(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag', CONFIG, topics=TOPICS[:5]):
        pass
    with pytest.raises(BagContentError, match='topic missing: /joint_command'):
        BagReader(tmp_path / 'bag')


@FUZZ
@given(
    cut=st.integers(0, 10**6),
    flips=st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), max_size=5),
    insert=st.tuples(st.integers(0, 10**6), st.binary(max_size=40)),
)
def test_fuzzed_bag(
    cut: int,
    flips: list[tuple[int, int]],
    insert: tuple[int, bytes],
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    """Whatever happens to a bag: it is read with the right messages, or refused."""
    data = bytearray(sound_bytes())
    for place, value in flips:
        data[place % len(data)] ^= value
    place = insert[0] % len(data)
    data[place:place] = insert[1]
    if cut % 3 == 0:
        end = cut % len(data)
        del data[end:]
    path = tmp_path_factory.mktemp('fuzz') / 'x.mcap'
    path.write_bytes(bytes(data))
    read_all(path)
    try:
        verdict = verify(path)
        assert not any('\n' in text for text in (*verdict.notes, *verdict.faults))
    except BagError:
        pass
    rescue = recover(path, path.with_suffix(''))
    if rescue.kept and rescue.planned:
        truth = small_messages(CONFIG)
        for tick, messages in BagReader(path.with_suffix('')).ticks():
            assert tuple(messages) == truth[tick]


@FUZZ
@given(data=st.binary(max_size=300))
def test_random_records(data: bytes, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp('random') / 'x.mcap'
    path.write_bytes(MAGIC + data)
    assert read_all(path) == -1
    assert recover(path, path.with_suffix('')).kept == 0


def test_metadata_yaml_of_any_kind(tmp_path: Path) -> None:
    path = tmp_path / 'metadata.yaml'
    assert read_counts(path) is None
    hostile = [
        b'',
        b'\xff\xfe\x00',
        b'[' * 100_000,
        b'{a: ' * 20_000,
        b'x' * (2 << 20),
        b'rosbag2_bagfile_information: 5',
        b'rosbag2_bagfile_information: {topics_with_message_count: [1, 2]}',
        b'rosbag2_bagfile_information: {topics_with_message_count: '
        b'[{topic_metadata: {name: a}, message_count: .inf}]}',
        b'a: &a [z,z,z,z,z,z,z,z,z]\n'
        + b''.join(b'%c: &%c [*%c,*%c,*%c,*%c]\n' % (i, i, i - 1, i - 1, i - 1, i - 1)
                   for i in range(ord('b'), ord('z'))),
        b"!!python/object/apply:os.system ['touch /tmp/owned']",
    ]  # fmt: skip
    for content in hostile:
        path.write_bytes(content)
        with pytest.raises(BagContentError) as caught:
            read_counts(path)
        assert '\n' not in str(caught.value)


@FUZZ
@given(
    text=st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
        lambda inner: (
            st.lists(inner, max_size=3)
            | st.dictionaries(
                st.sampled_from(
                    [
                        'rosbag2_bagfile_information',
                        'topics_with_message_count',
                        'topic_metadata',
                        'name',
                        'message_count',
                    ]
                ),  # fmt: skip
                inner,
                max_size=3,
            )
        ),
        max_leaves=12,
    )
)
def test_fuzzed_metadata_yaml(text: object, tmp_path_factory: pytest.TempPathFactory) -> None:
    import yaml

    path = tmp_path_factory.mktemp('yaml') / 'metadata.yaml'
    path.write_text(yaml.safe_dump(text))
    try:
        assert isinstance(read_counts(path), dict)
    except BagContentError as error:
        assert '\n' not in str(error)


def test_random_damage_reaches_the_user_as_one_line(
    sound: bytes, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    generator = random.Random(11)
    for round_number in range(25):
        data = bytearray(sound)
        for _ in range(generator.randrange(1, 200)):
            data[generator.randrange(len(data))] = generator.randrange(256)
        path = tmp_path / f'x{round_number}.mcap'
        path.write_bytes(bytes(data))
        assert main(['verify', str(path)]) in (0, 1)
        assert main(['recover', str(path), '--out', str(path.with_suffix(''))]) in (0, 1, 3)
        said = capsys.readouterr()
        assert 'Traceback' not in said.err + said.out
        assert 'internal error' not in said.err
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 2 << 20
