"""The one way in which functions of the core are compiled.

``@compiled`` is numba's ``njit`` with a cache on disk and nothing that could
change a result from one run to the next: no fast-math, no threads.  Functions
under it use plain loops, never ``@`` or ``numpy.linalg``, since BLAS may
choose another order of summation on another day.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile ``function`` on its first call, or load it from the cache on disk."""
    result: Any = njit(cache=True, error_model="numpy")(function)
    return cast(F, result)
