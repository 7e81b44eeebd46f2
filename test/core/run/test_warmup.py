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

"""Every scenario that can be simulated can be compiled before a run of nodes."""

from __future__ import annotations

from flexarm_ros import scenario
from flexarm_ros.core.run.warmup import warm_up


def test_a_law_that_reads_the_strain_gauges_is_compiled() -> None:
    """The rows take the deflections from the gauges' columns."""
    assignments = ['strain_gauge.noise_std=1e-6', 'controller.deflection_source=strain_gauge']
    warm_up(scenario.load('fls_tip', ['duration=0.01', *assignments]))
