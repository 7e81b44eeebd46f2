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
Compilation of the core's functions.

``@compiled`` is numba's ``njit`` with a disk cache and without options that could change a result
between runs: no fast-math, no contraction of a product and a sum into one operation, no threads.
Compiled functions use plain loops, never ``@`` or ``numpy.linalg``, whose order of summation
depends on BLAS, and :mod:`flexarm_ros.core.numerics.elementary` for everything but +, -, *, / and
sqrt.

Beside ``@compiled`` there are ``@internal`` for what only compiled code calls, ``@inlined``, and
``@allocating`` for what creates arrays.  Only the last counts references to arrays, whose code
takes as long to compile as that of short functions themselves, and to run as the plant's step;
elsewhere numba refuses code that creates an array or returns a new view.  Nor may such a function
return an array that it was given: an allocating caller would count its references wrongly.

:mod:`flexarm_ros.code_cache` determines the location of the cache.  An unreadable file in it
(such as one truncated by a full disk) counts as absent and is rewritten.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
import gc
from types import FunctionType
from typing import Any, cast, TypeVar

from flexarm_ros import code_cache
import numba
from numba.core import caching, event
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
F = TypeVar('F', bound=Callable[..., Any])

_config: Any = numba.config
_FunctionCache: Any = caching.FunctionCache


class _Cache(_FunctionCache):  # type: ignore[misc]
    """numba's cache of one function, whose errors never make a call fail."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code of a signature, ``None`` if there is no readable one."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling truncated data may raise anything
            self._forget()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store the compiled code of a signature if possible."""
        try:
            super().save_overload(sig, data)
        except OSError as error:  # a full disk, or the directory was removed
            code_cache.cannot_keep({self.cache_path: error})
            self._forget()

    def _forget(self) -> None:
        try:
            self.flush()
        except OSError:
            self.disable()


class _Collector(event.Listener):
    """Suspends Python's garbage collector while numba compiles: it would free little."""

    def __init__(self) -> None:
        self._depth, self._resume = 0, False

    def on_start(self, event: Any) -> None:
        """Pause at the outermost function."""
        if self._depth == 0:
            self._resume = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Resume after it."""
        self._depth -= 1
        if self._depth == 0 and self._resume:
            gc.enable()


event.register('numba:compile', _Collector())  # type: ignore[no-untyped-call]


def compiled(function: F) -> F:
    """Compile ``function`` on its first call, or load it from the disk cache."""
    return _compiled(function)


def allocating(function: F) -> F:
    """Do as `compiled`, for a function that creates arrays or assigns arrays to slices."""
    return _compiled(function, _nrt=True)


def inlined(function: F) -> F:
    """
    Do as `compiled`, and put the code into that of compiled callers instead of a call.

    For functions that take records of many arrays, each of which would be copied for a call.
    """
    return _compiled(function, inline='always')


def unlocked(function: F) -> F:
    """Do as `compiled`; other threads of Python run during a call from Python."""
    return _compiled(function, nogil=True)


def internal(function: F) -> F:
    """
    Compile ``function`` for compiled callers alone; called from Python, it stays plain Python.

    This saves the code that converts arguments and result from and to Python objects, which takes
    as long to compile as a short function itself.  The results are equal to the bit.
    """
    result: Any = _compiled(function, no_cpython_wrapper=True)
    if result is not function:
        # What numba asks any object for that compiled code mentions; a call of ``result`` itself
        # from Python would crash.
        plain: Any = function
        plain.py_func, plain.dispatcher, plain._numba_type_ = plain, result, result._numba_type_
    return function


def bound(function: Callable[..., Any], *records: Any, example: tuple[Any, ...]) -> Any:
    """
    Return ``function(*records, ...)`` as a function of its last arguments, for many calls.

    ``example``: last arguments of the types that it is called with.  numba's dispatcher, which
    looks for the code of the arguments' types at each call, is left out.
    """
    if not isinstance(function, numba.core.dispatcher.Dispatcher):
        return partial(function, *records)
    types = tuple(map(numba.typeof, (*records, *example)))
    found = function.compile(types)
    return partial(found, *records) if records else found


@cache
def interpreted(function: F) -> F:
    """
    Return a compiled function as plain Python, with the compiled functions that it calls.

    For what is called a few times while a run is set up: compiling it would take a second, and
    loading its code longer than the calls.  The results are equal to the bit.
    """
    plain: Any = getattr(function, 'py_func', None)
    if plain is None:  # not compiled
        return function
    called = {
        name: interpreted(value)
        for name in plain.__code__.co_names
        if hasattr(value := plain.__globals__.get(name), 'py_func')
    }
    made = FunctionType(plain.__code__, {**plain.__globals__, **called}, plain.__name__)
    return cast(F, made)


def _compiled(function: F, **further: Any) -> F:
    # No function is used as a C callback, and compiling the entry point of one takes time.
    options: dict[str, Any] = {'error_model': 'numpy', 'no_cfunc_wrapper': True, '_nrt': False}
    result: Any = numba.njit(**options | further)(function)
    where = None if _config.DISABLE_JIT else code_cache.directory()
    if where is not None:
        # Only while the cache is created: other packages keep their own setting.
        before, _config.CACHE_DIR = _config.CACHE_DIR, str(where)
        try:
            result._cache = _Cache(result.py_func)
        except RuntimeError as error:  # no directory could be made below it
            code_cache.cannot_keep({str(where): error})
        finally:
            _config.CACHE_DIR = before
    return cast(F, result)
