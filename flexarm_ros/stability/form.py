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

"""A control law, linearised about rest, as matrices: :class:`LinearLaw`."""

from __future__ import annotations

from dataclasses import dataclass, replace

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np

_SENSED = 8
"""Channels of encoder and tip sensor."""


class NoLinearFormError(ValueError):
    """The law has no linear form."""


@dataclass(frozen=True)
class LinearLaw:
    """
    A law about rest: s+ = a s + b u, tau = c s + d u, deviations from equilibrium.

    ``a`` ``(m, m)``, ``b`` ``(m, i)``, ``c`` ``(2, m)``, ``d`` ``(2, i)``; u
    has i = 2 n + 8 or 2 n + 10 entries: the plant's n coordinates and n rates of this
    tick, then the encoder's (theta1, theta2 and their rates) and the tip
    sensor's (x, y, vx, vy in frame ``base``) samples as delivered, and, for a law that reads them,
    delta1 and delta2 (m) as delivered: those of ``controller.deflection_source``.  ``gain``
    is a common factor of the torques: K_s lambda of (21), otherwise 1.
    """

    a: FloatArray
    b: FloatArray
    c: FloatArray
    d: FloatArray
    gain: float = 1.0

    def scaled(self, factor: float) -> LinearLaw:
        """Return the law with both torques multiplied by ``factor``."""
        return replace(self, c=factor * self.c, d=factor * self.d, gain=factor * self.gain)

    def reads_deflections(self, coordinates: int) -> bool:
        """Return whether u has the deflections; ``coordinates``: n."""
        return bool(self.d.shape[1] > 2 * coordinates + _SENSED)

    def padded(self, coordinates: int) -> LinearLaw:
        """Return the law with the deflections among its inputs; ``coordinates``: n."""
        more = ((0, 0), (0, 2 * coordinates + _SENSED + 2 - self.d.shape[1]))
        return replace(self, b=np.pad(self.b, more), d=np.pad(self.d, more))

    @classmethod
    def static(cls, d: FloatArray) -> LinearLaw:
        """Return the law tau = d u."""
        inputs = d.shape[1]
        return cls(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((2, 0)), d)
