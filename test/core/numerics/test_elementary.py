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

"""The elementary functions of the core: within 1 ulp, and the same bits interpreted."""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
import random
from typing import Any

from flexarm_ros.core.numerics import elementary
import pytest

mpmath = pytest.importorskip('mpmath')

HUGE = 2.0**1023
# Doubles that are nearly a multiple of pi / 2 (the first: the nearest of all, to 2^-60).
NEAR_TURNS = (
    6381956970095103.0 * 2.0**797,
    5.319372648326541e255,
    1e22,
    1e6,
    1.7976931348623157e308,
)


def ulps(found: float, true: Any) -> float:
    """Return the error in units in the last place of the true value."""
    exponent = math.frexp(float(true))[1]
    return float(abs(mpmath.mpf(found) - true) / mpmath.mpf(2) ** max(exponent - 53, -1074))


def spread(draw: random.Random, low: int, high: int, count: int) -> Iterator[float]:
    """Yield numbers of both signs, exponents from ``low`` to ``high`` equally likely."""
    for _ in range(count):
        size = math.ldexp(draw.uniform(1.0, 2.0), draw.randint(low, high))
        yield draw.choice((-1.0, 1.0)) * size


def angles() -> Iterator[float]:
    draw = random.Random(1)
    yield from (k * 0.5 * math.pi for k in range(-200, 200))
    for low, high, count in ((-30, 4, 2000), (4, 22, 800), (-1070, 1022, 400)):
        yield from spread(draw, low, high, count)
    for near in NEAR_TURNS:
        yield from (near, -near)


def pairs(low: int, high: int, count: int) -> Iterator[tuple[float, float]]:
    draw = random.Random(2)
    yield from zip(spread(draw, low, high, count), spread(draw, low, high, count), strict=True)


def test_sine_and_cosine() -> None:
    with mpmath.workprec(2600):
        for x in angles():
            sine, cosine = elementary.sincos(x)
            assert ulps(sine, mpmath.sin(x)) < 1.0, x
            assert ulps(cosine, mpmath.cos(x)) < 1.0, x


def test_exp_and_log() -> None:
    draw = random.Random(3)
    exponents = [draw.uniform(-745.0, 709.78) for _ in range(1000)]
    exponents += [draw.uniform(-1.0, 1.0) for _ in range(1000)]
    numbers = [abs(x) for x in spread(draw, -1074, 1023, 1000)]
    numbers += [draw.uniform(0.5, 2.0) for _ in range(1000)]
    with mpmath.workprec(300):
        for x in exponents:
            assert ulps(elementary.exp(x), mpmath.exp(x)) < 1.0, x
        for x in numbers:
            assert ulps(elementary.log(x), mpmath.log(x)) < 1.0, x


def test_angles_of_points() -> None:
    with mpmath.workprec(300):
        for y, x in (*pairs(-4, 4, 1500), *pairs(-1074, 1022, 700)):
            assert ulps(elementary.atan2(y, x), mpmath.atan2(y, x)) < 1.0, (y, x)
        draw = random.Random(4)
        for x in [draw.uniform(-1.0, 1.0) for _ in range(1000)]:
            assert ulps(elementary.acos(x), mpmath.acos(x)) < 1.0, x
        for tiny in spread(draw, -53, -2, 500):
            x = math.copysign(1.0 - abs(tiny), tiny)
            assert ulps(elementary.acos(x), mpmath.acos(x)) < 1.0, x


def alike(a: float, b: float) -> bool:
    """Return whether doubles agree: in kind, in sign (of zero too) and but for their last bits."""
    if a != a or b != b:
        return a != a and b != b
    near = a == b or abs(a - b) <= 1e-15 * abs(b)
    return near and math.copysign(1.0, a) == math.copysign(1.0, b)


SPECIAL = (0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan, 5e-324, -2.5, HUGE)


@pytest.mark.parametrize('y', SPECIAL)
def test_special_values_as_the_standard_has_them(y: float) -> None:
    for x in SPECIAL:
        assert alike(elementary.atan2(y, x), math.atan2(y, x)), (y, x)
    sine, cosine = elementary.sincos(y)
    assert alike(sine, math.sin(y) if math.isfinite(y) else math.nan)
    assert alike(cosine, math.cos(y) if math.isfinite(y) else math.nan)
    assert alike(elementary.log(y), math.log(y) if y > 0.0 else -math.inf if y == 0 else math.nan)
    assert alike(elementary.acos(y), math.acos(y) if abs(y) <= 1.0 else math.nan)
    assert alike(elementary.exp(y), math.inf if y == HUGE else math.exp(y))


def test_ends_of_the_range_of_exp() -> None:
    last = 709.782712893384
    assert elementary.exp(last) < math.inf == elementary.exp(math.nextafter(last, 800.0))
    assert elementary.exp(-745.13321910194) == 5e-324
    assert elementary.exp(-745.2) == 0.0


@pytest.mark.parametrize('name', ['sincos', 'exp', 'log', 'atan2', 'acos'])
def test_interpreted_bits_are_the_compiled_ones(name: str) -> None:
    compiled: Any = getattr(elementary, name)
    interpreted: Callable[..., Any] = compiled.py_func
    for y, x in pairs(-3, 20, 1500):
        if name == 'atan2':
            assert interpreted(y, x) == compiled(y, x), (y, x)
        elif name == 'acos':
            assert interpreted(y / 2.0**21) == compiled(y / 2.0**21), y
        else:
            x = abs(y) if name == 'log' else y / 1e4 if name == 'exp' else y
            assert interpreted(x) == compiled(x), x
