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

"""The last resort of a process that is to end: it does, whatever the middleware thinks of it."""

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
    Give what is done here 14 s, then end this process with ``status``.

    Fast DDS takes locks of its own when publishers and participants are destroyed while messages
    come in, and may wait for itself for ever; no limit of ours holds there.  Where it keeps the
    interpreter's lock too, the process ends after 15 s with status 1 and tells what it waits for.
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
