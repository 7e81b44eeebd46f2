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

"""Locations of the shipped scenarios, suites and sweeps for every kind of installation."""

from __future__ import annotations

import os
from pathlib import Path
import sys

import flexarm_ros
from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError, suggestion

PACKAGE = 'flexarm_ros'
SUFFIXES = ('.yaml', '.yml')


def config_directories() -> list[Path]:
    """
    Return the existing ``config`` directories, the nearest to the code first.

    In a source tree (or ``pip install -e``) it is beside the package, of a wheel in
    ``share/flexarm_ros/config`` below the prefix, of colcon below the install space, which is on
    the ament index path.
    """
    package = Path(flexarm_ros.__file__).resolve().parent
    prefixes = [*package.parents, Path(sys.prefix)]
    prefixes += [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    candidates = [package.parent / 'config']
    candidates += [prefix / 'share' / PACKAGE / 'config' for prefix in prefixes]
    found: list[Path] = []
    for candidate in candidates:
        if candidate not in found and (candidate / 'fls_tip.yaml').is_file():
            found.append(candidate)
    return found


def _kind(path: Path) -> str:
    for line in path.read_text('utf-8').splitlines():
        if line.startswith('cases:'):
            return 'suite'
        if line.startswith(('grid:', 'draw:')):
            return 'sweep'
    return 'scenario'


def _named(kind: str) -> dict[str, Path]:
    found: dict[str, Path] = {}
    for directory in config_directories()[:1]:
        for path in sorted(directory.glob('*.yaml')):
            if _kind(path) == kind:
                found[path.stem] = path
    return found


def shipped() -> dict[str, Path]:
    """Return ``{name: path}`` of the shipped scenarios, sorted by name."""
    return _named('scenario')


def shipped_suites() -> dict[str, Path]:
    """Return ``{name: path}`` of the shipped suites."""
    return _named('suite')


def shipped_sweeps() -> dict[str, Path]:
    """Return ``{name: path}`` of the shipped sweeps."""
    return _named('sweep')


def find(
    path_or_name: str | os.PathLike[str], known: dict[str, Path] | None = None, base: Path = Path()
) -> Path:
    """
    Return the file for ``path_or_name``: a shipped name, or a path relative to ``base``.

    Raises ScenarioError if there is no such file.
    """
    text = os.fspath(path_or_name)
    known = shipped() if known is None else known
    if text in known:
        return known[text]
    path = base / text
    try:
        if path.is_file():
            return path
        exists = path.exists()
    except (OSError, ValueError):
        exists = False
    if exists:
        raise ScenarioError(f'{clip(text, PATH_WIDTH)}: not a file')
    if path.suffix in SUFFIXES or os.sep in text:
        raise ScenarioError(f'{clip(text, PATH_WIDTH)}: no such file')
    raise ScenarioError(
        f'{clip(text, PATH_WIDTH)}: neither a file nor a shipped name'
        f'{suggestion(text, known) or "; see: flexarm list"}'
    )


def first_comment(path: Path) -> str:
    """Return a file's first comment line, the description shown by ``flexarm list``."""
    for line in path.read_text('utf-8').splitlines():
        if line.startswith('#'):
            return line.lstrip('# ').strip()
        if line.strip():
            break
    return ''
