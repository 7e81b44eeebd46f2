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
Delay lines of exact, fractional length for a signal sampled once per tick.

``buffer``: the output at tick k is the input at t_k - latency, interpolated linearly between
ticks; the latency is split into whole ticks and a remainder in integer nanoseconds, so that
nothing is rounded.  Before the start the signal has its initial value.

``pade2``: the second-order Pade approximation of exp(-s tau) that the paper
uses (its section 3)::

    H(s) = (1 - s tau / 2 + (s tau)^2 / 12) / (1 + s tau / 2 + (s tau)^2 / 12),

exact for an input that is linear between ticks (ramp-invariant), starting in equilibrium at the
initial value.  |H(jw)| = 1 at every frequency; its step response starts at +1, reverses, and
settles: this nonminimum phase is that of the approximation, a pure delay has none.

The latency may be changed between ticks.  The output at a tick always corresponds to the latency
at that tick: if it grows, the time of measurement steps back once (older values are delivered
again); if it shrinks, values are skipped.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from flexarm_ros.core.numerics.compiled import bound, compiled, FloatArray, inlined
from flexarm_ros.core.numerics.elementary import exp, sincos
import numpy as np

CHANNELS = 4
"""Values per sample: two positions and their rates."""

HISTORY_NS = 1_000_000_000
"""History that is kept if the tick allows it, and so the largest live latency."""

MOST_SAMPLES = 1 << 16
"""Most ticks of history that are kept for live changes of the latency."""

NO_LIMIT_NS = 1 << 62

_NO_RING, _NO_STATE = np.zeros((0, CHANNELS)), np.zeros((3, CHANNELS))
_NO_MATRICES = np.zeros((2, 4))

Sample4 = tuple[float, float, float, float]


class Line(NamedTuple):
    """
    A delay line for compiled code; `delayed` takes it.

    ``ring``, ``whole``, ``part``: of a `BufferDelay`, ``ring`` of shape (0, 4) for the other;
    ``state``, ``matrices``, ``direct``: of a `PadeDelay`.
    """

    ring: FloatArray
    whole: int
    part: float
    state: FloatArray
    matrices: FloatArray
    direct: bool


class BufferDelay:
    """A ring buffer of past samples, read at an exact age."""

    def __init__(self, period_ns: int, latency_ns: int) -> None:
        self._period_ns = period_ns
        wanted = min(-(-HISTORY_NS // period_ns), MOST_SAMPLES)
        self._capacity = max(wanted, latency_ns // period_ns) + 2
        self._ring: FloatArray = np.zeros((self._capacity, CHANNELS))
        self.most_ns = (self._capacity - 2) * period_ns
        """Largest latency that may be set."""
        self.set_latency_ns(latency_ns)

    def set_latency_ns(self, latency_ns: int) -> None:
        """Change the latency from the next tick on; ``ValueError`` beyond the history kept."""
        whole, rest = divmod(latency_ns, self._period_ns)
        if latency_ns < 0 or whole > self._capacity - 2:
            raise ValueError(f'{latency_ns} ns, allowed: 0 to {self.most_ns} ns')
        self._whole, self._part = whole, rest / self._period_ns
        self.__dict__.pop('step', None)

    def step(self, k: int, a: float, b: float, c: float, d: float) -> Sample4:
        """Add the sample of tick ``k`` and return the delayed one; k = 0, 1, 2, ..."""
        held = self._ring, self._whole, self._part
        found = bound(through_ring, *held, example=(0, *[0.0] * 4))
        self.step = found  # type: ignore[method-assign]
        result: Sample4 = found(k, a, b, c, d)
        return result

    def stored(self, k: int, part: float) -> list[float]:
        """Return the stored sample of ``part`` of a tick before tick ``k``."""
        newer, older = (self._ring[max(at, 0) % self._capacity] for at in (k, k - 1))
        sample = newer if part == 0.0 else (1.0 - part) * newer + part * older
        found: list[float] = sample.tolist()
        return found

    def record(self) -> Line:
        """Return the line for compiled code, at the latency of this tick."""
        return Line(self._ring, self._whole, self._part, _NO_STATE, _NO_MATRICES, False)


@compiled
def through_ring(
    ring: FloatArray, whole: int, part: float, k: int, a: float, b: float, c: float, d: float
) -> Sample4:
    """Put the sample of tick ``k`` into ``ring`` and return the one of ``whole + part`` ago."""
    size = ring.shape[0]
    here = k % size
    ring[here, 0], ring[here, 1], ring[here, 2], ring[here, 3] = a, b, c, d
    # One division: `whole` is less than the size of the ring.  Before tick 0 is tick 0.
    newer = here - whole if here >= whole else here - whole + size
    newer = newer if k >= whole else 0
    # For a whole number of ticks the sample itself is delivered, bit for bit.
    if part == 0.0:
        return ring[newer, 0], ring[newer, 1], ring[newer, 2], ring[newer, 3]
    older = newer - 1 if newer > 0 else size - 1
    older, rest = older if k > whole else 0, 1.0 - part
    return (
        rest * ring[newer, 0] + part * ring[older, 0],
        rest * ring[newer, 1] + part * ring[older, 1],
        rest * ring[newer, 2] + part * ring[older, 2],
        rest * ring[newer, 3] + part * ring[older, 3],
    )


class PadeDelay:
    """The second-order Pade approximation of a delay, discretised ramp-invariantly."""

    def __init__(self, period_ns: int, latency_ns: int) -> None:
        self._period_ns = period_ns
        self._state: FloatArray = np.zeros((3, CHANNELS))
        self.most_ns = NO_LIMIT_NS
        self.set_latency_ns(latency_ns)

    def set_latency_ns(self, latency_ns: int) -> None:
        """
        Change the latency from the next tick on; the state is kept.

        A signal at rest stays at rest, since the equilibrium of the states
        is independent of the latency.
        """
        if latency_ns < 0:
            raise ValueError(f'{latency_ns} ns, must be 0 or more')
        self._direct = latency_ns == 0
        self._matrices = pade2_matrices(self._period_ns / latency_ns if latency_ns else math.inf)

    def step(self, k: int, a: float, b: float, c: float, d: float) -> Sample4:
        """Add the sample of tick ``k`` and return the delayed one; k = 0, 1, 2, ..."""
        result: Sample4 = through_pade(
            self._state, self._matrices, self._direct, k == 0, a, b, c, d
        )
        return result

    def record(self) -> Line:
        """Return the line for compiled code, at the latency of this tick."""
        return Line(_NO_RING, 0, 0.0, self._state, self._matrices, self._direct)


def pade2_matrices(ratio: float) -> FloatArray:
    """
    Return the discrete matrices of the approximation, shape ``(2, 4)``.

    ``ratio`` is tick / latency.  With time in units of the latency and states
    z1, z2 = z1': z2' = 12 (u - z1) - 6 z2 and output u - z2, so that at rest
    z1 = u and z2 = 0 for any latency.  Row i has the coefficients of z_i after
    a tick: of z1, z2, and of the input at the tick's start and end, which is
    linear between them.
    """
    if math.isinf(ratio):
        return np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 0.0]])
    # Poles -3 +- i sqrt(3): z1 of a free motion is e^(-3r) (cos wr + ...).
    omega = math.sqrt(3.0)
    fall = exp(-3.0 * ratio)
    sine, cosine = sincos(omega * ratio)
    cosine, sine = fall * cosine, fall * sine / omega
    free = np.array([[cosine + 3.0 * sine, sine], [-12.0 * sine, cosine - 3.0 * sine]])
    # A ramp input u = u0 + g t is followed by z1 = u - g / 2, z2 = g.
    return ramp_invariant(free, np.array([-0.5, 1.0]) / ratio)


def ramp_invariant(free: FloatArray, lag: FloatArray) -> FloatArray:
    """
    Return the step of two states for an input u that is linear over a step, shape ``(2, 4)``.

    ``free`` (2, 2): the step without input.  ``lag`` (2,): what both states are, beside (u, 0),
    on a ramp that rises by 1 a step; the difference from it decays as a free motion.  Columns:
    both states, the input at the step's start and end.
    """
    matrix = np.zeros((2, 4))
    matrix[:, :2] = free
    start = free[:, 0] * -1.0 + (free[:, 0] * lag[0] + free[:, 1] * lag[1])
    matrix[:, 2] = start - lag
    matrix[:, 3] = lag - (free[:, 0] * lag[0] + free[:, 1] * lag[1])
    matrix[0, 3] += 1.0
    return matrix


@compiled
def through_pade(
    state: FloatArray, m: FloatArray, direct: bool, first: bool,
    a: float, b: float, c: float, d: float,
) -> Sample4:  # fmt: skip
    """Step the approximation from tick to tick; ``direct``: the latency is 0."""
    for i, value in enumerate((a, b, c, d)):
        if first:
            state[0, i], state[1, i] = value, 0.0
        else:
            z1, z2, last = state[0, i], state[1, i], state[2, i]
            state[0, i] = m[0, 0] * z1 + m[0, 1] * z2 + m[0, 2] * last + m[0, 3] * value
            state[1, i] = m[1, 0] * z1 + m[1, 1] * z2 + m[1, 2] * last + m[1, 3] * value
        state[2, i] = value
    if direct:
        return a, b, c, d
    return a - state[1, 0], b - state[1, 1], c - state[1, 2], d - state[1, 3]


@inlined
def delayed(line: Line, k: int, a: float, b: float, c: float, d: float) -> Sample4:
    """Add the sample of tick ``k`` and return the delayed one, through either kind of line."""
    if line.ring.shape[0] == 0:
        return through_pade(line.state, line.matrices, line.direct, k == 0, a, b, c, d)
    return through_ring(line.ring, line.whole, line.part, k, a, b, c, d)
