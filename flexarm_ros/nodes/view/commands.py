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
"""Commands of the live page to the nodes of a run: pause, step, reset, set a live parameter."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import contextlib
import threading
import time
from typing import Any

from flexarm_ros.core.parameters.sections import SECTIONS
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool, Trigger

_ANSWER_S = 10.0
ACTIONS = ('pause', 'resume', 'step', 'reset', 'set')


class RunCommands:
    """
    Calls the services of a run's nodes.

    ``node_of`` gives the full name of the node that holds a role, empty if there is none.
    Callable from any thread, one command at a time.
    """

    def __init__(self, node_of: Callable[[str], str]) -> None:
        self._node_of = node_of
        self._node = rclpy.create_node('viewer_commands')
        self._clients: dict[str, Client] = {}
        self._lock = threading.Lock()
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        self._thread = threading.Thread(target=self._spin, daemon=True)
        self._thread.start()

    def __call__(self, command: Mapping[str, Any]) -> str:
        """Carry out a command; return the error, empty on success."""
        action = command.get('action')
        if action not in ACTIONS:
            return f'action: {action!r} is not one of {", ".join(ACTIONS)}'
        if action == 'set':
            return self._set(command)
        if action in ('pause', 'resume'):
            request = SetBool.Request(data=action == 'pause')
            return self._call('plant', SetBool, 'pause', request)
        return self._call('plant', Trigger, action, Trigger.Request())

    def close(self) -> None:
        """Stop the thread and the node."""
        self._executor.shutdown()
        self._thread.join(_ANSWER_S)
        self._node.destroy_node()

    def _spin(self) -> None:
        with contextlib.suppress(ExternalShutdownException):
            self._executor.spin()

    def _set(self, command: Mapping[str, Any]) -> str:
        role, key, value = (command.get(name) for name in ('node', 'key', 'value'))
        if not (isinstance(role, str) and isinstance(key, str)):
            return 'node, key: texts are needed'
        if isinstance(value, bool) or not isinstance(value, int | float):
            return f'{role}.{key}: {value!r} is not a number'
        wanted = [Parameter(key, value=float(value)).to_parameter_msg()]
        request = SetParameters.Request(parameters=wanted)
        return self._call(role, SetParameters, 'set_parameters', request)

    def _call(self, role: str, kind: Any, service: str, request: Any) -> str:
        node = found(self._node_of, role)
        if not node:
            return f'{role}: no such node in the run'
        done = threading.Event()
        with self._lock:
            name = f'{node}/{service}'
            if name not in self._clients:
                self._clients[name] = self._node.create_client(kind, name)
            client = self._clients[name]
            if not client.wait_for_service(_ANSWER_S):
                return f'{name}: no such service'
            future = client.call_async(request)
            future.add_done_callback(lambda _: done.set())
            if not done.wait(_ANSWER_S):
                client.remove_pending_request(future)
                return f'{name}: no answer within {_ANSWER_S:g} s'
            return problem_of(future.result())


def found(node_of: Callable[[str], str], role: str) -> str:
    """
    Return the name of a role's node, empty if its status does not arrive within 10 s.

    The page shows the parameters of a run after the plant's status, so that a command may address
    a node whose status has not arrived yet.
    """
    end = time.monotonic() + _ANSWER_S
    while not (node := node_of(role)) and role in SECTIONS and time.monotonic() < end:
        time.sleep(0.02)
    return node


def problem_of(answer: Any) -> str:
    """Return why a service refused, empty if it did not."""
    if hasattr(answer, 'results'):
        return '; '.join(result.reason for result in answer.results if not result.successful)
    return '' if answer.success else str(answer.message)
