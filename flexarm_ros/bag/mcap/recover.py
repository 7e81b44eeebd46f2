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
Recovery of a damaged bag into a new one.

Each chunk has a checksum and is kept completely or not at all.  After damage the search continues
at the next intact chunk.  Messages outside of chunks (files of other writers) are kept up to the
first damage.  Scenario and provenance are in attachments with their own checksums, the scenario
also in a metadata record.  If both are lost, messages are still recovered, but the new bag cannot
be run again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
import contextlib
from dataclasses import dataclass, field
import hashlib
import json
import os
from pathlib import Path
import shutil

from flexarm_ros import scenario
from flexarm_ros.bag.embedded_metadata import (
    bag_config,
    PARAMETERS_RECORD,
    PROVENANCE_FILE,
    RUN_RECORD,
    SCENARIO_FILE,
    TORQUES_FILE,
)
from flexarm_ros.bag.errors import BagContentError, BagError, BagExistsError
from flexarm_ros.bag.mcap.mcapfile import LIBRARY
from flexarm_ros.bag.mcap.plain import PlainWriter
from flexarm_ros.bag.mcap.scan import (
    Damage,
    DATA_CHECKSUM,
    inner_records,
    library_record,
    Message,
    message_of,
    Record,
    Scanner,
    unpack,
)
from flexarm_ros.bag.mcap.storage import find_bag, Front
from flexarm_ros.bag.reading.reader import (
    check_complete,
    front_provenance,
    front_scenario,
    topic_index,
    unknown_notes,
)
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.timeline import T0_NS, Timeline
from flexarm_ros.scenario.errors import counted
from flexarm_ros.scenario.torque_file import parse_torques
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.topics import per_tick_topics
from mcap.opcode import Opcode
from mcap.records import Header
import numpy as np
from numpy.typing import NDArray

_LOOSE = 6000
"""Number of messages outside of chunks that are written as one chunk."""

_ATTACHED = (SCENARIO_FILE, PROVENANCE_FILE, TORQUES_FILE)


@dataclass
class Rescue:
    """
    The result of a recovery.

    ``kept`` messages are in the new bag, ``complete`` of ``planned`` ticks.  ``dropped`` counts
    messages that cannot be placed; separately, ``unexpected`` counts messages on topics that the
    run does not have, ``repeated`` second messages of a topic at a tick, of which the first is
    kept.  ``damages`` lists the damage, one line each.  ``harmed``: the data section is
    damaged; ``ended``: its end is present; ``lost_front``: scenario or provenance are lost;
    ``as_recorded``: the scenario is kept but only partly known to this version, so that ticks
    are not counted.  ``chunks`` and ``loose`` count intact chunks and messages outside of
    chunks, which have no checksum.
    """

    kept: int = 0
    complete: int = 0
    planned: int = 0
    dropped: int = 0
    unexpected: int = 0
    repeated: int = 0
    harmed: bool = False
    ended: bool = False
    lost_front: bool = False
    as_recorded: bool = False
    chunks: int = 0
    loose: int = 0
    damages: list[str] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Whether no message of the run is missing and the new bag can be run again."""
        every_tick = 0 < self.planned == self.complete
        unharmed = self.ended and not self.harmed
        return self.kept > 0 and not self.lost_front and not self.dropped and (
            every_tick or unharmed
        )  # fmt: skip

    @property
    def keeps_loose(self) -> bool:
        """Whether messages outside of chunks count; not after damage, which may look like one."""
        return self.loose > 0 and not (self.chunks and self.harmed)

    @property
    def status(self) -> int:
        """Exit status: 0 complete, 3 in part, 1 nothing."""
        return 0 if self.whole else 3 if self.kept else 1

    def note(self, text: str) -> None:
        """Record a damage, once."""
        if text not in self.damages:
            self.damages.append(text)


def recover(
    run: str | os.PathLike[str],
    new_bag: str | os.PathLike[str],
    watch: Callable[[float], None] = lambda _: None,
) -> Rescue:
    """
    Copy the intact part of the bag of RUN into the new directory ``new_bag``.

    ``watch`` is called with the share that is done, 0 to 1, record by record.  Nothing is created
    if no message can be rescued.  Raises BagError if RUN has no file to read, or if the new bag
    cannot be written (it is then removed), BagExistsError if ``new_bag`` exists.
    """
    path, target = find_bag(run), Path(new_bag)
    if os.path.lexists(target):
        raise BagExistsError(f'{target}: exists already, not overwritten')
    rescue = Rescue()
    front = _survey(path, rescue, lambda share: watch(0.5 * share))
    if not rescue.chunks and not rescue.loose:
        rescue.note('no sound chunk of messages')
        return rescue
    config = _config(path, front, rescue)
    messages = _sound_messages(path, rescue.keeps_loose, lambda share: watch(0.5 + 0.5 * share))
    try:
        if config is None:
            _rescue_plain(messages, front, target, rescue)
        else:
            _rescue_run(path, messages, front, config, target, rescue)
        if not rescue.kept:
            shutil.rmtree(target, ignore_errors=True)
            rescue.note('none of its messages belongs to the run')
    except BagExistsError:
        raise  # created concurrently by another process
    except BagError:
        shutil.rmtree(target, ignore_errors=True)  # a partial bag, which would block a retry
        raise
    return rescue


def _survey(path: Path, rescue: Rescue, watch: Callable[[float], None]) -> Front:
    """Scan the file for its description and its recoverable messages."""
    front = Front()
    for record in _sound_records(path, rescue, watch):
        try:
            _look_at(path, record, front, rescue)
        except BagError as error:
            rescue.harmed = True
            rescue.note(_what(error))
    with Scanner(path) as scanner:
        for name in _ATTACHED:
            if name not in front.attachments:
                data = scanner.find_attachment(name)
                if data is not None:
                    front.attachments[name] = data
    if rescue.keeps_loose:
        loose = counted(rescue.loose, 'message')
        rescue.note(f'no checksum covers {loose} outside of chunks')
    return front


def _look_at(path: Path, record: Record, front: Front, rescue: Rescue) -> None:
    if record.opcode == Opcode.CHUNK:
        rescue.chunks += 1
        for inner in inner_records(path, record.offset, unpack(path, record)):
            if isinstance(inner, Record):
                front.take(path, inner)
    elif record.opcode == Opcode.MESSAGE:
        rescue.loose += 1
    elif record.opcode == Opcode.HEADER:
        front.library = library_record(path, record, Header).library
    else:
        front.take(path, record)


def _sound_records(path: Path, rescue: Rescue, watch: Callable[[float], None]) -> Iterator[Record]:
    """Yield every record that can be read; chunks only if their checksum is right."""
    with Scanner(path) as scanner:
        position, trusted = _start(scanner, rescue), 0
        while position is None or position > 0:
            try:
                for record in scanner.records(position):
                    watch(record.end / scanner.size)
                    rescue.ended = rescue.ended or record.opcode == Opcode.DATA_END
                    if _sound(path, record, rescue):
                        trusted = record.end if record.opcode == Opcode.CHUNK else trusted
                        yield record
                return
            except BagError as error:
                rescue.note(_what(error))
                if rescue.ended:
                    return  # only the index at the end is damaged
                rescue.harmed = True
                position = _resume(scanner, error, trusted)


def _sound_messages(
    path: Path, keeps_loose: bool, watch: Callable[[float], None]
) -> Iterator[list[Message]]:
    """Yield the messages of each sound chunk, and in portions those outside of chunks."""
    loose: list[Message] = []
    for record in _sound_records(path, Rescue(), watch):
        if record.opcode == Opcode.MESSAGE and keeps_loose:
            with contextlib.suppress(Damage):
                loose.append(message_of(path, record))
        if loose and (record.opcode == Opcode.CHUNK or len(loose) == _LOOSE):
            yield loose
            loose = []
        if record.opcode == Opcode.CHUNK:
            inner = inner_records(path, record.offset, unpack(path, record))
            yield [message for message in inner if isinstance(message, Message)]
    if loose:
        yield loose


def _start(scanner: Scanner, rescue: Rescue) -> int | None:
    """Return where to start: ``None`` for the start of the file, 0 for nowhere."""
    if scanner.is_mcap():
        return None
    rescue.harmed = True
    rescue.note('the file does not start as an MCAP file does')
    return scanner.next_chunk(0) or 0


def _resume(scanner: Scanner, error: BagError, trusted: int) -> int:
    """
    Return where to continue after damage, 0 for nowhere.

    Lengths of records after the last one with a checksum (which ends at ``trusted``) may be
    wrong, so the search starts there.
    """
    if isinstance(error, Damage) and error.what == DATA_CHECKSUM:
        return error.offset
    return scanner.next_chunk(trusted) or 0


def _sound(path: Path, record: Record, rescue: Rescue) -> bool:
    if record.opcode != Opcode.CHUNK:
        return True
    try:
        for _ in inner_records(path, record.offset, unpack(path, record)):
            pass
    except BagError as error:
        rescue.harmed = True
        rescue.note(_what(error))
        return False
    return True


def _what(error: BagError) -> str:
    if isinstance(error, Damage):
        return f'damaged at byte {error.offset}: {error.what}'
    return str(error)


def _config(path: Path, front: Front, rescue: Rescue) -> RunConfig | None:
    """
    Return the scenario, from its attachment or else from the metadata record.

    Also None for one that this version knows only in part (``rescue.as_recorded``).
    """
    try:
        recorded = front_scenario(path, front)
        for text in unknown_notes(recorded.unknown):
            rescue.note(text)
        rescue.as_recorded = bool(recorded.unknown)
        return None if recorded.unknown else recorded.config
    except BagContentError as error:
        first = str(error)
    try:
        rows = front.attachments.get(TORQUES_FILE, b'').decode()
        torques = parse_torques(rows, TORQUES_FILE) if rows else ()
        data: dict[str, dict[str, object]] = {}
        for name, text in front.metadata[PARAMETERS_RECORD].items():
            section, _, key = name.partition('.')
            data.setdefault(section, {})[key] = json.loads(text)
        config = scenario.from_dict(data, torques)
        text = scenario.dump(bag_config(config)) + scenario.write_torques(config.torques)
        digest = hashlib.sha256(text.encode()).hexdigest()
        if digest == front.metadata[RUN_RECORD]['sha256']:
            rescue.note("the scenario's attachment; restored from its copy")
            return config
    except (KeyError, ValueError, TypeError, RecursionError):
        pass
    # An intact bag without any trace of one is another recorder's, and nothing is lost.
    traces = SCENARIO_FILE in front.attachments or PARAMETERS_RECORD in front.metadata
    rescue.lost_front = traces or rescue.harmed or not rescue.ended
    # recover has no --scenario, which the error names for the other commands.
    rescue.note(first.removeprefix(f'{path}: ').removesuffix('; give it with --scenario FILE'))
    return None


def _rescue_run(
    path: Path,
    portions: Iterator[list[Message]],
    front: Front,
    config: RunConfig,
    target: Path,
    rescue: Rescue,
) -> None:
    """Write the sound messages as a bag of this run."""
    if PROVENANCE_FILE not in front.attachments:
        rescue.lost_front = True
        rescue.note('its provenance (package versions, source) is lost')
    topics = per_tick_topics(config)
    timeline = Timeline.of(config.run)
    rescue.planned = timeline.ticks
    index = {i + 1: i for i in range(len(topics))}
    if front.library != LIBRARY:
        try:
            index = topic_index(front, topics)
            check_complete(path, topics, [index])
        except BagContentError as error:
            rescue.note(
                f'{str(error).removeprefix(f"{path}: ")}; the order of this package is assumed'
            )
    altering = {c.id for c in front.channels.values() if c.topic == changes.PATH}
    unexpected = front.channels.keys() - index.keys() - altering
    seen = np.zeros((timeline.ticks, len(topics)), dtype=bool)
    with BagWriter(target, config, front_provenance(front)) as writer:
        for messages in portions:
            ours = [message for message in messages if message.channel not in unexpected]
            rescue.unexpected += len(messages) - len(ours)
            last = _rescue_messages(ours, writer, index, altering, timeline, seen, rescue)
            writer.end_tick(last - 1)
    rescue.complete = writer.complete_ticks


def _rescue_messages(
    messages: Sequence[Message],
    writer: BagWriter,
    index: Mapping[int, int],
    altering: set[int],
    timeline: Timeline,
    seen: NDArray[np.bool_],
    rescue: Rescue,
) -> int:
    """Write the valid messages of one chunk; return the last of their ticks."""
    last = -1
    for message in messages:
        tick, rest = divmod(message.log_time - T0_NS, timeline.period_ns)
        try:
            if message.channel in altering:
                writer.write_change(changes.decode(message.data, timeline.period_ns))
            elif rest or not 0 <= tick < timeline.ticks:
                raise ValueError
            else:
                topic = index[message.channel]
                if seen[tick, topic]:
                    rescue.repeated += 1
                    continue
                writer.write(topic, tick, message.data)
                seen[tick, topic] = True
                last = max(last, tick)
            rescue.kept += 1
        except (BagContentError, LookupError, ValueError):
            rescue.dropped += 1
    return last


def _rescue_plain(
    portions: Iterator[list[Message]], front: Front, target: Path, rescue: Rescue
) -> None:
    """Write the sound messages without a scenario, as their channels describe them."""
    if not front.channels:
        rescue.note('the description of its channels is lost')
        return
    with PlainWriter(target, front, rescue.as_recorded) as writer:
        for messages in portions:
            kept, dropped = writer.add(messages)
            rescue.kept += kept
            rescue.dropped += dropped
