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
Run a scenario: ``ros2 launch flexarm_ros run.launch.py scenario:=fls_tip``.

The same nodes, progress, metrics and files as `flexarm run`, in the ROS_DOMAIN_ID of the
environment, under launch's supervision: the nodes can be remapped, and the file included in
another.  A run that fails, is unstable or is interrupted shuts the launch down with one line that
says why, and `ros2 launch` ends with status 1.
"""

import asyncio

from flexarm_ros.bag.errors import BagError
from flexarm_ros.cli import UsageError
from flexarm_ros.cli.running.launched import ARGUMENTS, LaunchedRun
from flexarm_ros.core.run.parts import PARTS, roles
from flexarm_ros.launcher.run import VERDICT_S
from flexarm_ros.scenario import ScenarioError
from launch import Action, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

LOOK_S = 0.05


class Watch(Action):
    """Follows a run till all its nodes have ended, then finishes its files."""

    def __init__(self, run, nodes):
        super().__init__()
        self._run, self._nodes = run, nodes
        self._task = None

    def execute(self, context):
        """Begin to watch; the nodes have been started."""
        self._task = context.asyncio_loop.create_task(self._watch(context))

    def get_asyncio_future(self):
        """Return what launch waits for before it ends."""
        return self._task

    async def _watch(self, context):
        run = self._run
        interrupted = await self._until_all_have_ended(context)
        problem = await asyncio.to_thread(run.finish, interrupted)
        if not problem:
            return
        # Launch has no action that sets its exit status; an error of its event loop makes it 1.
        message = f'{run.name}: the run failed: {problem}'
        context.asyncio_loop.call_exception_handler({'message': message})
        if not context.is_shutdown:
            await context.emit_event(Shutdown(reason=problem))

    async def _until_all_have_ended(self, context):
        """Return whether the run was shut down from outside."""
        run = self._run
        running = {role: node.get_asyncio_future() for role, node in self._nodes.items()}
        while running:
            await asyncio.wait(running.values(), timeout=LOOK_S)
            run.look()
            for role in [role for role, future in running.items() if future.done()]:
                del running[role]
                if not context.is_shutdown:
                    run.nodes.ended(role, self._nodes[role].return_code)
            if run.nodes.failing and not context.is_shutdown:
                await asyncio.sleep(VERDICT_S)
                run.look()
                run.nodes.breaking_off()
                await context.emit_event(Shutdown(reason=run.nodes.blame()))
        return context.is_shutdown and not run.nodes.ending


def start_nodes(context):
    """Return the actions that start the nodes, once the arguments are known."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    try:
        run = LaunchedRun(given, context.launch_configurations.get('ros_namespace', ''))
    except (ScenarioError, UsageError, BagError, OSError) as error:
        raise RuntimeError(str(error)) from None
    ours = {part.NAME for part in PARTS}
    nodes = {
        role: Node(
            package='flexarm_ros',
            executable=role if role in ours else 'node',
            arguments=[] if role in ours else [role],
            name=role,
            namespace=given['namespace'],
            ros_arguments=run.ros_arguments(role),
            additional_env=run.nodes.environment_by_path,
            output='screen',
        )
        for role in roles(run.config)
    }
    return [*nodes.values(), Watch(run, nodes)]


def generate_launch_description():
    """Return the launch description."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=description)
        for name, (default, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start_nodes)])
