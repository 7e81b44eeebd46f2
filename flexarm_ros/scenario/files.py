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

"""Reading of a user's text file with limits: a regular file, of limited size, in UTF-8."""

from __future__ import annotations

import os
from pathlib import Path
import stat

from flexarm_ros.scenario.errors import clip, PATH_WIDTH, ScenarioError


def read_text(path: Path, limit: int) -> str:
    """
    Return a file's text, at most ``limit`` bytes of UTF-8.

    Raises ScenarioError if it cannot be read, is not a regular file (a pipe would block),
    is too large or is not text.
    """
    shown = clip(str(path), PATH_WIDTH)
    try:
        data = _read(path, limit + 1)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise ScenarioError(f'{shown}: cannot be read: {reason}') from None
    if len(data) > limit:
        raise ScenarioError(f'{shown}: larger than the {limit} bytes allowed')
    try:
        text = data.decode('utf-8-sig')
    except UnicodeDecodeError as error:
        raise ScenarioError(f'{shown}: not UTF-8 text (byte {error.start})') from None
    if '\0' in text:
        raise ScenarioError(f'{shown}: not a text file (it holds a zero byte)')
    return text


def _read(path: Path, size: int) -> bytes:
    """Return at most ``size`` bytes of a regular file; ValueError if it is none."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    with os.fdopen(descriptor, 'rb') as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise ValueError('not a regular file')
        return file.read(size)
