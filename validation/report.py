"""What every section gives: Markdown tables, pictures, and goals that are met or not."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple


class Goal(NamedTuple):
    """One line of the summary; ``measured`` and ``limit`` as they are to be printed."""

    what: str
    measured: str
    limit: str
    met: bool


@dataclass
class Section:
    """Text as Markdown, and the goals that it judges."""

    title: str
    lines: list[str] = field(default_factory=list)
    goals: list[Goal] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Add a paragraph."""
        self.lines += [text, ""]

    def table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table; the cells' text is taken as it is."""
        self.lines.append("| " + " | ".join(head) + " |")
        self.lines.append("|" + "---|" * len(head))
        self.lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
        self.lines.append("")

    def goal(self, what: str, measured: str, limit: str, met: bool) -> None:
        """Judge a goal."""
        self.goals.append(Goal(what, measured, limit, bool(met)))

    def text(self) -> str:
        """Return the section as Markdown, without its title."""
        return "\n".join(self.lines).rstrip("\n")


def goals_table(goals: Iterable[Goal]) -> list[str]:
    """Return the lines of the summary's table."""
    lines = ["| goal | measured | limit | |", "|---|---|---|---|"]
    for goal in goals:
        verdict = "met" if goal.met else "**not met**"
        lines.append(f"| {goal.what} | {goal.measured} | {goal.limit} | {verdict} |")
    return lines
