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
A node that takes the place of one that was killed, as a launcher with ``respawn`` starts it.

It has everything loaded before it is needed, so that it comes while the run still goes on: it
waits for one line of JSON, the command line and the environment of the dead node.
"""

from __future__ import annotations

from importlib import import_module
import json
import os
import sys

from flexarm_ros.nodes import process
from flexarm_ros.nodes.classes import MODULES


def main() -> int:
    """Become the node that is told on the standard input."""
    for name in MODULES:
        import_module(name)
    print('loaded', flush=True)
    told = json.loads(sys.stdin.readline())
    os.environ.update(told['environment'])
    return process.run_process(told['words'][0], told['words'][1:])


if __name__ == '__main__':
    sys.exit(main())
