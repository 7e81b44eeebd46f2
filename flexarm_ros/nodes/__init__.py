"""The ROS 2 nodes of a run, and how their processes start and end."""

from __future__ import annotations

import sys


def main(name: str, argv: list[str] | None = None) -> int:
    """Run the node ``name`` (or ``compose``) until its run is over.

    Returns the exit status: 0 done, 1 the run failed, 2 a bad scenario or
    command line, 130 or 143 after a signal.
    """
    from flexarm_ros.nodes.process import run_process

    return run_process(name, sys.argv[1:] if argv is None else argv)
