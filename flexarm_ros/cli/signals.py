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

"""Termination signals as an exception, or as a flag where work must be completed."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import signal
import threading
from types import FrameType, TracebackType

from flexarm_ros.core.ending import handle_ending


class Interrupted(BaseException):
    """Ctrl-C, SIGTERM or SIGHUP was received; ``status`` is the exit status for it."""

    def __init__(self, signum: int) -> None:
        super().__init__(signal.Signals(signum).name)
        self.status = 128 + signum


@contextlib.contextmanager
def raising() -> Iterator[None]:
    """Raise Interrupted in the main thread on termination signals within the block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    old = handle_ending(_raise)
    try:
        yield
    finally:
        for signum, handler in old.items():
            signal.signal(signum, handler)


def _raise(signum: int, frame: FrameType | None) -> None:
    raise Interrupted(signum)


class Deferred:
    """
    A block in which termination signals only set ``signum`` (0: none received).

    An exception could be raised anywhere, for instance in a callback from compiled code,
    where Python can only drop it.
    """

    def __init__(self) -> None:
        self.signum = 0
        self._old: dict[int, signal._HANDLER] = {}

    @property
    def status(self) -> int:
        """Return the exit status of the received signal, 0 if there was none."""
        return 128 + self.signum if self.signum else 0

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum

    def __enter__(self) -> Deferred:
        if threading.current_thread() is threading.main_thread():
            self._old = handle_ending(self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for signum, handler in self._old.items():
            signal.signal(signum, handler)
