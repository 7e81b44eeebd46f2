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
Modules and compiled code of the process from which the workers of a sweep are forked.

If that process cannot import this module, each worker imports it.
"""

from __future__ import annotations

from dataclasses import replace
import os
import signal

from flexarm_ros.analysis.spawning import ENDING

# Before NumPy is imported: threads of its linear algebra would not survive a fork.
os.environ['OPENBLAS_NUM_THREADS'] = os.environ['OMP_NUM_THREADS'] = '1'

from flexarm_ros.analysis.sweep.worker import simulate_row
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.warned import allow_warnings


def prepare() -> None:
    """Leave the process group of the command, and load the compiled code."""
    os.setpgid(0, 0)
    allow_warnings()
    config = RunConfig()
    two_ticks = replace(config.run, duration=2.0 * config.run.control_period)
    simulate_row(replace(config, run=two_ticks))


if signal.pthread_sigmask(signal.SIG_BLOCK, ()) >= ENDING:  # started by `worker_context`
    prepare()
