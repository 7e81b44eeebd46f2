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
The answering parts of a run, connected in one process.

Errors of parts and laws of other packages name the part and the tick.  Their messages are checked
at each tick, as those between nodes are, so that a part that is wrong ends the run alike in one
process and with nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from operator import index, itemgetter
from typing import Any

from flexarm_ros.core.parameters.sections import OWN_LAWS, RunConfig
from flexarm_ros.core.run.part import Answer, COMMAND, STATE
from flexarm_ros.core.run.parts import answering, signals
from flexarm_ros.core.run.state import State
from flexarm_ros.core.signals import Signal
from flexarm_ros.core.timeline import Timeline

Step = Callable[[int], None]


class Answers:
    """
    The answering parts of one run, connected in one process.

    ``messages`` are those of the last tick, in the order of `signals`, ``LATE`` ones with their
    stamp; the first two are the plant's: none, and the `State`.
    """

    def __init__(self, config: RunConfig) -> None:
        self.parts = {part.NAME: make_part(part, config) for part in answering(config)}
        wired = signals(config)
        self.places = place = {signal.name: i for i, (_, signal) in enumerate(wired)}
        """Topic -> index in ``messages``."""
        self.late = [part.LATE for part, _ in wired]
        """Whether each of ``messages`` has its stamp."""
        self.messages: list[Any] = [None] * len(wired)
        self._inputs: list[Any] = [None] * len(wired)
        self._state = place[STATE]
        self._steps: list[Step] = []
        for part in self.parts.values():
            writes = [i for i, (owner, _) in enumerate(wired) if owner is type(part)]
            reads = [place[name] for name in part.reads(config)]
            self._steps.append(self._step(part, reads, writes))

    def _step(self, part: Answer, reads: Sequence[int], writes: Sequence[int]) -> Step:
        """Return the function that lets ``part`` answer a tick; by number of inputs, for speed."""
        answer, messages, inputs = part.answer, self.messages, self._inputs
        first, late = writes[0], part.LATE

        def several(k: int) -> None:
            answers = answer(k, *[inputs[i] for i in reads])
            for place, message in zip(writes, answers, strict=True):
                messages[place] = message
                inputs[place] = message[1:] if late else message

        def sensor(k: int) -> None:
            messages[first] = message = answer(k, inputs[only])
            inputs[first] = message[1:]

        def late_of_some(k: int) -> None:
            messages[first] = message = answer(k, *pick(inputs))
            inputs[first] = message[1:]

        def of_some(k: int) -> None:
            messages[first] = inputs[first] = answer(k, *pick(inputs))

        def of_none(k: int) -> None:
            messages[first] = inputs[first] = answer(k)

        if len(writes) > 1:
            return several
        only = reads[0] if reads else 0
        pick = itemgetter(*reads) if len(reads) > 1 else itemgetter(slice(only, only + len(reads)))
        if late:
            return sensor if len(reads) == 1 else late_of_some
        return of_some if reads else of_none

    def tell(self, place: int, values: tuple[float, ...]) -> None:
        """Give the parts another message of the plant, before `tick`."""
        self.messages[place] = self._inputs[place] = values

    def tick(self, k: int, state: State) -> tuple[Any, ...]:
        """Let every part answer ``state`` of tick ``k``; return the messages."""
        self.messages[self._state] = self._inputs[self._state] = state
        for step in self._steps:
            step(k)
        return tuple(self.messages)

    def retune(self, config: RunConfig) -> None:
        """Apply the live parameters of ``config`` to every part."""
        for part in self.parts.values():
            part.retune(config)


ANY_ERROR = (Exception, SystemExit, KeyboardInterrupt)
"""
What the code of a law or part may raise.

In a node's process the last two come from nothing else, as signals have handlers there.
"""


class PartError(RuntimeError):
    """A part or law from outside this package raised an error, or its message is invalid."""


class PartInterrupt(KeyboardInterrupt):
    """KeyboardInterrupt within a part or law from outside: raised by it, or by the user."""


def make_part(kind: type[Answer], config: RunConfig) -> Answer:
    """Create a part; PartError if one from outside this package, or a law, cannot be created."""
    own_law = config.controller.law in OWN_LAWS and kind.NAME == 'controller'
    if kind.__module__.partition('.')[0] == __name__.partition('.')[0] and not own_law:
        return kind(config)
    source = _source(_law(config) if own_law else kind)
    try:
        part = kind(config)
    except ANY_ERROR as error:
        raise _failure(kind.NAME, error, source) from error
    part.answer = _Checked(part, config, source)  # type: ignore[method-assign]
    return part


class _Checked:
    """The answers of ``part``, checked."""

    def __init__(self, part: Answer, config: RunConfig, source: str) -> None:
        self._part, self._answer, self._late, self._source = part, part.answer, part.LATE, source
        self._timeline = Timeline.of(config.run)
        self._signals = (*part.signals(config), *part.further_signals(config))
        self._single = len(self._signals) == 1
        self._width = self._signals[0].content.width
        self._plain = self._single and not part.LATE

    def __call__(self, k: int, *inputs: Any) -> Any:
        try:
            answer = self._answer(k, *inputs)
            if self._plain and len(answer) == self._width and all(map(math.isfinite, answer)):
                return answer  # as below, in less time
            messages = (answer,) if self._single else answer
            for signal, message in zip(self._signals, messages, strict=True):
                self._check(k, signal, message)
        except ANY_ERROR as error:
            raise _failure(f'{self._part.title}: tick {k}', error, self._source) from error
        return answer

    def _check(self, k: int, signal: Signal, message: Any) -> None:
        """Raise ``ValueError`` or ``TypeError`` for a message that no node could send."""
        values = message[1:] if self._late else message
        if self._late and index(message[0]) > (now := self._timeline.stamp_ns(k)):
            raise ValueError(
                f'stamp {message[0]} ns of {signal.name} is after that of the tick, {now} ns'
            )
        if len(values) != signal.content.width:
            raise ValueError(
                f'{len(values)} values for {signal.name}, which has {signal.content.width}'
            )
        # A torque that is not finite makes the run unstable, which `Answer.fault` describes.
        if not all(map(math.isfinite, values)) and signal.name != COMMAND:
            raise ValueError(f'a value for {signal.name} is not finite: {tuple(values)}')


def _law(config: RunConfig) -> type:
    from flexarm_ros.core.control import LAWS

    return LAWS[config.controller.law]


def _source(kind: type) -> str:
    """Return where a class is defined, as an entry point names it."""
    return f'{kind.__module__}:{kind.__qualname__}'


def _failure(where: str, error: BaseException, source: str) -> PartError | PartInterrupt:
    kind = PartInterrupt if isinstance(error, KeyboardInterrupt) else PartError
    said = ': '.join(filter(None, (type(error).__name__, str(error))))
    return kind(f'{where}: {said} ({source})')
