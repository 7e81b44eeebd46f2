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

"""Checks of numeric arguments: in range, or an error that says what is allowed."""

from __future__ import annotations

from typing import Any

from flexarm_ros.core.numerics.compiled import FloatArray
from flexarm_ros.core.parameters.spec import check, Spec
import numpy as np


def within(name: str, value: Any, spec: Spec) -> float:
    """
    Return a number of the kind (``float`` or ``int``) and within the range of ``spec``.

    Raises ``ValueError``, which names the argument, the value and what is allowed.
    """
    try:
        return float(check(name, spec, value.item() if isinstance(value, np.number) else value))
    except (ValueError, OverflowError):
        what = 'a whole number' if spec.kind == 'int' else 'a number'
        raise ValueError(f'{name}: {value!r}, allowed: {what}, {spec.allowed}') from None


def finite_array(name: str, value: Any, shape: tuple[int, ...], what: str) -> FloatArray:
    """
    Return an array of finite numbers with the given shape, in which -1 means at least 1.

    Raises ``ValueError``, which names the argument, the value and what is allowed.
    """
    try:
        array = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(())
    fits = array.ndim == len(shape) and all(
        size > 0 if wanted < 0 else size == wanted
        for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits or not np.isfinite(array).all():
        shown = ' '.join(repr(value).split())
        shown = shown if len(shown) <= 80 else f'{shown[:77]}...'
        raise ValueError(f'{name}: {shown}, allowed: {what}')
    return array
