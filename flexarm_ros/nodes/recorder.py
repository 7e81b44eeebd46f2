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

"""Node ``recorder``: writes every message of the run to a bag, in order of ticks."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
import time
from typing import Any, ClassVar

from flexarm_ros.bag.errors import BagError
from flexarm_ros.bag.recording import (
    default_name,
    finish_run,
    free_directory,
    prepare_directory,
    Recording,
)
from flexarm_ros.nodes.realtime.command import AppliedInput
from flexarm_ros.nodes.runtime.errors import RunFailed
from flexarm_ros.nodes.runtime.parameters.live import ChangesInput
from flexarm_ros.nodes.runtime.participant import Participant
from flexarm_ros.nodes.runtime.progress import ProgressOutput
from flexarm_ros.nodes.runtime.topics.channels import Input
from flexarm_ros.nodes.runtime.topics.graph import RECORDED_TOPIC
from flexarm_ros.wire.rcl_calls import warm_up_blocks
from flexarm_ros.wire.topics import applied, Topic

_LOOK_S = 0.02
"""Maximum wall time between two batches, s; waking up for each message would cost more."""

_BATCH = 64
"""Target number of ticks per batch, well below the plant's lead (`recorder_window`)."""

_LAST_WORDS_S = 0.3
"""Wall time in which messages of a failed run may still arrive, s."""


class RecorderNode(Participant):
    """Reads the serialized bytes of all per-tick topics in batches and writes them."""

    ROLE: ClassVar[str] = 'recorder'

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._progress = ProgressOutput(self, RECORDED_TOPIC)
        self.side_outputs.append(self._progress)
        self._changes = ChangesInput(self, self.membership)
        self.side_inputs.append(self._changes)
        self._name = str(self.get_parameter('name').value or '')
        self._recording: Recording | None = None
        self._first_wall: float | None = None
        self._due, self._look_s = 0.0, _LOOK_S

    def make_input(self, topic: Topic) -> Input:
        """Return the input of a topic, or of the topic that it is recorded from."""
        if topic.recorded_from:
            return AppliedInput(self, applied(topic), self.invalid_message)
        return super().make_input(topic)

    def build(self) -> None:
        """Create the output directory; nothing is overwritten."""
        self._first_wall, self._wall = None, 0.0
        try:
            if self._recording is not None:
                self._write_ragged_end(self._recording)
                self._recording.set_aside(self.epochs.number)
            directory = self._recording.directory if self._recording else self._directory()
            if self._recording is None and not self.supervisor.present:
                prepare_directory(directory, self.config, self._name)
            self._recording = Recording(
                self.config, directory, self._name, sorted(self.membership.external)
            )
        except (OSError, BagError) as error:
            raise RunFailed('recorder', f'start: {error}') from None
        self._entries = list(self.inputs.values())
        self._written = 0
        self._waiting: list[list[bytes]] = [[] for _ in self._entries]
        self.supervisor.report(self.ROLE, directory=str(self._recording.directory))

    def warm_up(self) -> None:
        """Load what takes the messages."""
        warm_up_blocks()

    def _directory(self) -> Path:
        """Return the output directory: the parameter ``output``, else a new one."""
        wanted = str(self.get_parameter('output').value or '')
        default = default_name(self._name or 'run', self.get_namespace())
        return Path(wanted) if wanted else free_directory(default)

    def advance(self) -> bool:
        """Write the messages that have arrived, if a batch is due."""
        now = time.monotonic()
        if now < self._due:
            return False
        passed, before = now - self._due + self._look_s, self.tick
        moved = self._record()
        if moved:
            self._look_s = min(_LOOK_S, passed * _BATCH / (self.tick - before))
        self._due = now + self._look_s
        if not moved:
            return False
        self._progress.tell(self.tick)
        self.check_end()
        return not self.finished

    def _record(self) -> bool:
        """Write the content of the queues; False if this completes no further tick."""
        recording = self._recording
        assert recording is not None
        state = self.inputs['plant/state']
        last = self.final_tick
        failure: RunFailed | None = None
        try:
            for entry, waiting in zip(self._entries, self._waiting, strict=True):
                # References arrive ahead of time; those that the run may not reach are left.
                until = min(last, state.tick) if entry.source == 'trajectory' else last
                try:
                    entry.fetch_block(until // entry.topic.every, waiting)
                except RunFailed as error:  # the other topics are recorded first
                    failure = failure or error
            # A node publishes a parameter change before it answers the tick (`live`): the
            # changes that belong to these messages have arrived.
            for change in self._changes.take():
                recording.write_change(change)
            self._write_whole_ticks(recording)
        except BagError as error:
            recording.abandon()
            self._recording = None
            raise RunFailed('recorder', f'tick {self.tick}: {error}') from None
        if failure is not None:
            raise failure
        complete = min(entry.whole for entry in self._entries)
        if complete == self.tick:
            return False
        now = time.monotonic()
        if self._first_wall is None:
            self._first_wall = now
        self._wall = now - self._first_wall
        self.tick = complete
        self.supervisor.report(self.ROLE, tick=complete)
        return True

    def _write_whole_ticks(self, recording: Recording) -> None:
        topics, written = [entry.topic for entry in self._entries], self._written
        whole = min(
            (topic.count(written) + len(waiting)) * topic.every
            for topic, waiting in zip(topics, self._waiting, strict=True)
        )
        if whole > written:
            counts = [topic.count(whole) - topic.count(written) for topic in topics]
            columns = list(zip(self._waiting, counts, strict=True))
            recording.write_ticks(written, [waiting[:count] for waiting, count in columns])
            self._written = whole
            for waiting, count in columns:
                del waiting[:count]

    def _write_ragged_end(self, recording: Recording) -> None:
        """Write the messages of incomplete ticks."""
        for index, waiting in enumerate(self._waiting):
            topic = self._entries[index].topic
            for number, data in enumerate(waiting, topic.count(self._written)):
                recording.write(index, number * topic.every, data)
            waiting.clear()

    def close(self) -> None:
        """Finish the bag and the files beside it."""
        if self._recording is None:
            return
        deadline = time.monotonic() + (_LAST_WORDS_S if self.failure else 0.0)
        with suppress(RunFailed):  # messages in transit when a run failed
            self._record()
            while self._recording is not None and time.monotonic() < deadline:
                time.sleep(_LOOK_S)
                self._record()
        if self._recording is None:
            return
        self._write_ragged_end(self._recording)
        self._recording.close()
        if not self.supervisor.present:  # started by hand: no launcher completes the directory
            self._finish_directory()

    def _finish_directory(self) -> None:
        assert self._recording is not None
        plant = self.membership.status_of('plant')
        unstable = plant.extra.get('unstable', '') if plant is not None else ''
        finish_run(
            self._recording.directory,
            self.config,
            self._name,
            wall_s=self._wall or None,
            problem=self.failure.reason if self.failure else '',
            unstable=(self.tick, unstable) if unstable else None,
        )
        self.get_logger().info(f'recorded {self.tick} ticks in {self._recording.directory}')

    def max_sleep_s(self, now: float) -> float:
        """Return the time until the next batch."""
        return max(0.0, self._due - now) if self.under_way else super().max_sleep_s(now)

    def blocked_on(self) -> list[Any]:
        """Wait for nothing: messages are read in batches."""
        return [] if self.under_way else super().blocked_on()
