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

"""
The ROS 2 nodes of a run, and how their processes start and end.

Imports core, wire, scenario, bag, and the folders here: `nodes.runtime`, which is the same for
every node, `nodes.run_control`, `nodes.realtime`, `nodes.player`, `nodes.view`.  No node imports
another one.
"""

from __future__ import annotations

import sys

from flexarm_ros.bag.mcap.files import open_standard_files
from flexarm_ros.core.warned import allow_warnings


def main(name: str, argv: list[str] | None = None) -> int:
    """
    Run the node ``name`` (or ``compose``) until its run has ended.

    ``node``: the name is the first word of ``argv``, for a part of another package.

    Returns the exit status: 0 done, 1 the run failed, 2 a bad scenario or
    command line, 130, 143 or 129 after a signal.
    """
    open_standard_files()
    allow_warnings()  # before anything else is imported
    from flexarm_ros.nodes.process import run_process

    words = sys.argv[1:] if argv is None else argv
    if name != 'node':
        return run_process(name, words)
    if not words or words[0].startswith('-'):
        print('usage: ros2 run flexarm_ros node NAME [--ros-args ...]', file=sys.stderr)
        return 2
    return run_process(words[0], words[1:])
