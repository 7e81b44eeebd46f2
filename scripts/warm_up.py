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
Compile the hot loops into their caches, so that the first run starts at once.

The laws that plan a motion take nearly a minute to compile; they are left to the first run that
asks for one.
"""

from flexarm_ros import scenario
from flexarm_ros.core.control import PLANNING
from flexarm_ros.wire.fused_step import warm_up_nodes

for name in scenario.shipped():
    config = scenario.load(name, [])
    if config.controller.law not in PLANNING:
        warm_up_nodes(config)
