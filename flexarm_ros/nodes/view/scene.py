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

"""The content of a live view at one instant, independent of how it is drawn."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
import math

from flexarm_ros.core.arm.arm_line import ArmLine
from flexarm_ros.core.control import gain_of
from flexarm_ros.core.parameters.sections import changed, RunConfig
from flexarm_ros.core.run.state import MessageState
from flexarm_ros.core.sensing.strain_gauge import deflection_scales, STRAIN
from flexarm_ros.core.timeline import Timeline
from flexarm_ros.wire import parameter_event as changes
from flexarm_ros.wire.topics import (
    COMMAND,
    per_tick_topics,
    REFERENCE,
    STATE,
    TIP,
    Topic,
)
import numpy as np

Point = tuple[float, float]
SHOWN = (STATE, TIP, REFERENCE, COMMAND)
"""Topics that a view subscribes to."""

_NONE: Point = (math.nan, math.nan)


@dataclass(frozen=True)
class Frame:
    """
    The arm at ``stamp_ns``: m, rad, N m, in frame ``base``.

    ``line`` runs along the bent links from the shoulder to the tip, with the elbow at index
    ``elbow``.  ``sensed`` and ``reference`` are the newest received, nan before the first.
    ``gain`` is lambda, nan for a law without it.
    """

    stamp_ns: int
    line: tuple[Point, ...]
    elbow: int
    angles: Point
    deflections: Point
    sensed: Point
    reference: Point
    torque: Point
    gain: float

    @property
    def tip(self) -> Point:
        """Return the tip of the bent arm."""
        return self.line[-1]

    @property
    def links(self) -> tuple[tuple[Point, ...], tuple[Point, ...]]:
        """Return the bent links: the line to the elbow, and from the elbow."""
        last, first = self.elbow + 1, self.elbow
        return self.line[:last], self.line[first:]

    def numbers(self) -> dict[str, float | None]:
        """Return the plotted numbers by name; None for a missing one."""
        error = math.dist(self.tip, self.reference)
        named = {
            'theta1': self.angles[0], 'theta2': self.angles[1],
            'delta1': self.deflections[0], 'delta2': self.deflections[1],
            'tip_x': self.tip[0], 'tip_y': self.tip[1],
            'reference_x': self.reference[0], 'reference_y': self.reference[1],
            'tip_error': error, 'tau1': self.torque[0], 'tau2': self.torque[1],
            'lambda': self.gain,
        }  # fmt: skip
        return {key: value if math.isfinite(value) else None for key, value in named.items()}


class Scene:
    """Makes frames from the newest message of each topic, and stores the tip's trail."""

    def __init__(self, config: RunConfig, trail: int = 600) -> None:
        self.config = self._initial = config
        topics, self._scales = per_tick_topics(config), deflection_scales(config)
        gauges = [i for i, t in enumerate(topics) if t.name == STRAIN]
        self.topics: dict[int, Topic] = {i: topics[i] for i in (*SHOWN, *gauges)}
        self._gauges = gauges[0] if gauges else None
        self._line = ArmLine(config.plant)
        self._size = 2 + 2 * config.plant.modes
        # Once now, so that compilation does not delay the first frame.
        self._line.at(np.zeros(self._size), np.zeros(self._size))
        gain_of(config, 0.0, 0.0)
        self._latest: dict[int, tuple[float, ...]] = {}
        self._stamp_ns = 0
        self._sensed_ns: int | None = None
        self._samples, self._held = 0, 0
        self.trail: deque[Point] = deque(maxlen=trail)
        self.path: deque[Point] = deque(maxlen=trail)

    def take(self, topic: int, data: bytes) -> None:
        """Process a serialized message; one of another layout is ignored."""
        try:
            stamp, values = self.topics[topic].codec.decode_any(data)
        except ValueError:
            return
        if topic == STATE:
            if stamp < self._stamp_ns:  # the run was restarted
                self.trail.clear()
                self.path.clear()
                self.config = self._initial
            self._stamp_ns = stamp
        if topic == TIP:
            self._samples += 1
            self._held += stamp == self._sensed_ns
            self._sensed_ns = stamp
        self._latest[topic] = values

    @property
    def age_s(self) -> float | None:
        """Return the age of the tip sensor's newest measurement, s; None before the first."""
        return None if self._sensed_ns is None else (self._stamp_ns - self._sensed_ns) * 1e-9

    def strain(self) -> dict[str, float | None]:
        """Return the gauges' newest readings by name, None before the first; {} without gauges."""
        if self._gauges is None:
            return {}
        readings = zip(('strain1', 'strain2'), self._pair(self._gauges), strict=True)
        return {name: value if math.isfinite(value) else None for name, value in readings}

    def held_share(self) -> float | None:
        """
        Return the share of ticks without a new tip measurement, 0 to 1, and start to count anew.

        Those are ticks at which the sample was lost, late or not due.  None without a message
        since the last call.
        """
        samples, held = self._samples, self._held
        self._samples = self._held = 0
        return held / samples if samples else None

    def change(self, data: bytes) -> None:
        """Process a parameter change during the run: lambda depends on kn."""
        try:
            period_ns = Timeline.of(self.config.run).period_ns
            self.config = changed(self.config, changes.decode(data, period_ns))
        except ValueError:
            return

    def frame(self) -> Frame | None:
        """Return the current arm; None before its first state or if that is not finite."""
        state = self._latest.get(STATE)
        if state is None or not np.isfinite(state).all():
            return None
        arm = MessageState(state)
        line = self._line.at(arm.q, arm.qd)
        reference = self._pair(REFERENCE)
        ends = arm.ends[:2]
        self.trail.append(line[-1])
        if math.isfinite(reference[0]):
            self.path.append(reference)
        return Frame(
            self._stamp_ns, tuple(line), self._line.elbow, (state[0], state[1]), ends,
            self._pair(TIP), reference, self._pair(COMMAND),
            gain_of(self.config, *self._bends(ends)),
        )  # fmt: skip

    def _bends(self, ends: Point) -> Point:
        """Return the end deflections that the law uses, of those of the plant's state, m."""
        if self._gauges is None or self._scales is None:
            return ends
        first, second = self._pair(self._gauges)
        return first * self._scales[0], second * self._scales[1]

    def _pair(self, topic: int) -> Point:
        values = self._latest.get(topic)
        return (values[0], values[1]) if values is not None else _NONE
