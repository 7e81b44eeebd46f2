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
"""Free-running runs for tests, made without a clock: what the plant reads acts some ticks late."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from flexarm_ros.bag.provenance import Provenance
from flexarm_ros.bag.writer import BagWriter
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.answers import Answers
from flexarm_ros.core.run.make_plant import make_plant
from flexarm_ros.core.run.required_parts import PLANT_VALUES, PlantPart
from flexarm_ros.core.run.state import State
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire.topics import CLOCK, per_tick_topics, STATE


def free_config(config: RunConfig) -> RunConfig:
    """Return the scenario as one that runs freely."""
    return replace(config, run=replace(config.run, sync='free'))


def free_messages(config: RunConfig, late: Callable[[int], int | None]) -> list[tuple[bytes, ...]]:
    """
    Return the messages of each tick of a free-running run.

    ``late(k)``: by how many ticks what answers tick k is late, None: it never arrives.  Ticks
    begin 0.1 ms late, and commands arrive 0.3 ms after the begin of their tick.
    """
    topics, timeline = per_tick_topics(config), Timeline.of(config.run)
    plant: Any = make_plant(config)
    answers = Answers(config)
    period = timeline.period_ns * 1e-9
    arrivals: dict[int, list[int]] = {}
    reads = [answers.places[name] for name in PlantPart.reads(config)]
    further = [
        (answers.places[s.name], PLANT_VALUES[s.name]) for s in PlantPart.further_signals(config)
    ]
    inputs: list[list[tuple[float, ...]]] = []
    held, found = -1, []
    for k in range(timeline.ticks):
        state = State(plant.q.copy(), plant.qd.copy(), plant.deflections())
        shown_further = {place: tuple(of(plant)) for place, of in further}
        for place, values_of in shown_further.items():
            answers.tell(place, values_of)
        messages = list(answers.tick(k, state))
        inputs.append([messages[place] for place in reads])
        delay = late(k)
        if delay is not None:
            arrivals.setdefault(k + delay, []).append(k)
        held = max([held, *arrivals.pop(k, [])])
        newest = inputs[held] if held >= 0 else [topics[place].nothing for place in reads]
        stamp = timeline.stamp_ns(k)
        values = {CLOCK: (stamp, ()), STATE: (stamp, state.values())}
        values |= {place: (stamp, shown) for place, shown in shown_further.items()}
        for place, shown in zip(reads, newest, strict=True):
            values[place] = (timeline.stamp_ns(held) if held >= 0 else 0, shown)
        delayed = (late(held) or 0) if held >= 0 else 0
        arrival = (held + delayed) * period + 3e-4 if held >= 0 else -1.0
        times = (k * period + 1e-4, k * period, arrival)
        row = []
        for i, topic in enumerate(topics[:-1]):
            if i in values:
                at, shown = values[i]
            elif answers.late[i]:
                at, shown = messages[i][0], messages[i][1:]
            else:
                at, shown = stamp, messages[i]
            row.append(topic.codec.encode(at, *shown))
        found.append((*row, topics[-1].codec.encode(stamp, *times)))
        if len(newest) > 1:
            plant.disturb(*[value for values in newest[1:] for value in values])
        plant.step(*newest[0])
    return found


def write_free(
    bag: Path,
    config: RunConfig,
    late: Callable[[int], int | None],
    alter: Callable[[int, int, bytes], bytes] = lambda _k, _t, data: data,
) -> Path:
    """Write the bag of a free-running run; ``alter(tick, topic, bytes)`` changes messages."""
    with BagWriter(bag, config, Provenance.here('free')) as writer:
        for k, row in enumerate(free_messages(config, late)):
            for i, data in enumerate(row):
                writer.write(i, k, alter(k, i, data))
    return bag
