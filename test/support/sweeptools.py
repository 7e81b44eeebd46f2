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

"""What a test puts in the place of a sweep's worker: importable in the processes of a pool."""

from __future__ import annotations

from collections.abc import Sequence
import os
import signal

from flexarm_ros.analysis.sweep import worker


def die(tasks: Sequence[worker.Task]) -> list[worker.Row]:
    """Stand in for a run that kills its process: the one with index 3."""
    for task in tasks:
        if task[0] == 3:
            os.kill(os.getpid(), signal.SIGKILL)
    return worker.run_tasks(tasks)
