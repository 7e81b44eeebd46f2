"""A plain word where an optional library is missing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Turn a failing import within into an ImportError that names the extra to install."""
    try:
        yield
    except ModuleNotFoundError as error:
        missing = error.name or name
        raise ImportError(
            f"{missing} is not installed; python3 -m pip install 'flexarm_ros[{name}]'",
            name=missing,
        ) from None
