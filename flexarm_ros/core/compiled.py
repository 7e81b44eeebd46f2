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
The one way in which functions of the core are compiled.

``@compiled`` is numba's ``njit`` with a cache on disk and nothing that could
change a result from one run to the next: no fast-math, no threads.  Functions
under it use plain loops, never ``@`` or ``numpy.linalg``, since BLAS may
choose another order of summation on another day.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast, TypeVar

from numba import njit
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
F = TypeVar('F', bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compile ``function`` on its first call, or load it from the cache on disk."""
    result: Any = njit(cache=True, error_model='numpy')(function)
    return cast(F, result)
