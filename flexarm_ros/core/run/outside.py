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
Parts and laws of other packages in a run: their errors name the part and the tick.

Their messages are checked at each tick, as those between nodes are, so that a part that is wrong
ends the run alike in one process and with nodes.
"""

from __future__ import annotations

import math
from operator import index
from typing import Any

from flexarm_ros.core.parameters.sections import OWN_LAWS, RunConfig
from flexarm_ros.core.run.part import Answer, COMMAND
from flexarm_ros.core.signals import Signal


class PartError(RuntimeError):
    """A part or law from outside this package has raised, or its message is invalid."""


def make_part(kind: type[Answer], config: RunConfig) -> Answer:
    """Create a part; PartError if one from outside this package, or a law, cannot be created."""
    own_law = config.controller.law in OWN_LAWS and kind.NAME == 'controller'
    if kind.__module__.partition('.')[0] == __name__.partition('.')[0] and not own_law:
        return kind(config)
    try:
        part = kind(config)
    except Exception as error:
        raise PartError(f'{kind.NAME}: {_described(error)}') from error
    part.answer = _Checked(part, config)  # type: ignore[method-assign]
    return part


class _Checked:
    """The answers of ``part``, checked."""

    def __init__(self, part: Answer, config: RunConfig) -> None:
        self._part, self._answer, self._late = part, part.answer, part.LATE
        self._signals = (*part.signals(config), *part.further_signals(config))

    def __call__(self, k: int, *inputs: Any) -> Any:
        try:
            answer = self._answer(k, *inputs)
            messages = answer if len(self._signals) > 1 else (answer,)
            for signal, message in zip(self._signals, messages, strict=True):
                self._check(signal, message)
        except Exception as error:
            raise PartError(f'{self._part.title}: tick {k}: {_described(error)}') from error
        return answer

    def _check(self, signal: Signal, message: Any) -> None:
        """Raise ``ValueError`` or ``TypeError`` for a message that no node could send."""
        values = message[1:] if self._late else message
        if self._late:
            index(message[0])
        if len(values) != signal.content.width:
            raise ValueError(
                f'{len(values)} values for {signal.name}, which has {signal.content.width}'
            )
        # A torque that is not finite makes the run unstable, which `Answer.fault` describes.
        if not all(map(math.isfinite, values)) and signal.name != COMMAND:
            raise ValueError(f'a value for {signal.name} is not finite: {tuple(values)}')


def _described(error: Exception) -> str:
    return f'{type(error).__name__}: {error}'
