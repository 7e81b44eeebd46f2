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
Elementary functions with defined bits: the same on every machine.

IEEE 754 defines the last bit of +, -, *, / and sqrt only.  The sine of the C library differs
between its versions and, within one version, between processors; NumPy's differs with the vector
unit.  So all numbers of a run use these functions, which consist of the five operations in a
fixed order.  The compiler may not change that order or fuse two operations:
:mod:`flexarm_ros.core.numerics.compiled` disables fast-math and contraction.  Compiled and
interpreted code give equal bits.

Each is within 1 ulp of the true value for every finite argument; NaN, infinities and signed zeros
are as in IEEE 754-2008, section 9.2.  The methods are standard (Muller, Elementary Functions, 3rd
edition, 2016): a reduction of the argument with an error term, then a Taylor series on an
interval so short that its remainder is far below one ulp.

``test/core/numerics/test_elementary.py`` checks them against mpmath.
"""

from __future__ import annotations

import math

from flexarm_ros.core.numerics.compiled import compiled, internal
import numpy as np

_QUARTER_PI = math.pi / 4.0
_TWO_OVER_PI = 0.6366197723675814
# pi / 2 in parts: three of 33 bits, so that their products with a number of quarter turns
# below 2^20 are exact, and the rest.
_TURN_1, _TURN_2 = 1.5707963267341256, 6.077100506303966e-11
_TURN_3, _TURN_4 = 2.0222662487111665e-21, 8.4784276603689e-32
_MANY_TURNS = 1e6  # largest argument for which that holds, with a margin
_FEW_TURNS = 1e4  # largest argument for which the last two parts may be one
_TURN_3_AND_4 = 2.0222662487959506e-21
_HALF_PI, _HALF_PI_LOW = 1.5707963267948966, 6.123233995736766e-17
_PI, _PI_LOW = 3.141592653589793, 1.2246467991473532e-16
# Adding and subtracting it gives the nearest integer, halves to even.
_ROUNDER = 6755399441055744.0  # 1.5 * 2^52
_SPLITTER = 134217729.0  # 2^27 + 1
_BASE, _BASE_INVERSE = 16777216.0, 1.0 / 16777216.0  # 2^24

# 2 / pi in digits of 24 bits, enough for the largest double.
_DIGITS = np.array([
    10680707, 7228996, 1387004, 2578385, 16069853, 12639074, 9804092, 4427841, 16666979, 11263675,
    12935607, 2387514, 4345298, 14681673, 3074569, 13734428, 16653803, 1880361, 10960616, 8533493,
    3062596, 8710556, 7349940, 6258241, 3772886, 3769171, 3798172, 8675211, 12450088, 3874808,
    9961438, 366607, 15675153, 9132554, 7151469, 3571407, 2607881, 12013382, 4155038, 6285869,
    7677882, 13102053, 15825725, 473591, 9065106, 15363067, 6271263, 9264392, 5636912, 4652155,
], dtype=float)  # fmt: skip

_LN2, _LN2_LOW = 0.6931471803691238, 1.9082149292705877e-10  # the first has 32 bits
_LN2_INVERSE = 1.4426950408889634

# The arc tangents of 0, 1/16, ..., 1 and their rounding errors.
_ARCS = np.array([
    0.0, 0.06241880999595735, 0.12435499454676144, 0.18534794999569476, 0.24497866312686414,
    0.3028848683749714, 0.35877067027057225, 0.4124104415973873, 0.4636476090008061,
    0.5123894603107377, 0.5585993153435624, 0.6022873461349642, 0.6435011087932844,
    0.6823165548747481, 0.7188299996216245, 0.7531512809621944, 0.7853981633974483,
])  # fmt: skip
_ARCS_LOW = np.array([
    0.0, -1.5490756308295046e-18, -3.1253241424539383e-18, 4.180692268843079e-18,
    1.0698755618734451e-17, -1.1010827903001369e-17, -2.4623815582638635e-17,
    -1.587652227770689e-17, 2.2698777452961687e-17, -2.5462781472855804e-17,
    -5.4556305485916264e-18, 2.950430737228402e-17, 1.5834785051444286e-17,
    6.943223671560008e-18, -2.1478388444456983e-17, -2.4256934659182068e-17,
    3.061616997868383e-17,
])  # fmt: skip


@compiled
def sincos(x: float) -> tuple[float, float]:
    """Return sine and cosine of ``x`` rad."""
    size = abs(x)
    if size <= _QUARTER_PI:
        if size < 1e-8:  # keeps the sign of zero
            return x, 1.0
        return _series(x, 0.0)
    if size <= _MANY_TURNS:
        turns = (x * _TWO_OVER_PI + _ROUNDER) - _ROUNDER
        quadrant = int(turns) & 3
        # The first difference is exact; the others leave their rounding errors.
        first = x - turns * _TURN_1
        third, lost = _two_sum(first, -(turns * _TURN_2))
        if size <= _FEW_TURNS and abs(third) > 1e-8:
            return _turned(quadrant, third, lost - turns * _TURN_3_AND_4)
        third, lost3 = _two_sum(third, -(turns * _TURN_3))
        rest = (lost + lost3) - turns * _TURN_4
    elif size < math.inf:
        quadrant, third, rest = _reduce_huge(size)
        if x < 0.0:
            quadrant, third, rest = -quadrant & 3, -third, -rest
    else:
        return math.nan, math.nan
    angle = third + rest
    return _turned(quadrant, angle, (third - angle) + rest)


@internal
def _turned(quadrant: int, x: float, low: float) -> tuple[float, float]:
    """Return sine and cosine of ``x + low`` plus ``quadrant`` quarter turns."""
    sine, cosine = _series(x, low)
    if quadrant == 0:
        return sine, cosine
    if quadrant == 1:
        return cosine, -sine
    if quadrant == 2:
        return -sine, -cosine
    return -cosine, sine


@internal
def _series(x: float, low: float) -> tuple[float, float]:
    """Return sine and cosine of ``x + low``, |x| up to pi / 4, by their Taylor series."""
    z = x * x
    z2 = z * z
    z4 = z2 * z2
    odd = (-1.0 / 6.0 + z * (1.0 / 120.0)) + z2 * (-1.0 / 5040.0 + z * (1.0 / 362880.0))
    odd += z4 * (
        (-1.0 / 39916800.0 + z * (1.0 / 6227020800.0))
        + z2 * (-1.0 / 1307674368000.0 + z * (1.0 / 355687428096000.0))
    )
    even = (1.0 / 24.0 + z * (-1.0 / 720.0)) + z2 * (1.0 / 40320.0 + z * (-1.0 / 3628800.0))
    even += z4 * (
        (1.0 / 479001600.0 + z * (-1.0 / 87178291200.0))
        + z2 * (1.0 / 20922789888000.0 + z * (-1.0 / 6402373705728000.0))
    )
    half = 0.5 * z
    sine = x + (x * z * odd + low * (1.0 - half))
    most = 1.0 - half
    return sine, most + (((1.0 - most) - half) + (z2 * even - x * low))


@internal
def _reduce_huge(x: float) -> tuple[int, float, float]:
    """
    Return the quadrant of ``x`` > 1 and the angle in it, rad, with its remainder.

    Payne and Hanek (1983): only the digits of x 2 / pi around the point are computed.
    Digits have 24 bits, so that products and their sums are exact.
    """
    place = 0
    while x >= _BASE:
        x *= _BASE_INVERSE
        place += 1
    # Column 0 has the weight 1, column m 2^(-24 m); the carry from one to the one before.
    carry, c1, c2, c3, c4, c5, c6, c7 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for m in range(7, 0, -1):
        total = _column(x, place - 1 + m) + carry
        carry = math.floor(total * _BASE_INVERSE)
        # The last one moves to the next place.
        c7, c6, c5, c4, c3, c2, c1 = c6, c5, c4, c3, c2, c1, total - carry * _BASE
    whole = _column(x, place - 1) + carry
    top = (c1 * _BASE + c2) * _BASE_INVERSE * _BASE_INVERSE
    quadrant = int(whole - math.floor(whole * 0.25) * 4.0)
    if top >= 0.5:
        top -= 1.0
        quadrant = (quadrant + 1) & 3
    scale = _BASE_INVERSE * _BASE_INVERSE
    middle = (c3 * _BASE + c4) * scale * scale
    last = (c5 * _BASE + c6 + c7 * _BASE_INVERSE) * scale * scale * scale
    high, low = _two_sum(top, middle)
    high, low = _two_sum(high, low + last)
    angle, lost = _two_product(high, _HALF_PI)
    return quadrant, angle, lost + (high * _HALF_PI_LOW + low * _HALF_PI)


@internal
def _column(x: float, last: int) -> float:
    """Return the sum of the digits of ``x``, the first before the point, times those of 2 / pi."""
    total = 0.0
    for j in range(4):
        digit = math.floor(x)
        x = (x - digit) * _BASE
        if last >= j:
            total += digit * _DIGITS[last - j]
    return total


@compiled
def exp(x: float) -> float:
    """Return e^x."""
    if x != x:
        return math.nan
    if x > 709.782712893384:
        return math.inf
    if x < -745.2:
        return 0.0
    power = (x * _LN2_INVERSE + _ROUNDER) - _ROUNDER
    high, low = x - power * _LN2, -(power * _LN2_LOW)
    r = high + low
    low = (high - r) + low
    tail = 1.0 / 87178291200.0
    tail = 1.0 / 6227020800.0 + r * tail
    tail = 1.0 / 479001600.0 + r * tail
    tail = 1.0 / 39916800.0 + r * tail
    tail = 1.0 / 3628800.0 + r * tail
    tail = 1.0 / 362880.0 + r * tail
    tail = 1.0 / 40320.0 + r * tail
    tail = 1.0 / 5040.0 + r * tail
    tail = 1.0 / 720.0 + r * tail
    tail = 1.0 / 120.0 + r * tail
    tail = 1.0 / 24.0 + r * tail
    tail = 1.0 / 6.0 + r * tail
    tail = 0.5 + r * tail
    one = 1.0 + r
    value = one + ((r - (one - 1.0)) + (low + low * r + r * r * tail))
    return _scaled(value, int(power))


@compiled
def log(x: float) -> float:
    """Return the natural logarithm."""
    if not x > 0.0:
        return -math.inf if x == 0.0 else math.nan
    if x == math.inf:
        return x
    part, power = math.frexp(x)
    if part < 0.7071067811865476:
        part, power = 2.0 * part, power - 1
    f = part - 1.0
    s = f / (2.0 + f)
    z = s * s
    tail = 2.0 / 25.0
    tail = 2.0 / 23.0 + z * tail
    tail = 2.0 / 21.0 + z * tail
    tail = 2.0 / 19.0 + z * tail
    tail = 2.0 / 17.0 + z * tail
    tail = 2.0 / 15.0 + z * tail
    tail = 2.0 / 13.0 + z * tail
    tail = 2.0 / 11.0 + z * tail
    tail = 2.0 / 9.0 + z * tail
    tail = 2.0 / 7.0 + z * tail
    tail = 2.0 / 5.0 + z * tail
    tail = 2.0 / 3.0 + z * tail
    # log(1 + f) = f - h + s (h + z tail) with h = f^2 / 2.
    half = 0.5 * f * f
    return power * _LN2 + (f - (half - (s * (half + z * tail) + power * _LN2_LOW)))


@compiled
def atan2(y: float, x: float) -> float:
    """Return the angle of (x, y) from the x axis, rad, from -pi to pi."""
    if x != x or y != y:
        return math.nan
    a, b = abs(y), abs(x)
    if a == math.inf and b == math.inf:
        a, b = 1.0, 1.0
    if a == 0.0 or b == math.inf:
        angle = 0.0 if math.copysign(1.0, x) > 0.0 else _PI
    elif b == 0.0 or a == math.inf:
        angle = _HALF_PI
    else:
        power = math.frexp(max(a, b))[1]
        if min(a, b) >= max(a, b) * 1e-10:  # otherwise unchanged: below the smallest number
            a, b = math.ldexp(a, -power), math.ldexp(b, -power)
        angle = _angle(a, 0.0, b, 0.0, x < 0.0)
    return math.copysign(angle, y)


@compiled
def acos(x: float) -> float:
    """Return the arc cosine, rad, from 0 to pi; nan beyond -1 to 1."""
    if not abs(x) <= 1.0:
        return math.nan
    if abs(x) == 1.0:
        return 0.0 if x > 0.0 else _PI
    # The sine is the root of (1 - x) (1 + x), to twice the digits.
    a, a_low = _two_sum(1.0, -x)
    b, b_low = _two_sum(1.0, x)
    square, low = _two_product(a, b)
    low += a * b_low + a_low * b
    root = math.sqrt(square)
    whole, part = _two_product(root, root)
    rest = (((square - whole) - part) + low) / (2.0 * root)
    return _angle(root, rest, abs(x), 0.0, x < 0.0)


@internal
def _angle(y: float, y_low: float, x: float, x_low: float, left: bool) -> float:
    """Return the angle of (x, y) > 0, each with a remainder; ``left``: that of (-x, y)."""
    steep = y > x
    if steep:
        y, y_low, x, x_low = x, x_low, y, y_low
    if y < x * 1e-10:  # the arc equals its tangent
        high, low = y / x, 0.0
    else:
        index = int(16.0 * (y / x) + 0.5)
        c = index / 16.0
        # tan(angle - arc of c) = (y - c x) / (x + c y)
        product, lost = _two_product(c, x)
        above, above_low = _two_sum(y, -product)
        above_low += y_low - lost - c * x_low
        product, lost = _two_product(c, y)
        below, below_low = _two_sum(x, product)
        below_low += x_low + lost + c * y_low
        t = above / below
        product, lost = _two_product(t, below)
        t_low = (((above - product) - lost) + above_low - t * below_low) / below
        z = t * t
        tail = -1.0 / 3.0 + z * (1.0 / 5.0 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 - z / 11.0)))
        high, low = _two_sum(_ARCS[index], t)
        low += _ARCS_LOW[index] + (t_low * (1.0 - z) + t * z * tail)
    if steep:
        high, lost = _two_sum(_HALF_PI, -high)
        low = lost + (_HALF_PI_LOW - low)
    if left:
        high, lost = _two_sum(_PI, -high)
        low = lost + (_PI_LOW - low)
    return high + low


@internal
def _scaled(x: float, power: int) -> float:
    """Return x 2^power, rounded once, infinite on overflow."""
    half = power // 2
    return x * math.ldexp(1.0, half) * math.ldexp(1.0, power - half)


@internal
def _two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b as rounded, and the exact rounding error (Knuth)."""
    total = a + b
    of_b = total - a
    return total, (a - (total - of_b)) + (b - of_b)


@internal
def _two_product(a: float, b: float) -> tuple[float, float]:
    """Return a b as rounded, and the exact rounding error (Veltkamp, Dekker)."""
    product = a * b
    a_high = a * _SPLITTER - (a * _SPLITTER - a)
    b_high = b * _SPLITTER - (b * _SPLITTER - b)
    a_low, b_low = a - a_high, b - b_high
    lost = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low
    return product, lost
