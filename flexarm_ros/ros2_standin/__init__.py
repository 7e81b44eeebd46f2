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
A very small ``ros2`` command for environments that have rclpy from wheels and nothing more.

ros2cli is not packaged as wheels, so that ``ros2 run`` and the most common queries would be
missing from a virtual environment.  This command has these, with the names, options, output and
exit statuses of the real command, and gives way to the real one wherever that is on ``PATH``.

It uses nothing of the rest of the package, and nothing of the package uses it.
"""

from flexarm_ros.ros2_standin.frame import main

__all__ = ['main']
