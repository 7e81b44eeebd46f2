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

"""The directive ``commands``: the help of every ``flexarm`` command, as the command prints it."""

from __future__ import annotations

import argparse
import os
from unittest import mock

from docutils import nodes
from docutils.statemachine import StringList
from flexarm_ros.cli import build_parser, COMMANDS
from sphinx.util.docutils import SphinxDirective

WIDTH = '90'


def help_of(command: str) -> str:
    """Return what ``flexarm COMMAND --help`` prints."""
    with mock.patch.dict(os.environ, {'COLUMNS': WIDTH}):
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
        for command in COMMANDS:
            lines += [f'## {command}', '', '```text', *help_of(command).splitlines(), '```', '']
        self.state.nested_parse(StringList(lines, 'flexarm'), self.content_offset, holder)
        return holder.children
