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
Show a run that goes on: ``ros2 launch flexarm_ros view.launch.py``.

The viewer (markers, URDF, TF, WebSocket server) and RViz, both on simulated time where it matters.
Where the viewer fails (a bad argument, a port in use) the launch ends, with status 1.
"""

from importlib.resources import files
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

RVIZ = Path(str(files('flexarm_ros.nodes.view'))) / 'assets' / 'flexarm.rviz'
ARGUMENTS = {
    'namespace': ('', 'namespace of the arm'),
    'rviz': ('true', 'whether to start RViz'),
    'port': ('-1', 'port of the WebSocket server for Foxglove and Lichtblick; -1: none'),
    'rate': ('30.0', 'frames a second at most'),
}


def viewer_ended(event, context):
    """Fail the launch if the viewer has failed."""
    if event.returncode and not context.is_shutdown:
        raise RuntimeError(f'{event.process_name}: exit status {event.returncode}')


def generate_launch_description():
    """Return the launch description."""
    given = {name: LaunchConfiguration(name) for name in ARGUMENTS}
    viewer = Node(
        package='flexarm_ros',
        executable='viewer',
        name='viewer',
        namespace=given['namespace'],
        ros_arguments=['-p', ['port:=', given['port']], '-p', ['rate:=', given['rate']]],
        output='screen',
        on_exit=viewer_ended,
    )
    # Relative names in RViz's file would follow the namespace; it has absolute ones.
    names = ('viewer/markers', 'robot_description')
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        arguments=['-d', str(RVIZ)],
        parameters=[{'use_sim_time': True}],
        remappings=[(f'/{name}', [given['namespace'], f'/{name}']) for name in names],
        condition=IfCondition(given['rviz']),
        output='screen',
    )
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    # RViz first: where it is not installed, launch ends before it has started the viewer.
    return LaunchDescription([*arguments, rviz, viewer])
