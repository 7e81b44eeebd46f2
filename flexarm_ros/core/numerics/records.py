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
Records as arguments of compiled functions: parameters and scratch under names.

numba takes an array of one record several times faster than a record, and the shapes of a
record's arrays are part of its type, so that the compiler knows them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Records = NDArray[np.void]
"""An array of one record, ``(1,)``; its first element has the fields as attributes."""


def record_type(fields: list[tuple[Any, ...]]) -> Any:
    """
    Return a dtype whose fields are attributes, in compiled and in interpreted code.

    Interpreted, a name that NumPy's records have themselves would hide the field.
    """
    assert not any(hasattr(np.record, name) for name, *_ in fields)
    return np.dtype((np.record, np.dtype(fields, align=True)))
