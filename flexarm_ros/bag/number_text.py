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

"""Numbers as text: the shortest that reads back exactly, as ``repr`` writes it."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from flexarm_ros.wire.cdr import FloatArray
import numpy as np

_FAST = 'orjson'
orjson: Any = import_module(_FAST) if find_spec(_FAST) else None
"""A fast writer of numbers; without it the same text takes four times as long."""

_EXPONENT_BELOW, _EXPONENT_FROM = 1e-4, 1e16
"""Magnitudes that ``repr`` writes with an exponent, which orjson does in another form."""


def csv_lines(table: FloatArray) -> bytes:
    """Return the rows of a table (n, m) as lines of CSV, each number as ``repr`` writes it."""
    if orjson is None:
        return b'\n'.join(map(_line, table.tolist())) + b'\n'
    size = np.abs(table)
    missing = np.isnan(table)
    plain = (size == 0.0) | (size >= _EXPONENT_BELOW) & (size < _EXPONENT_FROM) | missing
    text = orjson.dumps(np.ascontiguousarray(table), option=orjson.OPT_SERIALIZE_NUMPY)[2:-2]
    if missing.any():
        text = text.replace(b'null', b'nan')
    lines = text.split(b'],[')
    for i in np.flatnonzero(~plain.all(axis=1)).tolist():
        lines[i] = _line(table[i].tolist())
    return b'\n'.join(lines) + b'\n'


def _line(values: list[float]) -> bytes:
    return ','.join(map(repr, values)).encode()
