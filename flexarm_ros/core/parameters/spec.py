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
Description of a parameter, and the check of its value.

What is allowed for a key is its :class:`Spec`; :func:`check` checks a value from any source: a
file, a ROS parameter, a bag or a caller.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from decimal import Decimal, DecimalException, InvalidOperation, localcontext
import math
from typing import Any

_ARTICLES = {
    'float': 'a number',
    'int': 'an integer',
    'bool': 'true or false',
    'str': 'a text',
    'float2': 'an array of two numbers, [first, second]',
    'floats': 'an array of numbers',
}
KINDS = tuple(_ARTICLES)
"""What `Spec.kind` may be."""

_SMALLEST = 2.0**-1022  # below it a 64-bit number loses digits
_TYPES: dict[str, tuple[type, ...]] = {
    'float': (int, float), 'int': (int,), 'bool': (bool,), 'str': (str,),
}  # fmt: skip


@dataclass(frozen=True)
class Spec:
    """
    Allowed values and description of one key.

    ``kind`` is one of ``float``, ``int``, ``bool``, ``str``, ``float2`` (an
    array of two, one value per link or axis) and ``floats`` (any length from 1).
    ``low`` and ``high`` bound each value; ``low_open`` excludes the lower
    bound.  ``choices`` lists the allowed texts.  ``live`` marks parameters that may
    change during a run (at a tick boundary).  ``whole_ns`` marks a
    time whose decimal text times 1e9 must be an integer.
    """

    kind: str
    unit: str
    doc: str
    paper: str = ''
    low: float | None = None
    high: float | None = None
    low_open: bool = False
    choices: tuple[str, ...] = ()
    live: bool = False
    whole_ns: bool = False

    @property
    def item(self) -> Spec:
        """Return what is allowed for one number of an array."""
        return replace(self, kind='float')

    @property
    def allowed(self) -> str:
        """Return the choices, or the range with its unit, as text; empty if there is no limit."""
        if self.choices:
            return 'one of ' + ', '.join(self.choices)
        parts = []
        if self.low is not None:
            parts.append(f'{"above" if self.low_open else "at least"} {short(self.low)}')
        if self.high is not None:
            parts.append(f'at most {short(self.high)}')
        bounds = ' and '.join(parts)
        return bounds + (f' {self.unit}' if self.unit and bounds else '')


def parameter(default: Any, kind: str, unit: str, doc: str, **rest: Any) -> Any:
    """Return the field of a key with its default and its :class:`Spec`."""
    key = rest.pop('key', None)
    spec = Spec(kind, unit, doc, **rest)
    return field(default=default, metadata={'spec': spec, 'key': key})


def specs(section: type) -> dict[str, tuple[str, Spec, Any]]:
    """Return ``{key in the file: (field name, Spec, default)}`` of a section's class."""
    return {
        f.metadata['key'] or f.name: (f.name, f.metadata['spec'], f.default)
        for f in fields(section)
        if 'spec' in f.metadata
    }


def short(number: float) -> str:
    """Return a bound in as few digits as it needs."""
    return f'{number:.12g}'


def wrong_kind(key: str, spec: Spec, shown: str) -> ValueError:
    """Return the error for a value, given as text, that is not of the kind of ``spec``."""
    bounds = f' ({spec.allowed})' if spec.allowed else ''
    return ValueError(f'{key}: {shown} is not {_ARTICLES[spec.kind]}{bounds}')


def check(key: str, spec: Spec, value: Any, shown: str = '', text: str = '') -> Any:
    """
    Return a value that is no array in the type of ``spec``.

    ``shown`` is how an error shows the value, ``text`` how it was written; both default to
    ``repr(value)``.  Raises ValueError, one line that names ``key``, the value and what is
    allowed.
    """
    shown, text = shown or repr(value), text or repr(value)
    if not _is_of_kind(spec.kind, value):
        raise wrong_kind(key, spec, shown)
    if spec.kind == 'str':
        _check_text(key, spec, value, shown)
    elif spec.kind == 'int':
        _check_range(key, spec, value, shown)
    elif spec.kind == 'float':
        value = float(value)
        _check_float(key, spec, value, shown)
        if spec.whole_ns:
            _check_whole_ns(key, value, shown, text)
    return value


def _is_of_kind(kind: str, value: Any) -> bool:
    truth = isinstance(value, bool)  # which Python takes for an int
    return isinstance(value, _TYPES[kind]) and truth == (kind == 'bool')


def _check_text(key: str, spec: Spec, value: str, shown: str) -> None:
    if spec.choices and value not in spec.choices:
        raise ValueError(f'{key}: {shown} is not allowed; {spec.allowed}')
    if not value or not value.isprintable() or len(value) > 4096:
        raise ValueError(f'{key}: {shown} is not a printable text of 1 to 4096 characters')


def _check_float(key: str, spec: Spec, value: float, shown: str) -> None:
    if not math.isfinite(value):
        raise ValueError(f'{key}: {shown} is not a finite number ({spec.allowed})')
    if value != 0.0 and abs(value) < _SMALLEST:
        raise ValueError(f'{key}: {shown} is too small a number; use 0')
    _check_range(key, spec, value, shown)


def _check_range(key: str, spec: Spec, value: float, shown: str) -> None:
    too_low = spec.low is not None and (value < spec.low or (spec.low_open and value == spec.low))
    too_high = spec.high is not None and value > spec.high
    if too_low or too_high:
        raise ValueError(f'{key}: {shown} is out of range; it must be {spec.allowed}')


def exact_ns(text: str) -> int | None:
    """Return a decimal text of seconds in nanoseconds, ``None`` if that is not whole."""
    with localcontext() as context:
        context.prec = 60
        try:
            product = Decimal(text).scaleb(9)
        except DecimalException:
            return None
        # More digits than the context holds would have been rounded: compare back.
        if not product.is_finite() or product.adjusted() > 40:
            return None
        whole = product.to_integral_value()
        return int(whole) if whole == product and Decimal(text) == whole.scaleb(-9) else None


def _check_whole_ns(key: str, value: float, shown: str, text: str) -> None:
    written = exact_ns(text if _is_decimal(text) else repr(value))
    if written is None:
        raise ValueError(
            f'{key}: {shown} s is not a whole number of nanoseconds (at most 9 decimals)'
        )
    if written != exact_ns(repr(value)):
        raise ValueError(
            f'{key}: {shown} s cannot be held to the nanosecond by a 64-bit number; use '
            'fewer digits'
        )


def _is_decimal(text: str) -> bool:
    try:
        Decimal(text.strip())
    except InvalidOperation:
        return False
    return True
