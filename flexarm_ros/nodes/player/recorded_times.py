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
"""The wall times of a free-running run, for playback with ``timing: recorded``."""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.bag.reading.reader import BagReader
from flexarm_ros.nodes.player.options import PlayerError
from flexarm_ros.wire.topics import TIMING, torque_place


class RecordedTimes:
    """
    When the ticks of a bag began, and when their commands arrived.

    Raises PlayerError if the bag is not that of a free-running run.
    """

    def __init__(self, reader: BagReader) -> None:
        names = [topic.name for topic in reader.topics]
        if TIMING not in names:
            raise PlayerError(f'timing: recorded: {reader.path} is not of a free-running run')
        self._place = names.index(TIMING)
        self.torque = torque_place(reader.topics)
        """Index of the topic of the torques that the plant held."""
        self._topics = reader.topics
        self._last: bytes | None = None
        self._at = -1.0
        self._begins: dict[int, float] = {}
        self.latencies: list[float] = []
        """Time from the begin of a tick to the arrival of its command, s, of those played."""

    def of(self, messages: Sequence[bytes | None]) -> tuple[float | None, float | None]:
        """
        Return when a tick began, s, and when its command arrived.

        None if it is not in the bag; None for a held command, which arrived earlier.
        """
        data, command = messages[self._place], messages[self.torque]
        if data is None:
            return None, None
        stamp, (begin, _, arrived) = self._topics[self._place].codec.decode_any(data)
        self._begins[stamp] = begin
        if command is None or arrived < 0.0 or (command, arrived) == (self._last, self._at):
            return begin, None
        self._last, self._at = command, arrived
        answered = self._begins.get(self._topics[self.torque].codec.decode_any(command)[0])
        if answered is not None:
            self.latencies.append(arrived - answered)
        return begin, arrived
