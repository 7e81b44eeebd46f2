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

"""A file system with little room, for tests of a full disk; needs root."""

from __future__ import annotations

from collections.abc import Iterator
import contextlib
import os
from pathlib import Path
import subprocess

import pytest


@contextlib.contextmanager
def small_disk(path: Path, size: str) -> Iterator[Path]:
    """Mount a tmpfs of ``size`` (as ``1m``) on the new directory ``path``, for the time of use."""
    if os.geteuid() != 0:
        pytest.skip('needs root: mounts a small tmpfs')
    path.mkdir()
    command = ['mount', '-t', 'tmpfs', '-o', f'size={size}', 'tmpfs', str(path)]
    try:
        mounted = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    except OSError as error:
        pytest.skip(f'cannot mount a small tmpfs: {error}')
    if mounted.returncode:
        pytest.skip(f'cannot mount a small tmpfs: {mounted.stderr.strip()}')
    try:
        yield path
    finally:
        subprocess.run(['umount', '--lazy', str(path)], timeout=30, check=True)
