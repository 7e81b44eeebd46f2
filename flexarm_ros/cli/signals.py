"""SIGINT and SIGTERM as an exception, or as a flag while something must not be cut short."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType, TracebackType


class Interrupted(BaseException):
    """Ctrl-C or SIGTERM came; ``status`` is the exit status that says so."""

    def __init__(self, signum: int) -> None:
        super().__init__(signal.Signals(signum).name)
        self.status = 128 + signum


@contextlib.contextmanager
def raising() -> Iterator[None]:
    """Within the block SIGINT and SIGTERM raise Interrupted in the main thread."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    old = {s: signal.signal(s, _raise) for s in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for signum, handler in old.items():
            signal.signal(signum, handler)


def _raise(signum: int, frame: FrameType | None) -> None:
    raise Interrupted(signum)


class Deferred:
    """While the block runs, SIGINT and SIGTERM only set ``signum`` (0: none came).

    The exception would otherwise rise anywhere, within a compiled function's call-back
    too, where Python can only drop it.
    """

    def __init__(self) -> None:
        self.signum = 0
        self._old: dict[int, signal._HANDLER] = {}

    @property
    def status(self) -> int:
        """The exit status of the signal that came, 0 if none did."""
        return 128 + self.signum if self.signum else 0

    def _note(self, signum: int, frame: FrameType | None) -> None:
        self.signum = signum

    def __enter__(self) -> Deferred:
        if threading.current_thread() is threading.main_thread():
            for signum in (signal.SIGINT, signal.SIGTERM):
                self._old[signum] = signal.signal(signum, self._note)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        for signum, handler in self._old.items():
            signal.signal(signum, handler)
