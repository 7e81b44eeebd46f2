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

"""The error for an invalid scenario, suite, sweep or torque file."""

from __future__ import annotations

from collections.abc import Iterable
import difflib


class ScenarioError(ValueError):
    """Invalid user input: one line with key, value and what is allowed."""


def suggestion(word: str, known: Iterable[str], cutoff: float = 0.6) -> str:
    """
    Return ``"; did you mean 'x'?"`` for the nearest of ``known``, or an empty text.

    ``cutoff``: similarity, 0 to 1, below which none is near.
    """
    near = difflib.get_close_matches(word[:100], list(known), n=1, cutoff=cutoff)
    return f"; did you mean '{near[0]}'?" if near else ''


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 message``, ``2 messages``."""
    return f'{number} {noun}' if number == 1 else f'{number} {noun}s'


PATH_WIDTH = 200
"""Width of a path in an error; its end is kept, since it distinguishes files."""


def clip(text: str, width: int = 80) -> str:
    """Return ``text`` printable and shortened for one line of an error."""
    shown = text if text.isprintable() else repr(text)[1:-1]
    return shown if len(shown) <= width else shown[: width - 3] + '...'
