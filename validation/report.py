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

"""What every section gives: Markdown tables, pictures, and goals that are met or not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Goal(NamedTuple):
    """
    One line of the summary; ``measured`` and ``limit`` as they are to be printed.

    ``out_of_reach``: not met, and shown to be impossible; it is reported like
    any other, but does not fail `make validate`.
    """

    what: str
    measured: str
    limit: str
    met: bool
    out_of_reach: bool = False


@dataclass
class Section:
    """Text as Markdown, and the goals that it judges."""

    title: str
    lines: list[str] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)
    pictures: dict[str, Figure] = field(default_factory=dict)

    def say(self, text: str) -> None:
        """Add a paragraph."""
        self.lines += [text, '']

    def table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table; the cells' text is taken as it is."""
        self.lines.append('| ' + ' | '.join(head) + ' |')
        self.lines.append('|' + '---|' * len(head))
        self.lines += ['| ' + ' | '.join(str(cell) for cell in row) + ' |' for row in rows]
        self.lines.append('')

    def picture(self, name: str, figure: Figure, alt: str) -> None:
        """Add a picture, to be written as ``docs/images/validation_NAME.png``."""
        self.pictures[name] = figure
        self.lines += [f'![{alt}](images/validation_{name}.png)', '']

    def goal(
        self, what: str, measured: str, limit: str, met: bool, out_of_reach: bool = False
    ) -> None:
        """Judge a goal."""
        self.goals.append(Goal(what, measured, limit, bool(met), out_of_reach))

    def text(self) -> str:
        """Return the section as Markdown, without its title."""
        return '\n'.join(self.lines).rstrip('\n')


def goals_table(goals: Iterable[Goal]) -> list[str]:
    """Return the lines of the summary's table."""
    lines = ['| goal | measured | limit | |', '|---|---|---|---|']
    for goal in goals:
        verdict = 'met' if goal.met else '**not met**'
        lines.append(f'| {goal.what} | {goal.measured} | {goal.limit} | {verdict} |')
    return lines
