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

A subclass declares NAME, `Parameters`, `signals` and `sample`.  The channel is a piece of its own,
put in by the declaration (`Sensor.make_channel`), so that each sensor has the same ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar, TYPE_CHECKING

from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.part import Answer, STATE
from flexarm_ros.core.timeline import named_ns, Timeline

# What a sensor computes with is imported when it is made: declarations are read by each command.
if TYPE_CHECKING:
    from flexarm_ros.core.sensing.channel import Channel


class Sensor(Answer):
    """
    A part that measures at each tick; its first signal has the values of `sample`, in order.

    ``parameters`` is its section; ``noise`` gives normal numbers, seeded by ``seed`` and the name.
    """

    READS: ClassVar[tuple[str, ...]] = (STATE,)
    LATE = True

    def __init__(self, config: RunConfig) -> None:
        from flexarm_ros.core.sensing.sensors import Noise

        self.parameters: Any = config.section(self.NAME)
        self.noise = Noise(config.run.seed, self.NAME)
        self.channel = self.make_channel(config)

    @classmethod
    def check(cls, config: RunConfig) -> None:
        """Raise ``ValueError`` for a latency that is not a whole number of nanoseconds."""
        named_ns(f'{cls.NAME}.latency', getattr(config.section(cls.NAME), 'latency', 0.0))

    def make_channel(self, config: RunConfig) -> Channel:
        """Return what delivers the samples: a latency, if the section has that key."""
        from flexarm_ros.core.sensing.channel import LatencyChannel

        width = self.signals(config)[0].content.width
        return LatencyChannel(self.NAME, self.parameters, Timeline.of(config.run), width)

    def sample(self, k: int, *inputs: Any) -> Sequence[float]:
        """Return the exact values of tick ``k``, from those of `reads`."""
        raise NotImplementedError

    def read(self, values: list[float]) -> Sequence[float]:
        """Return what the instrument shows for exact ``values``: noise, resolution, a gain."""
        return values

    def answer(self, k: int, *inputs: Any) -> Any:
        """Return stamp, ns, and the values as delivered at tick ``k``."""
        stamp, values = self.channel.step(k, self.sample(k, *inputs))
        return (stamp, *self.read(values))

    def check_live(self, config: RunConfig) -> None:
        """Raise ``ValueError`` for live parameters that the channel cannot take."""
        self.channel.check(config.section(self.NAME))

    def retune(self, config: RunConfig) -> None:
        """Take the live parameters from the next tick on."""
        self.parameters = config.section(self.NAME)
        self.channel.retune(self.parameters)
