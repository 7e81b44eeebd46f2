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
Import of numba, with all that the first call of a compiled function would load.

This is two thirds of the time from the start of a process to the first tick of a run.  It is a
third shorter without work that has no use here:

- Garbage collections visit half a million new objects, all of which stay.
- ``numba.np.arraymath`` imports ``scipy.linalg`` to see whether it has BLAS, for the inner
  products of ``np.convolve`` and ``np.correlate``, and does without otherwise.
- numba imports ``coverage``, where it is installed, to report compiled lines to it.  If coverage
  is being measured, it is imported already.
- Each of 250 overloaded functions loads all registries of the compiler again as it is registered.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
import gc
import sys

_UNUSED = ('coverage', 'scipy.linalg.cython_blas')


def _load() -> None:
    import numba  # noqa: F401
    from numba.core.registry import cpu_target

    context = cpu_target.target_context
    context.refresh = lambda: None  # of this instance: for calls from within this one
    try:
        type(context).refresh(context)
    finally:
        del context.refresh


@contextmanager
def _absent(names: Sequence[str]) -> Iterator[None]:
    """Let the import of these modules fail, except of those that are imported already."""
    hidden = [name for name in names if name not in sys.modules]
    for name in hidden:
        sys.modules[name] = None  # type: ignore[assignment]
    try:
        yield
    finally:
        for name in hidden:
            del sys.modules[name]


@contextmanager
def _no_collection() -> Iterator[None]:
    """Suspend garbage collection, and exempt what is created from later ones."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if enabled:
            gc.enable()


with _no_collection(), _absent(_UNUSED):
    _load()
