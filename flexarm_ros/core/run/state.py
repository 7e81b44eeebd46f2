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

"""The state of the plant at one tick, as the parts of a run read it, and ticks as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np
from numpy.typing import NDArray

Four = tuple[float, float, float, float]


class State:
    """
    The state of the plant at one tick, as read from ``plant/state``.

    ``q``, ``qd``: coordinates, theta1, theta2 (rad) first, and their rates, shape ``(n,)``;
    ``positions``, ``rates``: the same as Python floats, which are fastest in scalar code;
    ``ends``: delta1, delta2 (m) and their rates (m/s).
    """

    __slots__ = ('ends', 'positions', 'q', 'qd', 'rates')

    def __init__(self, q: FloatArray, qd: FloatArray, ends: Four) -> None:
        self.q, self.qd, self.ends = q, qd, ends
        self.positions: list[float] = q.tolist()
        self.rates: list[float] = qd.tolist()

    def values(self) -> tuple[float, ...]:
        """Return the values of the message: coordinates, deflections, then the rates of both."""
        return (*self.positions, *self.ends[:2], *self.rates, *self.ends[2:])


class MessageState(State):
    """A state from the values of its message; arrays are created on access."""

    __slots__ = ()

    def __init__(self, values: Sequence[float]) -> None:
        size = len(values) // 2 - 2
        rates = size + 2
        self.positions = list(values[:size])
        self.rates = list(values[rates : rates + size])
        self.ends = (values[size], values[size + 1], values[-2], values[-1])

    @property
    def q(self) -> FloatArray:  # type: ignore[override]
        """Return the coordinates."""
        return np.array(self.positions)

    @property
    def qd(self) -> FloatArray:  # type: ignore[override]
        """Return the rates."""
        return np.array(self.rates)


@dataclass(frozen=True)
class Block:
    """
    Complete ticks ``first``, ``first + 1``, ... of a run.

    For each signal, in the order of `flexarm_ros.core.run.parts.signals`: ``stamps``, shape
    ``(n,)``, ns, and ``values``, shape ``(n, fields)``.
    """

    first: int
    stamps: tuple[NDArray[np.int64], ...]
    values: tuple[FloatArray, ...]

    def __len__(self) -> int:
        return len(self.stamps[0])
