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

"""Recomputation of the messages of a tick from the messages recorded before it."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

from flexarm_ros.core.parameters.changes import Agenda
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.answers import make_part
from flexarm_ros.core.run.loop_blocks import Stamped, stamped
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.part import Answer, DRIVES
from flexarm_ros.core.run.parts import answering
from flexarm_ros.core.run.required_parts import PLANT_VALUES, PlantPart
from flexarm_ros.core.run.rig_parts import PAYLOAD
from flexarm_ros.core.run.state import MessageState, State
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.topics import CLOCK, STATE, Topic
import numpy as np

Values = tuple[float, ...]

Tick = Sequence[Values | None]
"""Values of each topic's message at one tick, None if missing or unreadable."""


class Nodes:
    """
    Recomputes each node's message of a tick from the recorded ones.

    ``start_known``: whether the scenario gives the plant's state at tick 0.
    """

    def __init__(
        self, config: RunConfig, topics: Sequence[Topic], skip: frozenset[str],
        start_known: bool = True,
    ) -> None:  # fmt: skip
        self._start_known = start_known
        self._topics, self._skip = topics, skip
        self.config, self._agenda = config, Agenda(config.changes)
        self._timeline = Timeline.of(config.run)
        self._plant: Any = make_plant(config)
        names = [topic.name for topic in topics]
        self._plant_reads = [names.index(name) for name in PlantPart.reads(config)]
        self._drives = names.index(DRIVES) if DRIVES in names else None
        self._payload = names.index(PAYLOAD) if PAYLOAD in names else None
        self._further = [
            (names.index(s.name), PLANT_VALUES[s.name]) for s in PlantPart.further_signals(config)
        ]
        self._start = (self._plant.q.copy(), self._plant.qd.copy())
        self._held = {i: _Held(self._timeline) for i, t in enumerate(topics) if t.recorded_from}
        """In a free-running run: place of a topic that the plant reads -> what it may hold."""
        self._parts = [
            _Recomputed(make_part(part, config), topics, part.reads(config))
            for part in answering(config)
            if part.NAME not in skip
        ]

    def expected(self, tick: int, now: Tick, before: Tick | None) -> dict[int, Stamped]:
        """Return the messages of ``tick`` that follow from this and the last tick's messages."""
        if tick >= self._agenda.next:
            self._retune(tick)
        stamp = self._timeline.stamp_ns(tick)
        found: dict[int, Stamped] = {}
        if self._topics[CLOCK].due(tick):
            found[CLOCK] = (stamp, ())
        state = self._state(tick, before)
        if state is not None:
            found[STATE] = (stamp, state.values())
            for place, values in self._further:
                found[place] = (stamp, tuple(values(self._plant)))
        else:
            self._carry(now)
        recorded = now[STATE]
        views: list[Any] = list(now)
        views[STATE] = MessageState(recorded) if recorded is not None else None
        for part in self._parts:
            found.update(part.expected(tick, stamp, views))
        for place, held in self._held.items():
            if place in found:
                held.answers[stamp] = found.pop(place)[1]
        return {i: w for i, w in found.items() if self._topics[i].node not in self._skip}

    def held(self, tick: int, messages: Sequence[bytes | None]) -> dict[int, Stamped]:
        """Return what a free-running plant must have held over ``tick``, as far as it is known."""
        found: dict[int, Stamped] = {}
        for place, held in self._held.items():
            data = messages[place]
            wanted = held.over(tick, self._topics[place], data) if data is not None else None
            if wanted is not None:
                found[place] = wanted
        return found

    def _retune(self, tick: int) -> None:
        for change in self._agenda.due(tick):
            self.config = changed(self.config, change)
        for recomputed in self._parts:
            recomputed.part.retune(self.config)

    def _state(self, tick: int, before: Tick | None) -> State | None:
        plant = self._plant
        if tick == 0:
            if not self._start_known:
                return None
            plant.set_state(*self._start)
        else:
            state = before[STATE] if before else None
            inputs = [before[i] for i in self._plant_reads] if before else []
            known = [values for values in inputs if values is not None]
            drives = before[self._drives] if before and self._drives is not None else ()
            if state is None or drives is None or len(known) < len(self._plant_reads):
                return None
            recorded = MessageState(state)
            plant.set_state(recorded.positions, recorded.rates)
            if drives:
                plant.drives[:] = np.reshape(drives, (2, 2))
            if len(known) > 1 and not self._disturb(known[1:]):
                return None
            plant.step(*known[0])
        return State(plant.q, plant.qd, plant.deflections())

    def _carry(self, now: Tick) -> None:
        """Let the plant have the payload of ``now``, where its own is not known."""
        payload = None if self._payload is None else now[self._payload]
        if payload is not None:
            self._disturb([(0.0, 0.0), payload])

    def _disturb(self, values: Sequence[Values]) -> bool:
        """Give the plant its disturbances; False if they are not allowed."""
        try:
            self._plant.disturb(*chain.from_iterable(values))
        except ValueError:
            return False
        return True


class _Held:
    """
    The answers on a topic of which a free-running plant holds the newest that has arrived.

    ``answers``: stamp, ns -> values, of the answers that the plant may still hold.
    """

    def __init__(self, timeline: Timeline) -> None:
        self._timeline, self._last = timeline, timeline.stamp_ns(0)
        self.answers: dict[int, Values] = {}

    def over(self, tick: int, topic: Topic, data: bytes) -> Stamped | None:
        """
        Return the answer held over ``tick`` that has the stamp of the message ``data``.

        None if it is not known.  Stamps never fall, so that earlier answers are forgotten; 0:
        nothing has arrived.
        """
        answers, now = self.answers, self._timeline.stamp_ns(tick)
        if not answers:
            return None
        stamp, nothing = stamp_of(topic, data), topic.nothing
        if stamp == 0:
            return 0, nothing
        if not self._last <= stamp <= now or (now - stamp) % self._timeline.period_ns:
            return now, answers.get(now, nothing)
        self._last = stamp
        while answers and next(iter(answers)) < stamp:
            del answers[next(iter(answers))]
        return (stamp, answers[stamp]) if stamp in answers else None


def stamp_of(topic: Topic, data: bytes) -> int:
    """Return the stamp of a message, ns; -1 if it cannot be decoded."""
    try:
        return topic.codec.decode_any(data)[0]
    except ValueError:
        return -1


class _Recomputed:
    """One part; it has memory, so recomputation stops at the first missing input."""

    def __init__(self, part: Answer, topics: Sequence[Topic], reads: Sequence[str]) -> None:
        names = [topic.name for topic in topics]
        self.part = part
        self._reads = [names.index(name) for name in reads]
        self._writes = [i for i, topic in enumerate(topics) if topic.node == part.NAME]
        self._due = 0

    def expected(self, tick: int, stamp: int, now: Sequence[Any]) -> dict[int, Stamped]:
        """Return the messages of ``tick`` for the recorded inputs; none if one is missing."""
        inputs = [now[i] for i in self._reads]
        if None in inputs or (tick != self._due and not self.part.AHEAD):
            return {}
        self._due = tick + 1
        answers = self.part.answer(tick, *inputs)
        return {
            place: stamped(message, self.part.LATE, stamp)
            for place, message in zip(
                self._writes, answers if len(self._writes) > 1 else (answers,), strict=True
            )
        }
