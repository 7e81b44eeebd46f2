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
Matching of messages to ticks in a bag of another recorder.

There the log time is that of receipt, topics may be in a namespace, messages may be missing,
and there is no scenario.  The stamp gives the tick of clock, state, reference and command:
t0 + k T.  A sensor's stamp lags by its latency; its tick follows from

1. the latency in the scenario, if each message then has a distinct tick (not with jitter or
   loss, where only 2 applies);
2. the sequence number, if the topic has one message for each tick of the bag;
3. a constant lag, if first and last message have the same against the bag's first and last tick.

Otherwise the topic is left out with a note in `Match.notes`.
"""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Sequence
import contextlib
from dataclasses import dataclass, field
from pathlib import Path
import re
import struct
from typing import NamedTuple

from flexarm_ros.bag.errors import BagContentError
from flexarm_ros.bag.mcap.scan import Damage
from flexarm_ros.bag.mcap.storage import BagFile, Front
from flexarm_ros.core.parameters.changes import Change
from flexarm_ros.core.parameters.channel import ChannelParameters
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.signals import LINKS
from flexarm_ros.core.timeline import named_ns, NS_PER_S, T0_NS, ticks_between, Timeline
from flexarm_ros.wire import generic_decode
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.cdr import IntArray
from flexarm_ros.wire.topics import (
    CLOCK,
    COMMAND,
    per_tick_topics,
    REFERENCE,
    STATE,
    Topic,
    topics_of,
)
import numpy as np

UNKNOWN = -1
"""Tick of a message that cannot be matched."""

_CHANGES = -1
_KNOWN = {(topic.path, topic.type_name): i for i, topic in enumerate(topics_of(1))}
_KNOWN[changes.PATH, changes.TYPE] = _CHANGES
_FURTHER = re.compile(r'(?P<space>.*)/tip_sensor/odometry_(?P<number>[1-9][0-9]?)')
_BYTE_ORDERS = {b'\x00\x00': '>iI', b'\x00\x01': '<iI'}
_MOST_FURTHER = 99
_SHOWN = 8


@dataclass
class Match:
    """
    The result of a survey of a bag.

    ``index``: for each file, ``{channel: topic}``.  ``names``: for each topic in the bag, its
    name there.  ``ticks``: for each topic, the tick of each message in the order of the bag.
    ``notes``: what is left out; ``gaps``: what is missing between the first and the last tick.
    """

    topics: tuple[Topic, ...]
    timeline: Timeline
    index: list[dict[int, int]]
    names: dict[int, str]
    ticks: list[array[int]] = field(default_factory=list)
    changes: tuple[Change, ...] = ()
    notes: list[str] = field(default_factory=list)
    gaps: list[str] = field(default_factory=list)


class _Place(NamedTuple):
    space: str
    topic: int


def match(
    path: Path, files: Sequence[BagFile], fronts: Sequence[Front], config: RunConfig | None,
    namespace: str | None, preferred: str = '',
) -> Match:  # fmt: skip
    """
    Survey a bag; ``config`` is its scenario if known, ``namespace`` that of the run.

    If ``namespace`` is None and several hold runs, that in ``preferred`` is read.

    Raises BagContentError if the bag holds no topic of a run, or several runs, or stamps that
    are not those of a tick.
    """
    places = [{c: (name, _place(name, kind)) for c, name, kind in f.kinds()} for f in fronts]
    named = [entry for held in places for entry in held.values()]
    found_places = [place for _, place in named if place is not None]
    space = _namespace(path, found_places, namespace, preferred)
    topics = per_tick_topics(config) if config else topics_of(1, _MOST_FURTHER)
    index: list[dict[int, int]] = []
    names: dict[int, str] = {}
    left: set[str] = set()
    for held in places:
        index.append({})
        for channel, (name, place) in held.items():
            mine = place is not None and (place.space == space or place.topic == CLOCK)
            if place is None or not mine or place.topic >= len(topics):
                left.add(name)
                continue
            index[-1][channel] = place.topic
            if place.topic != _CHANGES:
                names[place.topic] = name
    survey = _Survey(files, index, len(topics))
    timeline = survey.timeline(path, config)
    topics = topics if config else survey.topics(max(names, default=0), timeline.period_ns)
    found = Match(topics, timeline, index, names)
    if left:
        found.notes.append(f'other topics are left out: {_listed(sorted(left))}')
    if config:
        found.changes = survey.changes(path, found.timeline.period_ns)
    _assign(path, survey.stamps, config, found)
    return found


def _place(name: str, kind: str) -> _Place | None:
    """Return namespace and topic of a name in a bag, None if it is not a topic of a run."""
    for (ours, type_name), topic in _KNOWN.items():
        if name.endswith(ours) and kind == type_name and (topic != CLOCK or name == ours):
            return _Place(name.removesuffix(ours), topic)
    further = _FURTHER.fullmatch(name)
    if further and kind == topics_of(1)[REFERENCE].type_name:
        return _Place(further['space'], COMMAND + int(further['number']))
    return None


def _namespace(path: Path, places: Sequence[_Place], wanted: str | None, preferred: str) -> str:
    """Return the namespace to read: the only one with a plant, or else the only one."""
    spaces = {p.space for p in places if p.topic == STATE}
    spaces = spaces or {p.space for p in places if p.topic not in (CLOCK, _CHANGES)}
    spaces = spaces or {p.space for p in places if p.topic == CLOCK}
    if not spaces:
        raise BagContentError(
            f'{path}: no topic of a run in it, and no scenario ({topics_of(1)[STATE].path}, ...)'
        )
    shown = _listed(sorted(space or '/' for space in spaces))
    if wanted is not None:
        wanted = f'/{wanted.strip("/")}'.rstrip('/')
        if wanted not in spaces:
            raise BagContentError(f'{path}: no run in namespace {wanted or "/"}; there is {shown}')
        return wanted
    if len(spaces) > 1 and preferred.strip('/') and preferred in spaces:
        return preferred
    if len(spaces) > 1:
        raise BagContentError(f'{path}: runs in several namespaces, choose one: {shown}')
    return spaces.pop()


def _listed(names: Sequence[str]) -> str:
    more = f' and {len(names) - _SHOWN} more' if len(names) > _SHOWN else ''
    return ', '.join(names[:_SHOWN]) + more


class _Survey:
    """Stamps of all messages, and estimates of what a scenario would give."""

    def __init__(
        self, files: Sequence[BagFile], index: Sequence[dict[int, int]], count: int
    ) -> None:
        self.stamps: list[array[int]] = [array('q') for _ in range(count)]
        self._state = b''
        self._changes: dict[bytes, None] = {}
        for file, held in zip(files, index, strict=True):
            with contextlib.suppress(Damage):  # reported by the later reading
                for message in file.messages():
                    topic = held.get(message.channel)
                    if topic == _CHANGES:
                        self._changes[message.data] = None
                    elif topic is not None:
                        self._take(file.path, topic, message.data)

    def _take(self, path: Path, topic: int, data: bytes) -> None:
        form = _BYTE_ORDERS.get(data[:2])
        if form is None or len(data) < 12:
            raise BagContentError(
                f'{path}: a message that is no CDR; if messages were compressed one by one, '
                'convert the bag without compression first'
            )
        sec, nanosec = struct.unpack_from(form, data, 4)
        self.stamps[topic].append(sec * NS_PER_S + nanosec)
        if topic == STATE:
            self._state = self._state or data

    def topics(self, last: int, period_ns: int) -> tuple[Topic, ...]:
        """Return the topics of the bag if there is no scenario, from its messages."""
        names: Sequence[str] = ()
        if self._state:
            with contextlib.suppress(ValueError):
                names = generic_decode.message(topics_of(1)[STATE].type_name, self._state).name
        modes = sum(name.startswith(f'{LINKS[0]}_mode') for name in names)
        further = max(last - COMMAND, 0)
        return topics_of(modes or 1, further, clock_every=self._clock_every(period_ns))

    def _clock_every(self, period_ns: int) -> int:
        """Return the ticks between messages on ``/clock`` if they are evenly spaced."""
        steps = np.unique(np.diff(np.unique(np.array(self.stamps[CLOCK], np.int64))))
        every, rest = divmod(int(steps[0]), period_ns) if len(steps) == 1 else (1, 0)
        return 1 if rest else max(every, 1)

    def changes(self, path: Path, period_ns: int) -> tuple[Change, ...]:
        """Return the parameters that were set during the run."""
        return tuple(change_of(path, data, period_ns) for data in self._changes)

    def timeline(self, path: Path, config: RunConfig | None) -> Timeline:
        """Return the ticks of the run, from the scenario or from the stamps."""
        if config is not None:
            return Timeline.of(config.run)
        stamps = np.unique(np.concatenate([np.array(s) for s in self._exact()]))
        steps, counts = np.unique(np.diff(stamps), return_counts=True)
        if not len(steps):
            raise BagContentError(
                f'{path}: {len(stamps)} ticks with a clock, state, reference or command in it: '
                'too few to determine the control period; give the scenario (--scenario FILE)'
            )
        period = int(steps[np.argmax(counts)])
        return Timeline(period, max(0, int(stamps[-1]) - T0_NS) // period + 1)

    def _exact(self) -> Iterator[array[int]]:
        return (self.stamps[topic] for topic in (CLOCK, STATE, REFERENCE, COMMAND))


def _assign(
    path: Path, stamps: Sequence[array[int]], config: RunConfig | None, found: Match
) -> None:
    """Find the tick of every message, and note what is missing."""
    ticks: dict[int, IntArray] = {
        topic: _exact_ticks(path, found, topic, np.array(stamps[topic], np.int64))
        for topic in (CLOCK, STATE, REFERENCE, COMMAND)
    }
    known = [t for topic, t in ticks.items() if len(t) and topic != REFERENCE]
    known = known or [t for t in ticks.values() if len(t)]
    span = (min(int(t.min()) for t in known), max(int(t.max()) for t in known)) if known else None
    for topic in range(len(found.topics)):
        if topic not in ticks:
            lag, hold = _told(config, found.topics[topic], found.timeline.period_ns)
            told = _sensor_ticks(
                np.array(stamps[topic], np.int64), found.timeline, lag, hold, span
            )
            if told is None:
                found.notes.append(_left_out(found.names[topic], config))
                told = np.full(len(stamps[topic]), UNKNOWN)
            ticks[topic] = told
    found.ticks = [array('q', ticks[topic].tolist()) for topic in range(len(found.topics))]
    _say_gaps(found, ticks, span)


def _left_out(name: str, config: RunConfig | None) -> str:
    hint = 'stamps do not fit the scenario' if config else '--scenario FILE may determine them'
    return f'{name} is left out: messages are missing, so that its ticks are unknown ({hint})'


def _exact_ticks(path: Path, found: Match, topic: int, stamps: IntArray) -> IntArray:
    timeline = found.timeline
    ticks, rest = np.divmod(stamps - T0_NS, timeline.period_ns)
    wrong = np.flatnonzero((rest != 0) | (ticks < 0) | (ticks >= timeline.ticks))
    if len(wrong):
        raise BagContentError(
            f'{path}: {found.names[topic]}: {len(wrong)} of {len(stamps)} messages at no tick of '
            f'the run, the first stamped {stamps[wrong[0]]} ns '
            f'({timeline.ticks} ticks of {timeline.period_ns} ns from {T0_NS} ns on)'
        )
    return ticks


def _told(config: RunConfig | None, topic: Topic, period_ns: int) -> tuple[int | None, int]:
    """
    Return a topic's lag (ns) and the ticks for which it holds a sample, if known.

    0 ticks: with jitter or loss the stamps do not determine the ticks.
    """
    if config is None:
        return None, 1
    channel = config.section(topic.node)
    if not topic.late or not isinstance(channel, ChannelParameters):
        return 0, 1
    if channel.scheduled:
        return None, 0
    hold = ticks_between(f'{topic.node}.rate', channel.rate, period_ns)
    return named_ns(f'{topic.node}.latency', channel.latency), hold


def _sensor_ticks(
    stamps: IntArray, timeline: Timeline, lag: int | None, hold: int, span: tuple[int, int] | None
) -> IntArray | None:
    """Return each message's tick by the rules of this module; None if none applies."""
    if not len(stamps):
        return stamps
    by_lag = None if lag is None else _lagging(stamps, timeline, lag, hold, span)
    if by_lag is not None and len(np.unique(by_lag)) == len(by_lag):
        return by_lag
    if span is not None:
        first, last = span
        if len(stamps) == last - first + 1:
            ticks = np.empty_like(stamps)
            ticks[np.argsort(stamps, kind='stable')] = np.arange(first, last + 1)
            return ticks
        if hold == 0:
            return None
        lag = timeline.stamp_ns(first) - int(stamps.min())
        if by_lag is None and lag == timeline.stamp_ns(last) - int(stamps.max()) >= 0:
            return _lagging(stamps, timeline, lag, 1, span)
    return by_lag


def _lagging(
    stamps: IntArray, timeline: Timeline, lag: int, hold: int, span: tuple[int, int] | None
) -> IntArray | None:
    """
    Return the ticks of stamps that lag by ``lag`` ns; None if one then has no tick.

    Messages of one held sample are consecutive; a bag that begins within one has its last
    messages.
    """
    ticks, rest = np.divmod(stamps + lag - T0_NS, timeline.period_ns)
    if rest.any() or ticks.min() < 0 or ticks.max() >= timeline.ticks or (ticks % hold).any():
        return None
    order = np.argsort(stamps, kind='stable')
    ordered = stamps[order]
    first = np.searchsorted(ordered, ordered, 'left')
    place = np.arange(len(ordered)) - first
    if span is not None:
        lost = hold - (np.searchsorted(ordered, ordered, 'right') - first)
        place += np.where(ticks[order] < span[0], np.maximum(lost, 0), 0)
    ticks[order] += np.minimum(place, hold - 1)
    return ticks


def _say_gaps(found: Match, ticks: dict[int, IntArray], span: tuple[int, int] | None) -> None:
    if span is None:
        return
    first, last = span
    if first > 0:
        found.gaps.append(f'starts at tick {first}')
    absent = [t.path for i, t in enumerate(found.topics) if i not in found.names]
    if absent:
        found.gaps.append(f'no topic {", ".join(absent)}')
    for topic, name in sorted(found.names.items()):
        seen = np.unique(ticks[topic])
        if UNKNOWN in seen:  # noted already
            continue
        every = found.topics[topic].every
        due = np.arange(-(-first // every) * every, last + 1, every)
        inside = seen[(seen >= first) & (seen <= last)]
        missing = np.setdiff1d(due, inside)
        if len(missing):
            found.gaps.append(
                f'{name}: {len(missing)} of {len(due)} messages are missing, the first at '
                f'tick {missing[0]}'
            )


def change_of(path: Path, data: bytes, period_ns: int) -> Change:
    """Return the parameter change in a message; BagContentError if it is invalid."""
    try:
        return changes.decode(data, period_ns)
    except ValueError as error:
        raise BagContentError(f'{path}: {changes.PATH}: {error}') from None
