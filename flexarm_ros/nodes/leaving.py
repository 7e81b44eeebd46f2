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

import faulthandler

_LIMIT_S = 15.0


def leave_for_sure() -> None:
    """
    End this process within 15 s, with status 1 and what it waits for, if it does not by itself.

    Fast DDS takes locks of its own when publishers and participants are destroyed while messages
    come in, and may wait for itself for ever; no limit of ours holds there.
    """
    faulthandler.dump_traceback_later(_LIMIT_S, exit=True)
