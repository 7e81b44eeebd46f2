"""The directive ``commands``: the help of every ``flexarm`` command, as the command prints it."""

from __future__ import annotations

import argparse
import os
from unittest import mock

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.util.docutils import SphinxDirective

from flexarm_ros.cli import _available, build_parser

WIDTH = "90"


def help_of(command: str) -> str:
    """Return what ``flexarm COMMAND --help`` prints."""
    with mock.patch.dict(os.environ, {"COLUMNS": WIDTH}):
        parser = build_parser([command])
        for action in parser._actions:
            if isinstance(action, argparse._SubParsersAction):
                return str(action.choices[command].format_help())
    raise KeyError(command)


class Commands(SphinxDirective):
    """One section a command."""

    def run(self) -> list[nodes.Node]:
        """Return the sections."""
        holder = nodes.section()
        lines: list[str] = []
        for command in _available():
            lines += [f"## {command}", "", "```text", *help_of(command).splitlines(), "```", ""]
        self.state.nested_parse(StringList(lines, "flexarm"), self.content_offset, holder)
        return holder.children
