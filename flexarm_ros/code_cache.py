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
The cache of compiled code: its directory, and the digest that invalidates it.

numba compares the time stamp of the file that contains a function, not those of the functions that
it calls: after a change of a called function, stale code would be loaded.  Each state of the
source therefore has a directory of its own, named by a digest of the core and of the compiler's
versions.

The directories are below ``NUMBA_CACHE_DIR`` if that is set, else below the package's
``__pycache__``, else, if that is not writable, below the user's cache directory.  If none is
writable, nothing is cached.  This, and a full disk, is logged once, by the first process affected.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import errno
from functools import cache
import hashlib
import logging
import os
from pathlib import Path
import shutil
import sys
import tempfile

from flexarm_ros import numba_import  # noqa: F401  # brings the modules whose versions count

PACKAGE = Path(__file__).resolve().parent
COMPILED = ('core', 'wire', 'identification')
"""Folders with compiled functions."""

COMPILERS = ('numba', 'llvmlite', 'numpy')
PREFIX = 'compiled-'
KEPT = 4
"""Number of directories kept when another is created, for example of other Python versions."""
COMPLAINT = 'flexarm_ros: compiled code cannot be kept in '
_TOLD = 'FLEXARM_ROS_CACHE_TOLD'
"""Variable that is set once the complaint has been logged, for processes started later."""

_log = logging.getLogger(__name__)


@cache
def directory() -> Path | None:
    """Return the directory for the present source and versions; it is created if necessary."""
    name = PREFIX + key()
    refused: dict[str, Exception] = {}
    for base in _bases():
        path = base / name
        try:
            if not path.is_dir():
                _clear(base)
                path.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=path):
                return path
        except OSError as error:
            refused[str(path)] = error
            if error.errno == errno.ENOSPC:
                cannot_keep({str(path): error})
    cannot_keep(refused)
    return None


def cannot_keep(refused: Mapping[str, Exception]) -> None:
    """Log why compiled code cannot be cached in any of these directories."""
    reasons = [
        f'{path} ({getattr(why, "strerror", None) or why})' for path, why in refused.items()
    ]
    tell(COMPLAINT + ', '.join(reasons))


def tell(text: str) -> None:
    """Log a complaint, unless this process or the one that started it has done so."""
    if _TOLD not in os.environ:
        os.environ[_TOLD] = '1'
        _log.warning('%s', text)


def key() -> str:
    """Return the digest that names a state of the compiled source and its compilers."""
    digest = hashlib.sha256(sys.version.encode())
    for name in COMPILERS:
        digest.update(f'{name} {sys.modules[name].__version__}\n'.encode())
    # numba itself notices a change of the file of a function, but not of those that it calls.
    for path in sorted(path for name in COMPILED for path in (PACKAGE / name).rglob('*.py')):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + b'\0')
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:24]


def _bases() -> Iterator[Path]:
    own = os.environ.get('NUMBA_CACHE_DIR')
    if own:
        yield Path(own)
    yield PACKAGE / '__pycache__'
    home = os.environ.get('XDG_CACHE_HOME') or os.path.expanduser('~/.cache')
    if os.path.isabs(home):
        yield Path(home) / 'flexarm_ros'


def _clear(base: Path) -> None:
    """Remove old directories of other states, and files of earlier releases."""
    found = sorted(base.glob(PREFIX + '*'), key=lambda path: path.stat().st_mtime)
    for path in found[: max(0, len(found) - KEPT + 1)]:
        shutil.rmtree(path, ignore_errors=True)
    if base.parent == PACKAGE:
        for path in (PACKAGE / 'core').rglob('__pycache__/*.nb[ci]'):
            path.unlink(missing_ok=True)
