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

"""Checks across the keys of a scenario."""

from __future__ import annotations

from flexarm_ros.core.control import LAWS
from flexarm_ros.core.control.design.motion import horizon_ns
from flexarm_ros.core.control.open_loop import check_torques
from flexarm_ros.core.parameters.sections import RunConfig
from flexarm_ros.core.run.make_plant import check_substeps
from flexarm_ros.core.run.names import check_names
from flexarm_ros.core.run.parts import check_parts
from flexarm_ros.core.sensing.sensors import check_location
from flexarm_ros.core.timeline import clock_ticks, named_ns, Timeline
from flexarm_ros.core.trajectory import check_reachable, initial_angles


def check(config: RunConfig) -> None:
    """
    Raise ``ValueError``, which names the key, if parameters of ``config`` contradict each other.

    Each value must be within its own :class:`Spec` already.
    """
    check_names(config)
    check_parts(config)
    Timeline.of(config.run)
    named_ns('trajectory.delay', config.trajectory.delay)
    check_location(config)
    clock_ticks(config.run)
    check_reachable(config)
    initial_angles(config)
    if config.controller.law == 'open_loop':
        check_torques(config.torques)
    LAWS[config.controller.law].check(config)
    if LAWS[config.controller.law].PLANS:
        horizon_ns(config)
    check_substeps(config)
