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

"""The signals on which a program ends in order."""

from __future__ import annotations

import signal

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Ctrl-C; termination by the system; a closed terminal or a lost ssh connection."""


def handle_ending(handler: signal._HANDLER) -> dict[int, signal._HANDLER]:
    """
    Set ``handler`` for the signals that end a program; return the handlers before.

    An ignored SIGHUP stays ignored, as `nohup` requires.
    """
    ignored = {signal.SIGHUP} if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else set()
    return {s: signal.signal(s, handler) for s in ENDING if s not in ignored}
