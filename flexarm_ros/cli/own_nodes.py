"""The option ``--node``: a node of the user's in the place of one of ours."""

from __future__ import annotations

import argparse
import shlex
import shutil
from collections.abc import Sequence

from flexarm_ros.cli import UsageError

REPLACEABLE = ("encoder", "tip_sensor", "trajectory", "controller")


def add_option(parser: argparse.ArgumentParser) -> None:
    """Add ``--node`` to a command's parser."""
    parser.add_argument(
        "--node", dest="nodes", action="append", default=[], type=_assignment,
        metavar="NODE=COMMAND",
        help="start COMMAND in the place of NODE, and end it with the run; repeats, as in "
        "--node controller='python3 my_controller.py'",
    )  # fmt: skip


def own_nodes(given: Sequence[tuple[str, list[str]]]) -> dict[str, list[str]]:
    """Return ``{node: words}``; UsageError where one is named twice."""
    found = dict(given)
    if len(found) < len(given):
        raise UsageError("--node: a node is given twice")
    return found


def _assignment(text: str) -> tuple[str, list[str]]:
    node, _, command = text.partition("=")
    if node not in REPLACEABLE:
        raise argparse.ArgumentTypeError(f"'{node}' is none of {', '.join(REPLACEABLE)}")
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{command}: {str(error).lower()}") from None
    if not words or shutil.which(words[0]) is None:
        raise argparse.ArgumentTypeError(f"{node}: no such command: '{words[0] if words else ''}'")
    return node, words
