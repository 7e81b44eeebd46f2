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

"""Bags as rosbag2 writes them: receive times, other topics, no attachments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

from bagtools import small_messages
from flexarm_ros.bag.definitions import definition
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.wire.generic_decode import typestore
from flexarm_ros.wire.topics import per_tick_topics, REFERENCE
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Rosbag2Writer

WALL_NS = 1_760_000_000 * 10**9
"""Wall time at which the recordings of the tests begin."""

AHEAD = 32
"""Ticks of reference that are published in one burst."""

Keep = Callable[[int, int], bool]
"""Of tick and topic: whether the recorder got the message."""


class Received(NamedTuple):
    """A message as a recorder gets it."""

    topic: str
    type_name: str
    time: int
    data: bytes


def received(
    config: RunConfig, keep: Keep = lambda tick, topic: True, namespace: str = '',
    others: bool = True,
) -> Iterator[Received]:  # fmt: skip
    """Yield what a recorder gets of a run: the reference in bursts, another topic between."""
    topics, truth = per_tick_topics(config), small_messages(config)
    names = [t.path if t.path == '/clock' else namespace + t.path for t in topics]
    time = WALL_NS
    for tick, messages in enumerate(truth):
        if tick % AHEAD == 0:
            for ahead in range(tick, min(tick + AHEAD, len(truth))):
                if keep(ahead, REFERENCE):
                    kind = topics[REFERENCE].type_name
                    yield Received(names[REFERENCE], kind, time, truth[ahead][REFERENCE])
            if others:
                yield Received('/chatter', 'std_msgs/msg/String', time, text(f'tick {tick}'))
        for index, data in enumerate(messages):
            time += 100_000
            if index != REFERENCE and keep(tick, index):
                yield Received(names[index], topics[index].type_name, time, data)


def text(content: str) -> bytes:
    """Return a serialized std_msgs/String."""
    message = typestore().types['std_msgs/msg/String'](content)
    return bytes(typestore().serialize_cdr(message, 'std_msgs/msg/String'))


def write_mcap(
    path: Path, messages: Sequence[Received], chunked: bool = True, summary: bool = True,
    compression: CompressionType = CompressionType.ZSTD,
) -> Path:  # fmt: skip
    """Write an MCAP file with the ``mcap`` library; unchunked as rosbag2's preset fastwrite."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, 'wb') as file:
        writer = Writer(
            file, use_chunking=chunked, compression=compression, chunk_size=50_000,
            index_types=IndexType.ALL if summary else IndexType.NONE, repeat_channels=summary,
            repeat_schemas=summary, use_statistics=summary, use_summary_offsets=summary,
        )  # fmt: skip
        writer.start('ros2', 'libmcap')
        channels: dict[str, int] = {}
        for topic, kind, time, data in messages:
            if topic not in channels:
                schema = writer.register_schema(kind, 'ros2msg', definition(kind)[0].encode())
                channels[topic] = writer.register_channel(topic, 'cdr', schema)
            writer.add_message(channels[topic], time, data, time)
        writer.finish()
    return path


def write_rosbag2(
    directory: Path, messages: Sequence[Received], plugin: StoragePlugin, version: Literal[8, 9]
) -> Path:
    """Write a bag's directory with the ``rosbags`` library."""
    with Rosbag2Writer(directory, version=version, storage_plugin=plugin) as writer:
        connections = {}
        for topic, kind, time, data in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=typestore())
            writer.write(connections[topic], time, data)
    return directory


def write_split(directory: Path, messages: Sequence[Received], count: int) -> Path:
    """Write a bag split into ``count`` files, with the metadata that rosbag2 leaves."""
    size = -(-len(messages) // count)
    names = [f'{directory.name}_{number}.mcap' for number in range(count)]
    for number, name in enumerate(names):
        write_mcap(directory / name, messages[number * size : (number + 1) * size])
    metadata(directory, messages, names, 5)
    return directory


def metadata(
    directory: Path, messages: Sequence[Received], names: Sequence[str], version: int
) -> None:
    """Write a ``metadata.yaml`` as rosbag2 of this version does."""
    counts: dict[tuple[str, str], int] = {}
    for message in messages:
        key = (message.topic, message.type_name)
        counts[key] = counts.get(key, 0) + 1
    lines = ['rosbag2_bagfile_information:', f'  version: {version}', '  storage_identifier: mcap']
    lines += ['  relative_file_paths:', *(f'    - {name}' for name in names)]
    lines += ['  duration:', '    nanoseconds: 1', '  starting_time:']
    lines += [f'    nanoseconds_since_epoch: {WALL_NS}', f'  message_count: {len(messages)}']
    lines += ['  topics_with_message_count:']
    for (topic, kind), count in counts.items():
        lines += ['    - topic_metadata:', f'        name: {topic}', f'        type: {kind}']
        lines += ['        serialization_format: cdr']
        lines += [
            '        offered_qos_profiles: ""'
            if version < 9
            else '        offered_qos_profiles: []'
        ]
        lines += [f'      message_count: {count}']
    (directory / 'metadata.yaml').write_text('\n'.join(lines) + '\n')
