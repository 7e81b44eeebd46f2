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

"""The decorators of compiled functions."""

from __future__ import annotations

from flexarm_ros.core.numerics.compiled import (
    allocating,
    compiled,
    FloatArray,
    internal,
    interpreted,
)
import numba
import numpy as np
import pytest

_JIT = not numba.config.DISABLE_JIT  # type: ignore[attr-defined]
needs_jit = pytest.mark.skipif(not _JIT, reason='without compiled code')


@internal
def _third(x: float) -> float:
    """Return a value that is rounded."""
    return x / 3.0


@compiled
def _ninth(x: float) -> float:
    """Call an internal function."""
    return _third(_third(x))


@compiled
def _twice(values: FloatArray) -> FloatArray:
    """Create an array, which this decorator does not allow."""
    return values + values


@allocating
def _doubled(values: FloatArray) -> FloatArray:
    """Create an array."""
    return values + values


def test_an_internal_function_is_the_same_in_compiled_code_and_in_python() -> None:
    assert _ninth(0.1) == _third(_third(0.1)) == interpreted(_ninth)(0.1) == 0.1 / 3.0 / 3.0


@needs_jit
def test_from_python_an_internal_function_is_not_compiled() -> None:
    _third(1.0)
    _ninth(1.0)
    made = _third.dispatcher  # type: ignore[attr-defined]
    assert [str(types) for types in made.signatures] == ['(float64,)']
    _third(1)
    assert len(made.signatures) == 1


@needs_jit
def test_only_an_allocating_function_creates_an_array() -> None:
    values = np.arange(3.0)
    assert _doubled(values).tolist() == [0.0, 2.0, 4.0]
    with pytest.raises(numba.core.errors.NumbaError, match='Only accept returning'):
        _twice(values)
