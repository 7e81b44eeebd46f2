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
Fly a scenario: ``ros2 launch flexarm_ros run.launch.py scenario:=fls_tip``.

The same nodes as `flexarm run` starts, under launch's supervision instead: in lock-step, recorded
below ``runs`` in the working directory.  The first node that fails ends the launch.
"""

from pathlib import Path
import tempfile

from flexarm_ros import scenario
from flexarm_ros.core.warmup import warm_up
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    EmitEvent,
    OpaqueFunction,
    RegisterEventHandler,
)
from launch.event_handlers import OnProcessExit, OnShutdown
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ROLES = ('plant', 'encoder', 'tip_sensor', 'trajectory', 'controller', 'recorder')
ARGUMENTS = {
    'scenario': ('fls_tip', 'a parameter file, or the name of a shipped scenario'),
    'out': ('', 'directory of the run, new or empty; left out: runs/SCENARIO'),
    'namespace': ('', 'namespace of all nodes and topics'),
    'rtf': ('0.0', 'hold the run to so many times real time; 0.0: as fast as it goes'),
}


def stop_on_failure(event, context):
    """Return what to do when a node has ended: nothing, unless it failed."""
    if event.returncode == 0 or context.is_shutdown:
        return None
    return EmitEvent(event=Shutdown(reason=f'{event.process_name} exited {event.returncode}'))


def start_nodes(context):
    """Return the actions that start the nodes, once the arguments are known."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    config = scenario.load(given['scenario'], [])
    # The nodes get the scenario with every default written out, in YAML that rcl reads as well.
    folder = tempfile.TemporaryDirectory(prefix='flexarm_ros-')
    torques = Path(folder.name) / 'torques.csv'
    if config.torques:
        torques.write_text(scenario.write_torques(config.torques), encoding='utf-8')
    resolved = Path(folder.name) / 'scenario.yaml'
    text = scenario.dump(config, str(torques) if config.torques else None)
    resolved.write_text(text, encoding='utf-8')

    warm_up(config)  # once, not in every process at once

    own = {
        'plant': [f'real_time_factor:={float(given["rtf"])}'],
        'recorder': [f'name:={Path(given["scenario"]).stem}'],
    }
    if given['out']:
        own['recorder'].append(f'output:={given["out"]}')
    nodes = [
        Node(
            package='flexarm_ros',
            executable=role,
            name=role,
            namespace=given['namespace'],
            ros_arguments=[
                *('--params-file', str(resolved)),
                *(word for value in own.get(role, []) for word in ('-p', value)),
            ],
            output='screen',
        )
        for role in ROLES
    ]
    return [
        *nodes,
        *(
            RegisterEventHandler(OnProcessExit(target_action=n, on_exit=stop_on_failure))
            for n in nodes
        ),
        RegisterEventHandler(OnShutdown(on_shutdown=lambda event, context: folder.cleanup())),
    ]


def generate_launch_description():
    """Return the launch description."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])
