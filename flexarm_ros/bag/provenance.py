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

"""
Provenance of a bag: versions of the packages that its numbers depend on, and the source commit.

It does not depend on host, user, wall clock or on whether ROS can be imported: one scenario
gives one bag, from ``run`` and from ``simulate``.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from functools import cache
import hashlib
from importlib import metadata
import os
from pathlib import Path
import platform
import subprocess
from typing import Any

import flexarm_ros

PACKAGES = ('flexarm_ros', 'numpy', 'numba', 'llvmlite', 'mcap', 'rosbags', 'lz4', 'zstandard')
"""Packages that numbers or bytes of a bag depend on."""

LAYERS = ('core', 'wire')
"""Parts of this package that numbers and bytes of a run's messages depend on."""

UNKNOWN = 'unknown'


@dataclass(frozen=True)
class Provenance:
    """
    ``name`` of the scenario, ``versions`` of packages, ``commit`` and ``digest`` of the code.

    ``external`` names the roles of external nodes.
    ``digest`` is the SHA-256 of the source of core and wire, which detects changed code even
    if the commit is the same or unknown.
    """

    name: str = ''
    versions: dict[str, str] = field(default_factory=dict)
    commit: str = UNKNOWN
    digest: str = UNKNOWN
    external: tuple[str, ...] = ()

    @classmethod
    def here(cls, name: str = '', external: Iterable[str] = ()) -> Provenance:
        """Return the provenance of this process."""
        return cls(name, dict(_versions()), _commit(), _digest(), tuple(sorted(external)))

    def to_dict(self) -> dict[str, Any]:
        """Return a JSON-compatible dict."""
        data = asdict(self)
        data['foreign'] = data.pop('external')  # its key in bags
        return data

    @classmethod
    def from_dict(cls, data: Any) -> Provenance:
        """Undo `to_dict`; TypeError or ValueError if ``data`` is invalid."""
        name, versions = data['name'], data['versions']
        external = tuple(data['foreign'])
        texts = [name, data['commit'], data['digest'], *external, *versions, *versions.values()]
        if not all(isinstance(text, str) for text in texts):
            raise TypeError('not a text')
        return cls(name, dict(versions), data['commit'], data['digest'], external)

    def differences(self, other: Provenance) -> list[str]:
        """Return the differences from ``other`` that may change numbers, one text each."""
        names = sorted({*self.versions, *other.versions})
        found = [
            f'{name} {self.versions.get(name, UNKNOWN)}, here {other.versions.get(name, UNKNOWN)}'
            for name in names
            if self.versions.get(name) != other.versions.get(name)
        ]
        if self.digest != other.digest:
            found.append(f'source {self.commit[:12]}, here {other.commit[:12]}, contents differ')
        return found


@cache
def _versions() -> tuple[tuple[str, str], ...]:
    found = [('python', platform.python_version()), ('machine', platform.machine())]
    for package in PACKAGES:
        try:
            found.append((package, metadata.version(package)))
        except metadata.PackageNotFoundError:
            found.append((package, UNKNOWN))
    return tuple(found)


@cache
def _commit() -> str:
    """Return the commit of the checkout whose root holds this package, or ``unknown``."""
    package = Path(flexarm_ros.__file__).resolve().parent
    environment = {k: v for k, v in os.environ.items() if not k.startswith('GIT_')}
    command = ['git', '-C', str(package), 'rev-parse', '--show-toplevel', 'HEAD']
    try:
        answer = subprocess.run(
            command, capture_output=True, text=True, timeout=10, check=True, env=environment
        )
    except (OSError, subprocess.SubprocessError):
        return UNKNOWN
    top, _, commit = answer.stdout.strip().partition('\n')
    return commit if Path(top) == package.parent else UNKNOWN


@cache
def _digest() -> str:
    """Return the SHA-256 of the source files of `LAYERS`, names and contents in sorted order."""
    package = Path(flexarm_ros.__file__).resolve().parent
    names = sorted(
        path.relative_to(package).as_posix()
        for layer in LAYERS
        for path in (package / layer).rglob('*.py')
    )
    digest = hashlib.sha256()
    for name in names:
        digest.update(name.encode() + b'\0')
        digest.update(hashlib.sha256((package / name).read_bytes()).digest())
    return digest.hexdigest()
