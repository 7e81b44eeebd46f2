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
Random numbers with defined bits, seeded by ``seed`` and a name.

They are computed from the bits of numpy's PCG64, so that they are the same in every process
layout.  NumPy keeps the bit sequence between versions, but not its normal numbers, which also
depend on the C library's logarithm.
"""

from __future__ import annotations

import math

from flexarm_ros.core.numerics.compiled import compiled, FloatArray
from flexarm_ros.core.numerics.elementary import log
import numpy as np

_BLOCK = 512


def bit_stream(seed: int, name: str) -> np.random.PCG64:
    """Return the source of bits that belongs to ``seed`` and ``name``."""
    return np.random.PCG64(np.random.SeedSequence(seed, spawn_key=tuple(name.encode())))


class Uniform:
    """Numbers from 0 to below 1, drawn in order."""

    def __init__(self, seed: int, name: str) -> None:
        self._bits = bit_stream(seed, name)
        self._block: list[float] = []

    def __call__(self) -> float:
        """Return the next number of the sequence."""
        if not self._block:
            bits = self._bits.random_raw(_BLOCK)
            self._block = ((bits >> np.uint64(11)).astype(float) * 2.0**-53)[::-1].tolist()
        return self._block.pop()


class Noise:
    """Pairs of independent standard normal numbers, drawn in order."""

    def __init__(self, seed: int, name: str) -> None:
        self._bits = bit_stream(seed, name)
        self._block: list[list[float]] = []

    def pair(self) -> tuple[float, float]:
        """Return the next two numbers of the sequence."""
        while not self._block:
            self._block = self._next_block()[::-1].tolist()
        first, second = self._block.pop()
        return first, second

    def pairs(self, count: int) -> FloatArray:
        """Return the numbers of ``count`` calls of `pair`, shape ``(count, 2)``."""
        blocks = [np.array(self._block[::-1]).reshape(-1, 2)]
        while len(drawn := np.concatenate(blocks)) < count:
            blocks.append(self._next_block())
        self._block = drawn[count:][::-1].tolist()
        return drawn[:count]

    def _next_block(self) -> FloatArray:
        bits = self._bits.random_raw((_BLOCK, 2))
        # The upper 53 bits as a number from -1 to 1, exactly.
        points: FloatArray = (bits >> np.uint64(11)).astype(float) * 2.0**-52 - 1.0
        return points[: make_normal(points)]


@compiled
def make_normal(points: FloatArray) -> int:
    """
    Replace ``points`` ``(n, 2)`` of the square from -1 to 1 by pairs of normal numbers.

    Each point within the unit circle gives a pair (Marsaglia's polar method);
    the pairs come first in ``points``, in order.  Returns their number.
    """
    count = 0
    for i in range(points.shape[0]):
        x, y = points[i, 0], points[i, 1]
        square = x * x + y * y
        if 0.0 < square < 1.0:
            factor = math.sqrt(-2.0 * log(square) / square)
            points[count, 0], points[count, 1] = x * factor, y * factor
            count += 1
    return count
