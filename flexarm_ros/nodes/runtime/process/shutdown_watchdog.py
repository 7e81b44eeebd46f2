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

"""Shutdown watchdog: end the process if Fast DDS blocks on shutdown, after 15 s at most."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import faulthandler
import os
import threading

_LIMIT_S = 15.0
_OWN_LIMIT_S = 14.0


@contextmanager
def shutdown_limit(status: int = 1) -> Iterator[None]:
    """
    Context manager: end this process with ``status`` if the block takes more than 14 s.

    Fast DDS may deadlock when publishers and participants are destroyed while messages arrive.  If
    it holds the interpreter's lock as well, the process ends after 15 s with status 1 and prints
    its stack.
    """
    faulthandler.dump_traceback_later(_LIMIT_S, exit=True)
    timer = threading.Timer(_OWN_LIMIT_S, os._exit, (status,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        faulthandler.cancel_dump_traceback_later()
