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

"""What a measurement gives back, and how it is printed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib import metadata
import os
from pathlib import Path
import platform
import sys

_PACKAGES = (
    'flexarm_ros', 'numpy', 'numba', 'scipy', 'scikit-fuzzy', 'mcap', 'rclpy', 'ros-fastdds',
    'exudyn', 'distributed', 'helics',
)  # fmt: skip


@dataclass
class Ratio:
    """
    One line of the summary: two figures measured side by side, and their ratio.

    ``goal`` is what the ratio should be at least (``least``) or at most; None: there is none.
    """

    what: str
    ours: str
    beside: str
    value: float
    goal: float | None = None
    least: bool = True
    how: str = ''

    @property
    def verdict(self) -> str:
        """``yes``, ``no``, or nothing where there is no goal."""
        if self.goal is None:
            return ''
        met = self.value >= self.goal if self.least else self.value <= self.goal
        return 'yes' if met else 'no'

    @property
    def aim(self) -> str:
        """Return the goal as text."""
        if self.goal is None:
            return ''
        return f'{"at least" if self.least else "at most"} {self.goal:g}'


@dataclass
class Part:
    """What one part of the benchmark has measured."""

    name: str
    ratios: list[Ratio] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    """Markdown below the part's heading in the document, a paragraph or table each."""


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; every column but the first is a number, to the right."""
    lines = [f'| {" | ".join(head)} |', '|---' + '|---:' * (len(head) - 1) + '|']
    return '\n'.join([*lines, *(f'| {" | ".join(row)} |' for row in rows)])


def summary(parts: Sequence[Part]) -> str:
    """Return the one table of ratios."""
    rows = [
        (r.what, r.ours, r.beside, f'{r.value:.3g}', r.aim, r.verdict, r.how)
        for part in parts
        for r in part.ratios
    ]
    head = ('what', 'ours', 'beside', 'ratio', 'goal', 'met', 'how')
    return markdown(head, rows)


def machine() -> str:
    """Return what the figures were measured on, and with."""
    cores = len(os.sched_getaffinity(0))
    load = os.getloadavg()[0]
    busy = '' if load < 0.5 else ' (busy: figures of wall time are those of a loaded machine)'
    kernel = '.'.join(platform.release().split('.')[:2])
    versions = []
    for package in _PACKAGES:
        try:
            versions.append(f'{package} {metadata.version(package)}')
        except metadata.PackageNotFoundError:
            versions.append(f'{package} not installed')
    return (
        f'{_cpu()}, {cores} cores for this process, load {load:.1f} at the start{busy}; '
        f'{platform.system()} {kernel}, Python {sys.version.split()[0]}; '
        + ', '.join(versions)
        + '.'
    )


def _cpu() -> str:
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        return platform.machine()
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.machine()
