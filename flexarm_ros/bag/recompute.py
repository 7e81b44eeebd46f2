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

"""What each node should have published at a tick, from what was recorded before it."""

from __future__ import annotations

from collections.abc import Sequence

from flexarm_ros.bag.topics import (
    CLOCK,
    COMMAND,
    JOINT_STATES,
    REFERENCE,
    split_state,
    STATE,
    TIP,
    Topic,
)
from flexarm_ros.core.changes import Agenda
from flexarm_ros.core.control import make_law, Sample
from flexarm_ros.core.loop import TickRecord
from flexarm_ros.core.parameters import changed, RunConfig
from flexarm_ros.core.plant import make_plant
from flexarm_ros.core.sensors import Encoder, further_sensors, TipSensor
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.core.trajectory import Reference
import numpy as np

Values = tuple[float, ...]
Stamped = tuple[int, Values]
"""Stamp (ns) and values of one message."""

Tick = Sequence[Values | None]
"""Values of each topic's message of one tick, None: missing or unreadable."""


class Nodes:
    """
    Recomputes each node's message of a tick from the recorded ones.

    ``start_known``: whether the scenario tells the plant's state at tick 0.
    """

    def __init__(
        self, config: RunConfig, topics: Sequence[Topic], skip: frozenset[str],
        start_known: bool = True,
    ) -> None:  # fmt: skip
        self._start_known = start_known
        self._topics, self._skip = topics, skip
        self.config, self._agenda = config, Agenda(config.changes)
        self._timeline = Timeline.of(config.run)
        self._plant = make_plant(config)
        self._start = (self._plant.q.copy(), self._plant.qd.copy())
        self._size = len(self._plant.names)
        self._encoder, self._tip = Encoder(config), TipSensor(config)
        self._more = further_sensors(config)
        self._reference = Reference(config)
        self._law = None if 'controller' in skip else make_law(config)
        self._fed = self._judged = 0

    def expected(self, tick: int, now: Tick, before: Tick | None) -> dict[int, Stamped]:
        """Return what can be told of tick ``tick`` from its and the last tick's messages."""
        if tick >= self._agenda.next:
            self._retune(tick)
        stamp = self._timeline.stamp_ns(tick)
        found: dict[int, Stamped] = {}
        if self._topics[CLOCK].due(tick):
            found[CLOCK] = (stamp, ())
        found[REFERENCE] = (stamp, self._reference.command(tick))
        state = self._state(tick, before)
        if state is not None:
            found[STATE] = (stamp, state)
        if now[STATE] is not None:
            self._answers(tick, stamp, now, found)
        return {i: w for i, w in found.items() if self._topics[i].node not in self._skip}

    def _retune(self, tick: int) -> None:
        for change in self._agenda.due(tick):
            self.config = changed(self.config, change)
        for part in (self._encoder, self._tip, self._reference, self._law):
            if part is not None:
                part.retune(self.config)
        for sensor in self._more:
            sensor.retune(self.config)

    def _state(self, tick: int, before: Tick | None) -> Values | None:
        plant, n = self._plant, self._size
        if tick == 0:
            if not self._start_known:
                return None
            plant.set_state(*self._start)
        else:
            state = before[STATE] if before else None
            torque = before[COMMAND] if before else None
            if state is None or torque is None:
                return None
            plant.set_state(*split_state(state, n)[:2])
            plant.step(torque[0], torque[1])
        ends = plant.deflections()
        return (*plant.q.tolist(), *ends[:2], *plant.qd.tolist(), *ends[2:])

    def _answers(self, tick: int, stamp: int, now: Tick, found: dict[int, Stamped]) -> None:
        """Sensors and law have a memory: they can be told as long as no tick is missing."""
        state, n = now[STATE], self._size
        assert state is not None
        positions, rates, deflection = split_state(state, n)
        q, qd = np.array(positions), np.array(rates)
        if tick == self._fed:
            self._fed += 1
            encoder = self._encoder.measure(tick, q, qd)
            tip = self._tip.measure(tick, q, qd)
            found[JOINT_STATES] = (encoder[0], encoder[1:])
            found[TIP] = (tip[0], tip[1:])
            for topic, sensor in enumerate(self._more, COMMAND + 1):
                more = sensor.measure(tick, q, qd)
                found[topic] = (more[0], more[1:])
        inputs = (now[JOINT_STATES], now[TIP], now[REFERENCE])
        if self._law is not None and tick == self._judged and None not in inputs:
            self._judged += 1
            sample = Sample(positions, rates, deflection, *inputs)  # type: ignore[arg-type]
            found[COMMAND] = (stamp, self._law.torque(tick, sample))


def loop_messages(record: TickRecord, stamp: int) -> list[Stamped]:
    """Return the messages of one tick of the closed loop, in canonical order."""
    ends = record.deflections
    state = (*record.q.tolist(), *ends[:2], *record.qd.tolist(), *ends[2:])
    return [
        (stamp, ()),
        (stamp, state),
        (record.encoder[0], record.encoder[1:]),
        (record.tip[0], record.tip[1:]),
        (stamp, record.reference),
        (stamp, record.torque),
        *((more[0], more[1:]) for more in record.more),
    ]
