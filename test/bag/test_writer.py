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

"""What the recorder writes: opened by other people's readers, byte for byte reproducible."""

from __future__ import annotations

import itertools
import json
import os
from pathlib import Path
import random
import subprocess
import sys
from typing import Any

from bagtools import OPEN_LOOP, small_config, small_messages, write_small
from flexarm_ros import scenario
from flexarm_ros.bag.errors import BagContentError, BagError, BagExistsError
from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.reading.blocks import decode_ticks
from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.run.loop import ClosedLoop
from flexarm_ros.wire.topics import COMMAND, JOINT_STATES, per_tick_topics, STATE, TIP
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
import numpy as np
import pytest
from repository import PATH, ROOT
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosReliability
import yaml

CONFIG = small_config('encoder.latency=0.0005')
TOPICS = per_tick_topics(CONFIG)
NAMES = [topic.path for topic in TOPICS]
TICKS = 300
T0 = 10**9


@pytest.fixture(scope='module')
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('writer') / 'bag'
    write_small(directory, CONFIG)
    return directory


def write_in_order(directory: Path, order: Any) -> bytes:
    """Write the messages of the run one by one, in the order of ``(tick, topic)``."""
    truth = small_messages(CONFIG)
    with BagWriter(directory, CONFIG) as writer:
        for tick, topic in order:
            writer.write(topic, tick, truth[tick][topic])
    return (directory / 'bag_0.mcap').read_bytes()


def test_rosbags_reads_it(bag: Path) -> None:
    with AnyReader([bag]) as reader:
        assert reader.message_count == 6 * TICKS
        assert reader.start_time == T0
        assert reader.end_time == T0 + (TICKS - 1) * 10**6 + 1  # rosbags counts the end in
        assert {c.topic: c.msgcount for c in reader.connections} == dict.fromkeys(NAMES, TICKS)
        for connection in reader.connections:
            (qos,) = connection.ext.offered_qos_profiles  # type: ignore[union-attr]
            assert qos.reliability == QosReliability.RELIABLE
        seen = list(itertools.islice(reader.messages(), 6 * 7, 6 * 8))
        assert [c.topic for c, _, _ in seen] == NAMES
        assert {stamp for _, stamp, _ in seen} == {T0 + 7 * 10**6}
        commands = [c for c in reader.connections if c.topic == '/joint_command']
        message: Any = reader.deserialize(next(reader.messages(commands))[2], commands[0].msgtype)
        assert message.name == ['shoulder', 'elbow']
        assert len(message.effort) == 2
        assert len(message.position) == 0


def test_mcap_reads_it(bag: Path) -> None:
    with open(bag / 'bag_0.mcap', 'rb') as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert reader.get_header().profile == 'ros2'
        assert summary is not None and summary.statistics is not None
        assert summary.statistics.message_count == 6 * TICKS
        assert summary.statistics.chunk_count == len(summary.chunk_indexes) == 6
        assert {c.message_encoding for c in summary.channels.values()} == {'cdr'}
        assert {s.encoding for s in summary.schemas.values()} == {'ros2msg'}
        loop = ClosedLoop(CONFIG)
        for tick, group in itertools.groupby(
            reader.iter_decoded_messages(), lambda item: item.message.sequence
        ):
            items = list(group)
            record = loop.tick()
            assert record is not None and record.k == tick - 1
            assert [item.channel.topic for item in items] == NAMES
            stamp = T0 + record.k * 10**6
            for item in items:
                assert item.message.log_time == item.message.publish_time == stamp
            decoded = [item.decoded_message for item in items]
            assert decoded[0].clock.sec * 10**9 + decoded[0].clock.nanosec == stamp
            state = decoded[STATE]
            assert state.name[:2] == ['shoulder', 'elbow']
            assert state.name[-2:] == ['link1', 'link2']
            assert list(state.position) == [*record.q, *record.deflections[:2]]
            assert list(state.velocity) == [*record.qd, *record.deflections[2:]]
            measured = decoded[JOINT_STATES].header.stamp
            assert measured.sec * 10**9 + measured.nanosec == stamp - 500_000
            assert decoded[TIP].child_frame_id == 'tip_sensor'
            assert decoded[TIP].pose.pose.position.x == record.tip[1]
            assert tuple(decoded[COMMAND].effort) == record.torque
        assert loop.k == TICKS


def test_random_access_by_the_index(bag: Path) -> None:
    with open(bag / 'bag_0.mcap', 'rb') as file:
        found = list(
            make_reader(file).iter_messages(
                ['/reference'], starting_at=T0 + 123 * 10**6, ending_before=T0 + 126 * 10**6
            )
        )
    assert [message.sequence for _, _, message in found] == [124, 125, 126]
    assert {channel.topic for _, channel, _ in found} == {'/reference'}


def test_schemas_are_complete_and_hashed_as_rosbag2_does(bag: Path) -> None:
    share = Path(sys.prefix) / 'share'
    with open(bag / 'bag_0.mcap', 'rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    for schema in summary.schemas.values():
        text = schema.data.decode()
        nested = {line[5:] for line in text.splitlines() if line.startswith('MSG: ')}
        used = {
            word
            for line in text.splitlines()
            if not line.startswith(('MSG:', '='))
            for word in [line.split('[')[0].split(' ')[0]]
            if '/' in word
        }
        assert used <= nested
    for channel in summary.channels.values():
        package, _, name = summary.schemas[channel.schema_id].name.split('/')
        described = share / package / 'msg' / f'{name}.json'
        if described.exists():
            hashes = json.loads(described.read_text())['type_hashes']
            wanted = {entry['type_name']: entry['hash_string'] for entry in hashes}
            assert channel.metadata['topic_type_hash'] == wanted[f'{package}/msg/{name}']
        profiles = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        assert profiles[0]['reliability'] == 'reliable'
        assert profiles[0]['durability'] == 'volatile'


def test_metadata_yaml(bag: Path) -> None:
    information = yaml.safe_load((bag / 'metadata.yaml').read_text())[
        'rosbag2_bagfile_information'
    ]
    assert information['version'] == 9
    assert information['storage_identifier'] == 'mcap'
    assert information['relative_file_paths'] == ['bag_0.mcap']
    assert information['duration']['nanoseconds'] == (TICKS - 1) * 10**6
    assert information['starting_time']['nanoseconds_since_epoch'] == T0
    assert information['message_count'] == 6 * TICKS
    topics = information['topics_with_message_count']
    assert [topic['topic_metadata']['name'] for topic in topics] == NAMES
    assert {topic['message_count'] for topic in topics} == {TICKS}
    with open(bag / 'bag_0.mcap', 'rb') as file:
        inside = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
    assert yaml.safe_load(inside['rosbag2']['serialized_metadata']) == information


def test_the_bag_alone_holds_the_scenario(tmp_path: Path) -> None:
    config = scenario.from_dict(
        {
            'run': {'duration': 0.05, 'seed': 7},
            'plant': {'modes': 2, 'initial_position': [0.1, 1 / 3]},
            'controller': {'law': 'open_loop', 'torque_file': 'somewhere/rows.csv'},
            'recorder': {'compression': 'lz4'},
        },
        OPEN_LOOP,
    )
    origin = Provenance('mine', {'numpy': '9'}, 'abc', 'def', ('controller',))
    with BagWriter(tmp_path / 'bag', config, origin):
        pass
    reader = BagReader(tmp_path / 'bag')
    assert reader.provenance == origin
    assert reader.config.torques == OPEN_LOOP
    assert reader.config.controller.torque_file == 'torques.csv'
    assert reader.config.plant == config.plant
    assert reader.config.run == config.run
    with open(tmp_path / 'bag' / 'bag_0.mcap', 'rb') as file:
        inside = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
    assert (
        inside['flexarm_ros.parameters']['plant.initial_position'] == '[0.1, 0.3333333333333333]'
    )
    assert inside['flexarm_ros.versions'] == {'numpy': '9'}


@pytest.mark.parametrize('order', ['by tick', 'backwards in a tick', 'by topic', 'shuffled'])
def test_same_bytes_whatever_the_order_of_arrival(order: str, bag: Path, tmp_path: Path) -> None:
    """One message at a time, in any order across topics, gives the bytes of whole blocks."""
    everything = [(tick, topic) for tick in range(TICKS) for topic in range(6)]
    if order == 'backwards in a tick':
        everything = [(tick, 5 - topic) for tick, topic in everything]
    elif order == 'by topic':
        everything = [(tick, topic) for topic in range(6) for tick in range(TICKS)]
    elif order == 'shuffled':
        random.Random(4).shuffle(everything)
    assert write_in_order(tmp_path / 'bag', everything) == (bag / 'bag_0.mcap').read_bytes()
    assert (tmp_path / 'bag' / 'metadata.yaml').read_bytes() == (
        bag / 'metadata.yaml'
    ).read_bytes()


@pytest.mark.parametrize('size', [1, 7, 50, 300])
def test_same_bytes_whatever_the_blocks(size: int, bag: Path, tmp_path: Path) -> None:
    truth = small_messages(CONFIG)
    with BagWriter(tmp_path / 'bag', CONFIG) as writer:
        for first in range(0, TICKS, size):
            writer.write_block(decode_ticks(TOPICS, first, truth[first:][:size]))
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_bytes() == (bag / 'bag_0.mcap').read_bytes()


def test_same_bytes_from_another_process_without_ros(tmp_path: Path) -> None:
    """Another user's environment, another directory, no ROS to import: the same file."""
    code = (
        "import sys; sys.modules['rclpy'] = sys.modules['sensor_msgs'] = None\n"
        'from pathlib import Path; from bagtools import *\n'
        "write_small(Path('bag'), small_config('encoder.latency=0.0005'), Provenance('x'))\n"
    )
    here = write_small(tmp_path / 'here', CONFIG, Provenance('x')).read_bytes()
    environment = {
        'PATH': os.environ['PATH'],
        'PYTHONPATH': PATH,
        'USER': 'somebody', 'HOME': str(tmp_path), 'TZ': 'Asia/Tokyo', 'LANG': 'C',
        'PYTHONHASHSEED': '77',
    }  # fmt: skip
    for key in ('LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE'):
        if key in os.environ:
            environment[key] = os.environ[key]
    subprocess.run(
        [sys.executable, '-c', code], cwd=tmp_path, env=environment, check=True, timeout=300
    )
    assert (tmp_path / 'bag' / 'bag_0.mcap').read_bytes() == here


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
@pytest.mark.parametrize('chunk', [0.0001, 0.013, 3600.0])
def test_compression_and_chunks(compression: str, chunk: float, tmp_path: Path) -> None:
    config = small_config(f'recorder.compression={compression}', chunk=chunk)
    write_small(tmp_path / 'bag', config)
    expected = {0.0001: 300, 0.013: 24, 3600.0: 1}[chunk]
    with open(tmp_path / 'bag' / 'bag_0.mcap', 'rb') as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) == expected
    assert {c.compression for c in summary.chunk_indexes} == {
        '' if compression == 'none' else compression
    }
    ticks = [tuple(messages) for _, messages in BagReader(tmp_path / 'bag').ticks()]
    assert tuple(ticks) == small_messages(small_config())
    with AnyReader([tmp_path / 'bag']) as reader:
        assert sum(1 for _ in reader.messages()) == 6 * TICKS


def test_large_chunks_end_at_eight_mebibytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both ways of writing end a chunk at the same tick."""
    from flexarm_ros.bag import writer as module

    monkeypatch.setattr(module, 'MAX_CHUNK', 100_000)
    config = small_config(chunk=3600.0)
    write_small(tmp_path / 'blocks', config)
    with BagWriter(tmp_path / 'single', config) as writer:
        for tick, messages in enumerate(small_messages(config)):
            for topic, data in enumerate(messages):
                writer.write(topic, tick, data)
    data = (tmp_path / 'blocks' / 'bag_0.mcap').read_bytes()
    assert data == (tmp_path / 'single' / 'bag_0.mcap').read_bytes()
    with open(tmp_path / 'blocks' / 'bag_0.mcap', 'rb') as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert len(summary.chunk_indexes) > 5
    assert max(c.uncompressed_size for c in summary.chunk_indexes) < 103_000


def test_a_chunk_is_with_the_system_when_its_last_tick_is_complete(tmp_path: Path) -> None:
    truth = small_messages(CONFIG)
    writer = BagWriter(tmp_path / 'bag', CONFIG)
    path = tmp_path / 'bag' / 'bag_0.mcap'
    sizes = []
    for tick in range(101):
        for topic in range(6):
            writer.write(topic, tick, truth[tick][topic])
        sizes.append(path.stat().st_size)
    assert [k for k in range(1, 101) if sizes[k] > sizes[k - 1]] == [49, 99]
    assert not (tmp_path / 'bag' / 'metadata.yaml').exists()
    writer.close()
    assert (tmp_path / 'bag' / 'metadata.yaml').exists()


def test_nothing_of_an_incomplete_tick_is_lost(tmp_path: Path) -> None:
    truth = small_messages(CONFIG)
    with BagWriter(tmp_path / 'bag', CONFIG) as writer:
        for tick in range(10):
            for topic in range(6):
                writer.write(topic, tick, truth[tick][topic])
        for topic in (3, 0, 1):
            writer.write(topic, 10, truth[10][topic])
    assert writer.complete_ticks == 10
    ticks = dict(BagReader(tmp_path / 'bag').ticks())
    assert len(ticks) == 11
    held = [data if i in (0, 1, 3) else None for i, data in enumerate(truth[10])]
    assert ticks[10] == held


def test_never_overwrites(bag: Path, tmp_path: Path) -> None:
    before = (bag / 'bag_0.mcap').read_bytes()
    with pytest.raises(BagExistsError, match='not overwritten'):
        BagWriter(bag, CONFIG)
    assert (bag / 'bag_0.mcap').read_bytes() == before
    (tmp_path / 'empty').mkdir()
    with pytest.raises(BagExistsError):
        BagWriter(tmp_path / 'empty', CONFIG)
    (tmp_path / 'file').write_text('')
    with pytest.raises(BagError):
        BagWriter(tmp_path / 'file' / 'bag', CONFIG)


def test_messages_that_make_no_sense(tmp_path: Path) -> None:
    truth = small_messages(CONFIG)
    with BagWriter(tmp_path / 'bag', CONFIG) as writer:
        writer.write(2, 0, truth[0][2])
        with pytest.raises(BagContentError, match='/joint_states: second message of tick 0'):
            writer.write(2, 0, truth[0][2])
        writer.end_tick(0)
        with pytest.raises(BagContentError, match='/clock: message of tick 0 too late'):
            writer.write(0, 0, truth[0][0])
        with pytest.raises(BagError, match='ticks from 5 where 1 is due'):
            writer.write_block(decode_ticks(TOPICS, 5, truth[5:8]))


@pytest.mark.skipif(not Path('/dev/full').exists(), reason='no /dev/full')
def test_disk_full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk is one line, and what was written before stays readable."""
    config = small_config('recorder.compression=none')
    truth = small_messages(config)
    writer = BagWriter(tmp_path / 'bag', config)
    real = writer._file._file
    with pytest.raises(BagError, match=r'bag_0.mcap: cannot be written: No space left') as caught:
        for tick, messages in enumerate(truth):
            if tick == 120:
                writer._file._file = open('/dev/full', 'wb', buffering=0)  # noqa: SIM115
            for topic, data in enumerate(messages):
                writer.write(topic, tick, data)
    assert '\n' not in str(caught.value)
    writer.abandon()
    real.close()
    reader = BagReader(tmp_path / 'bag')
    assert len(list(reader.ticks())) == 100
    assert reader.damage is not None


def test_no_trace_of_this_machine(bag: Path) -> None:
    for data in ((bag / 'bag_0.mcap').read_bytes(), (bag / 'metadata.yaml').read_bytes()):
        for word in (str(bag), str(Path.home()), str(ROOT)):
            assert word.encode() not in data


def test_numbers_survive(tmp_path: Path) -> None:
    """NaN, infinities and denormals pass through a bag bit for bit."""
    truth = [list(messages) for messages in small_messages(CONFIG)[:2]]
    odd = (float('nan'), float('-inf'))
    truth[1][COMMAND] = TOPICS[COMMAND].codec.encode(T0 + 10**6, *odd)
    with BagWriter(tmp_path / 'bag', CONFIG) as writer:
        for tick, messages in enumerate(truth):
            for topic, data in enumerate(messages):
                writer.write(topic, tick, data)
    (block,) = BagReader(tmp_path / 'bag').blocks()
    assert np.array(odd).tobytes() == block.values[COMMAND][1].tobytes()


@pytest.mark.parametrize('longer', [None, 130], ids=['as they are', 'one of another size'])
def test_whole_ticks_at_once_are_the_same_as_one_by_one(
    tmp_path: Path, longer: int | None
) -> None:
    truth = [list(tick) for tick in small_messages(CONFIG)]
    if longer is not None:
        truth[longer][2] += b'\0\0\0\0'  # as a publisher of somebody else's may write it
    with BagWriter(tmp_path / 'one', CONFIG) as writer:
        for tick, messages in enumerate(truth):
            for topic, data in enumerate(messages):
                writer.write(topic, tick, data)
    with BagWriter(tmp_path / 'many', CONFIG) as writer:
        for first, last in itertools.pairwise((0, 1, 70, 255, TICKS)):
            columns = [list(column) for column in zip(*truth[first:last], strict=True)]
            writer.write_ticks(first, columns)
        assert writer.complete_ticks == TICKS
    one, many = ((tmp_path / name / 'bag_0.mcap').read_bytes() for name in ('one', 'many'))
    assert one == many
