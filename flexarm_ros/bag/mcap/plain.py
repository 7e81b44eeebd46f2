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

"""Writing of recovered messages of which only the channels are known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from flexarm_ros.bag.embedded_metadata import MEDIA_TYPES
from flexarm_ros.bag.mcap.files import make_directory, write_atomically
from flexarm_ros.bag.mcap.mcapfile import McapFile, MESSAGE_FIXED, MESSAGE_HEADER, RECORD_INDEX
from flexarm_ros.bag.mcap.scan import Message
from flexarm_ros.bag.mcap.storage import Front
from flexarm_ros.bag.metadata import bag_information, BagTopic, to_yaml
from flexarm_ros.bag.writer import FILE_NAME
from flexarm_ros.core.timeline import T0_NS
from flexarm_ros.wire.topics import Qos
import numpy as np

ROSBAG2 = 'rosbag2'
"""The metadata record that rosbag2 reads; it is generated anew."""


class PlainWriter:
    """
    Writes messages unchanged, with the channels and schemas of ``front``.

    ``whole``: copy its scenario, provenance and records too.

    Raises BagError if ``directory`` exists or cannot be written.
    """

    def __init__(self, directory: Path, front: Front, whole: bool = False) -> None:
        make_directory(directory)
        self._directory = directory
        self._file = McapFile(directory / FILE_NAME, 'zstd')
        schemas = {
            schema.id: self._file.add_schema(schema.name, schema.data.decode(errors='replace'))
            for schema in front.schemas.values()
        }
        self._types = {s.id: s.name for s in front.schemas.values()}
        if whole:
            for name, data in front.metadata.items():
                if name != ROSBAG2:
                    self._file.add_metadata(name, data)
            for name, content in front.attachments.items():
                self._file.add_attachment(name, MEDIA_TYPES[name], content, T0_NS)
        self._ids: dict[int, int] = {}
        self._topics: list[tuple[str, str, str]] = []
        for channel in front.channels.values():
            if channel.schema_id in schemas:
                self._ids[channel.id] = self._file.add_channel(
                    channel.topic, schemas[channel.schema_id], channel.metadata
                )
                digest = channel.metadata.get('topic_type_hash', '')
                self._topics.append((channel.topic, self._types[channel.schema_id], digest))

    def add(self, messages: Sequence[Message]) -> tuple[int, int]:
        """Write a chunk of messages; return the numbers of kept and dropped ones."""
        known = sorted((m for m in messages if m.channel in self._ids), key=lambda m: m.log_time)
        parts, records = [], []
        for m in known:
            channel, length = self._ids[m.channel], MESSAGE_FIXED + len(m.data)
            parts.append(
                MESSAGE_HEADER.pack(5, length, channel, m.sequence, m.log_time, m.publish_time)
            )
            parts.append(m.data)
            records.append((channel, m.log_time, 9 + length))
        if parts:
            self._file.add_chunk(b''.join(parts), np.array(records, RECORD_INDEX))
        return len(known), len(messages) - len(known)

    def __enter__(self) -> PlainWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None:
            self._file.close()
            return
        topics = [
            BagTopic(name, type_name, digest, Qos(), self._file.counts[i])
            for i, (name, type_name, digest) in enumerate(self._topics, 1)
        ]
        information = bag_information(
            FILE_NAME, self._file.start_time, self._file.end_time, topics, {}
        )
        self._file.add_metadata(ROSBAG2, {'serialized_metadata': to_yaml(information)})
        self._file.finish()
        write_atomically(
            self._directory / 'metadata.yaml',
            to_yaml({'rosbag2_bagfile_information': information}),
        )
