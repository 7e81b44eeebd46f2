"""What every section gives: Markdown tables, and checks that must hold."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field


@dataclass
class Section:
    """Text as Markdown, and the checks that failed."""

    title: str
    lines: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)

    def say(self, text: str) -> None:
        """Add a paragraph."""
        self.lines += [text, ""]

    def table(self, head: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Add a table; the cells' text is taken as it is."""
        self.lines.append("| " + " | ".join(head) + " |")
        self.lines.append("|" + "---|" * len(head))
        self.lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in rows]
        self.lines.append("")

    def check(self, holds: bool, what: str) -> None:
        """Note a check that does not hold."""
        if not holds:
            self.failed.append(what)

    def text(self) -> str:
        """Return the section as Markdown."""
        failures = [f"**Does not hold: {what}**" for what in self.failed]
        return "\n".join([f"## {self.title}", "", *self.lines, *failures])
