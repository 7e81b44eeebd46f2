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

"""Consecutive ticks of a run as arrays."""

from __future__ import annotations

from dataclasses import dataclass

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np
from numpy.typing import NDArray


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
