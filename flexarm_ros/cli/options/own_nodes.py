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

"""The option ``--node``: replace a node of the package by the user's."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Sequence
import shlex
import shutil

from flexarm_ros.cli import UsageError
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.parts import replaceable


def add_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--node`` to a command's parser."""
    parser.add_argument(
        '--node', dest='nodes', action='append', default=[], type=_assignment,
        metavar='NODE=COMMAND',
        help='start COMMAND instead of NODE and stop it with the run; may repeat, e.g. '
        "--node controller='python3 my_controller.py'",
    )  # fmt: skip


def own_nodes(
    given: Sequence[tuple[str, list[str]]], configs: Iterable[RunConfig]
) -> dict[str, list[str]]:
    """Return ``{node: words}``; UsageError if a node is named twice, or none of a scenario's."""
    found = dict(given)
    if len(found) < len(given):
        raise UsageError('--node: a node is given twice')
    for config in configs:
        check_roles('--node', found, config)
    return found


def check_roles(option: str, given: Iterable[str], config: RunConfig) -> None:
    """Raise UsageError for a role that an external node cannot fill in this scenario."""
    allowed = replaceable(config)
    for role in given:
        if role not in allowed:
            raise UsageError(f"{option}: '{role}' is not one of {', '.join(allowed)}")


def _assignment(text: str) -> tuple[str, list[str]]:
    node, _, command = text.partition('=')
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f'{command}: {str(error).lower()}') from None
    if not words or shutil.which(words[0]) is None:
        raise argparse.ArgumentTypeError(f"{node}: no such command: '{words[0] if words else ''}'")
    return node, words
