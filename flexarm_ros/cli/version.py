"""The package's version."""

from __future__ import annotations

from importlib import metadata


def package_version() -> str:
    """Return the installed version, or ``unknown`` when run from a bare source tree."""
    try:
        return metadata.version("flexarm_ros")
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"
