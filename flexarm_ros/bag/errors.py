"""Errors of bags and runs' directories."""

from __future__ import annotations


class BagError(Exception):
    """A bag or a run's directory that cannot be used; one line, fit to show a user."""


class BagExistsError(BagError):
    """The place where a bag should be written is taken."""


class BagMissingError(BagError):
    """The run that is named does not exist."""


class BagFormatError(BagError):
    """Bytes that are no MCAP bag, or a damaged one."""


class BagLimitError(BagError):
    """A bag that would need more memory than is allowed."""


class BagContentError(BagError):
    """A sound bag that is not a run of this package (topics, scenario, ticks)."""
