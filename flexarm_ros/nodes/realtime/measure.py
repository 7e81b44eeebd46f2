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

"""The timing of a bare loop with absolute deadlines on this machine."""

from __future__ import annotations

import ctypes
import os
import time

from flexarm_ros.core.numerics.compiled import FloatArray
import numpy as np

_TIMER_ABSTIME = 1
_NS = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = (('sec', ctypes.c_long), ('nsec', ctypes.c_long))


def bare_jitter(period_ns: int, ticks: int) -> FloatArray:
    """
    Wake with clock_nanosleep at ``ticks`` deadlines; return how late each was, s, ``(ticks,)``.

    Raises OSError if the clock does not support it.
    """
    sleep = ctypes.CDLL(None).clock_nanosleep
    late = np.empty(ticks)
    first = time.monotonic_ns() + period_ns
    for tick in range(ticks):
        due = first + tick * period_ns
        until = _Timespec(*divmod(due, _NS))
        while error := sleep(time.CLOCK_MONOTONIC, _TIMER_ABSTIME, ctypes.byref(until), None):
            if error != 4:  # EINTR: a signal that Python handles
                raise OSError(error, os.strerror(error))
        late[tick] = (time.monotonic_ns() - due) * 1e-9
    return late
