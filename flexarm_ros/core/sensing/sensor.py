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
A sensor as a part of a run: it samples, and a channel delivers the sample later.

A subclass declares NAME, `Parameters`, `signals` and `sample`.  The channel is an object of its
own, created from the section (`Sensor.make_channel`), so that every sensor has the same channels.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TYPE_CHECKING

from flexarm_ros.core.parameters.channel import with_channel
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import Answer, STATE
from flexarm_ros.core.sensing.channel_keys import check_channel, repeats
from flexarm_ros.core.timeline import Timeline

# Numerics are imported when a sensor is created, since every command reads the declarations.
if TYPE_CHECKING:
    from flexarm_ros.core.sensing.channel import Channel


class Measuring(Answer):
    """A part whose measurements travel through ``channel``, by the keys of its section."""

    READS: ClassVar[tuple[str, ...]] = (STATE,)
    LATE = True
    channel: Channel

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for keys of the channel that are invalid together."""
        check_channel(cls.NAME, config.section(cls.NAME), Timeline.of(config.run).period_ns)

    @classmethod
    def holds(cls, config: RunConfig) -> bool:
        """Return whether a sample may be repeated: a rate, jitter or loss."""
        return repeats(config.section(cls.NAME))

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for live parameters that the channel cannot take."""
        self.channel.check(config.section(self.NAME))


class Sensor(Measuring):
    """
    A part that measures at each tick; its first signal has the values of `sample`, in order.

    Its section has the keys of `flexarm_ros.core.parameters.channel.ChannelParameters` beside its
    own.

    ``parameters`` is its section; ``noise`` gives normal numbers, seeded by ``seed`` and the name.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if cls.Parameters is not None:
            cls.Parameters = with_channel(cls.Parameters)

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.noise import Noise

        self.parameters: Any = config.section(self.NAME)
        self.noise = Noise(config.run.seed, self.NAME)
        self.channel = self.make_channel(config)

    def make_channel(self, config: RunConfig) -> Channel:
        """Return what delivers the samples, by the keys of `ChannelParameters`."""
        from flexarm_ros.core.sensing.channel import LatencyChannel

        width = self.signals(config)[0].content.width
        timeline = Timeline.of(config.run)
        return LatencyChannel(self.NAME, self.parameters, timeline, width, config.run.seed)

    def sample(self, k: int, *inputs: Any) -> Sequence[float]:
        """Return the exact values of tick ``k``, from those of `reads`."""
        raise NotImplementedError

    def read(self, values: list[float]) -> Sequence[float]:
        """
        Return what the instrument shows for exact ``values``: noise, resolution, a gain.

        Called once for each sample that arrives; with memory of every tick (a filter): `sample`.
        """
        return values

    def answer(self, k: int, *inputs: Any) -> Any:
        """Return stamp, ns, and the values that the receiver has at tick ``k``."""
        arrived = self.channel.step(k, self.sample(k, *inputs))
        if arrived is not None:
            stamp, values = arrived
            self._held = (stamp, *self.read(list(values)))
        return self._held

    def retune(self, config: RunConfig) -> None:
        """Take the live parameters from the next tick on."""
        self.parameters = config.section(self.NAME)
        self.channel.retune(self.parameters)
